//! The servers of a session, as the config wants them.

use tumbled_model::{Frame, Iso, Rig, SensorId, UnixNs};

use super::beat::{Beat, Listeners, Now};
use super::publish::{Audience, Publish};
use super::run_info::RunInfo;
use crate::cli::Failure;
use crate::config::Config;
use crate::control::Desk;
use crate::foxglove::{FoxgloveBridge, FoxgloveConfig, SensorPose};
use crate::stream::{ClientTotals, Hello, StreamConfig, StreamOrigin, StreamServer};
use crate::telemetry::{TelemetryOutlet, TelemetrySender, session_bytes};
use crate::web::{WebConfig, WebServer};

/// What a session is, for those who connect.
#[derive(Clone, Copy, Debug)]
pub struct About<'a> {
    /// Its id.
    pub session: &'a str,
    /// Where its data come from.
    pub origin: StreamOrigin,
    /// Wall time at rig time 0.
    pub unix_at_zero: UnixNs,
    /// What people say of it.
    pub info: &'a RunInfo,
}

/// The running state stream.
#[derive(Debug)]
pub struct Server {
    stream: StreamServer,
    web: Option<WebServer>,
}

impl Server {
    /// Starts what the config names; what comes out of the core goes there by the second value. `now`: for predicted states.
    ///
    /// # Errors
    /// An address or a path that cannot be had, or must not be for these data: exit code 2.
    pub fn start(config: &Config, about: About<'_>, allow_nonlive: bool, now: Now) -> Result<(Self, Publish), Failure> {
        let hello = Hello::new(about.session, &config.name, about.origin, about.unix_at_zero).of_run(about.info);
        let stream = StreamConfig::of(&config.stream, allow_nonlive);
        let stream = StreamServer::start(stream, &hello).map_err(Failure::input)?;
        let web = match config.stream.http {
            Some(address) => {
                let web = WebConfig { address, allow_nonlive, control: config.stream.http_control };
                WebServer::start(&web, &hello, stream.publisher()).map_err(Failure::input)?
            }
            None => None,
        };
        let viewers = match config.stream.foxglove.filter(|_| cfg!(feature = "foxglove")) {
            Some(address) => {
                let bridge = FoxgloveConfig { address, allow_nonlive };
                Some(FoxgloveBridge::start(&bridge, &hello, poses(config)).map_err(Failure::input)?)
            }
            None => None,
        };
        let telemetry = match config.stream.telemetry {
            Some(to) => {
                let session = session_bytes(about.session);
                let sender = TelemetrySender::open(to, session, about.origin, allow_nonlive).map_err(Failure::input)?;
                Some(TelemetryOutlet::new(sender, config.stream.telemetry_kind))
            }
            None => None,
        };
        let beat = match config.stream.rate_hz {
            Some(rate_hz) => {
                let stream = stream.publisher();
                let listeners = Listeners { origin: about.origin, stream, telemetry: telemetry.clone() };
                Some(Beat::start(rate_hz, now, listeners).map_err(Failure::failed)?)
            }
            None => None,
        };
        let audience = Audience {
            stream: stream.publisher(),
            max_cloud_points: config.stream.max_cloud_points,
            horizons: config.stream.point_horizons.clone(),
            viewers,
            web: web.as_ref().map(WebServer::latest),
            telemetry,
            beat,
        };
        Ok((Self { stream, web }, Publish::new(about.origin, about.unix_at_zero, Some(audience))))
    }

    /// The state stream's clients.
    pub fn clients(&self) -> ClientTotals {
        self.stream.clients()
    }

    /// The session runs: the page's orders go to this desk, where the config allows them.
    pub fn take_orders(&self, desk: Desk) {
        if let Some(web) = &self.web {
            web.control().open(desk);
        }
    }

    /// Ends it: clients take what waits for them, for a second at most.
    pub fn stop(self) {
        self.stream.stop();
        if let Some(web) = self.web {
            web.stop();
        }
    }
}

fn poses(config: &Config) -> Vec<SensorPose> {
    let lidars = config.lidars.iter().map(|lidar| pose(&lidar.id, &lidar.t_rig_lidar));
    lidars.chain(config.kinects.iter().map(|kinect| pose(&kinect.id, &kinect.t_rig_kinect))).collect()
}

fn pose<F: Frame>(sensor: &SensorId, t_rig_sensor: &Iso<Rig, F>) -> SensorPose {
    let (translation, rotation) = (t_rig_sensor.isometry.translation.vector, t_rig_sensor.isometry.rotation);
    SensorPose {
        sensor: sensor.clone(),
        translation_m: [translation.x, translation.y, translation.z],
        rotation_xyzw: [rotation.i, rotation.j, rotation.k, rotation.w],
    }
}

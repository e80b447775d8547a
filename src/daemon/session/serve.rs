//! The servers of a session, as the config wants them.

use std::sync::Arc;

use tumbled_kinect::{HEIGHT, WIDTH};
use tumbled_model::{Frame, Iso, Rig, RigNs, SensorId, UnixNs};
use tumbled_sim::scene::Scene;

use super::beat::{Beat, Listeners, Now};
use super::publish::{Audience, Publish, Truth};
use super::run_info::RunInfo;
use super::surface::SurfaceTold;
use super::transport::Transport;
use crate::cli::Failure;
use crate::config::Config;
use crate::control::Desk;
use crate::foxglove::{FoxgloveBridge, FoxgloveConfig, SensorPose};
use crate::simulation::truth::sample;
use crate::stream::hello::SensorPlace;
use crate::stream::{ClientTotals, CloudKind, Hello, StreamConfig, StreamOrigin, StreamServer};
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
    /// The scene that is simulated; `None`: sensors, or a recording.
    pub scene: Option<&'a Arc<Scene>>,
    /// The hold on a replay; `None`: it is none.
    pub transport: Option<&'a Transport>,
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
        let hello = Hello::new(about.session, &config.name, about.origin, about.unix_at_zero)
            .of_run(about.info)
            .of_sensors(places(config));
        let stream = StreamConfig::of(&config.stream, allow_nonlive);
        let stream = StreamServer::start(stream, &hello).map_err(Failure::input)?;
        let web = match config.stream.http {
            Some(address) => {
                let web = WebConfig { address, allow_nonlive, control: config.stream.http_control };
                WebServer::start(&web, &hello, stream.publisher(), about.transport.cloned()).map_err(Failure::input)?
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
            surface: SurfaceTold::new(about.origin),
            truth: about.scene.map(truth),
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

/// Where a scene's target is.
fn truth(scene: &Arc<Scene>) -> Truth {
    let scene = Arc::clone(scene);
    Truth(Box::new(move |t: RigNs| sample(&scene, t)))
}

fn poses(config: &Config) -> Vec<SensorPose> {
    let lidars = config.lidars.iter().map(|lidar| pose(&lidar.id, &lidar.t_rig_lidar));
    lidars.chain(config.kinects.iter().map(|kinect| pose(&kinect.id, &kinect.t_rig_kinect))).collect()
}

/// How the sensors stand, for those who draw them.
fn places(config: &Config) -> Vec<SensorPlace> {
    let place = |pose: SensorPose, kind, corners_m| SensorPlace {
        id: pose.sensor.to_string(),
        kind,
        translation_m: pose.translation_m,
        rotation_xyzw: pose.rotation_xyzw,
        corners_m,
    };
    let lidars = config.lidars.iter().map(|lidar| place(pose(&lidar.id, &lidar.t_rig_lidar), CloudKind::Lidar, None));
    let kinects = config.kinects.iter().map(|kinect| {
        let camera = &kinect.intrinsics;
        let corners = corners_m([camera.fx, camera.fy], [camera.cx, camera.cy]);
        place(pose(&kinect.id, &kinect.t_rig_kinect), CloudKind::Kinect, Some(corners))
    });
    lidars.chain(kinects).collect()
}

/// Where the corners of a depth image are at 1 m depth, in turn, the outer edges of the outermost pixels; camera frame.
/// Focal lengths and principal point, px.
fn corners_m([fx, fy]: [f64; 2], [cx, cy]: [f64; 2]) -> [[f64; 3]; 4] {
    let at = |column: f64, row: f64| [(column - cx) / fx, (row - cy) / fy, 1.0];
    let (right, below) = (WIDTH as f64 - 0.5, HEIGHT as f64 - 0.5);
    [at(-0.5, -0.5), at(right, -0.5), at(right, below), at(-0.5, below)]
}

fn pose<F: Frame>(sensor: &SensorId, t_rig_sensor: &Iso<Rig, F>) -> SensorPose {
    let (translation, rotation) = (t_rig_sensor.isometry.translation.vector, t_rig_sensor.isometry.rotation);
    SensorPose {
        sensor: sensor.clone(),
        translation_m: [translation.x, translation.y, translation.z],
        rotation_xyzw: [rotation.i, rotation.j, rotation.k, rotation.w],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_looks_between_the_corners_of_its_image() {
        // f = 500 px, centre at 100, 40: the left edge is 100.5 px from it, the upper one 40.5, the right one 539.5.
        let [upper_left, upper_right, lower_right, _] = corners_m([500.0; 2], [100.0, 40.0]);
        assert_eq!((upper_left, upper_right[0], lower_right[1]), ([-0.201, -0.081, 1.0], 1.079, 0.879));
    }
}

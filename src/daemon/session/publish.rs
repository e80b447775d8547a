//! What came out of the core, to whoever wants it: the state stream and the log.

use tumbled_core::{CoreHealth, Epoch, Gravity, Level, Notice, Scan, WallClock};
use tumbled_model::{RigNs, Span, UnixNs};

use super::engine::Step;
use crate::stream::{
    Class, CloudKind, CloudLine, CloudView, EventLevel, EventLine, HealthLevel, HealthLine, Publisher, ShellHealth,
    StreamOrigin,
};

/// Turns what came out into lines of the stream and of the log.
#[derive(Debug)]
pub struct Publish {
    /// Where the data come from.
    pub origin: StreamOrigin,
    /// The stream; `None`: nobody is served.
    pub stream: Option<Publisher>,
    /// Points of a CLOUD line at most.
    pub max_cloud_points: usize,
    /// Wall time at rig time 0, for what lies before the first anchor.
    pub unix_at_zero: UnixNs,
    xyz: Vec<[f32; 3]>,
}

impl Publish {
    /// To a stream, or to the log alone.
    pub fn new(origin: StreamOrigin, unix_at_zero: UnixNs, max_cloud_points: usize, stream: Option<Publisher>) -> Self {
        Self { origin, stream, max_cloud_points, unix_at_zero, xyz: Vec::new() }
    }

    /// Tells what one step brought. `shell` is asked only when health is told.
    pub fn step(&mut self, step: &Step<'_>, shell: impl Fn() -> Shell) {
        let wall = step.wall;
        for epoch in &step.outputs.epochs {
            self.cloud(epoch, wall);
        }
        for notice in &step.outputs.notices {
            log(notice);
            self.event(notice, wall);
        }
        for health in &step.outputs.health {
            self.health(health, wall, &shell);
        }
    }

    /// The wall time of an instant.
    fn unix(&self, t: RigNs, wall: &WallClock) -> UnixNs {
        wall.unix(t).unwrap_or(self.unix_at_zero + Span(t.0))
    }

    fn cloud(&mut self, epoch: &Epoch, wall: &WallClock) {
        let Some(stream) = self.stream.as_ref().filter(|stream| stream.wants(Class::Cloud)) else { return };
        let rig = &epoch.rig;
        self.xyz.clear();
        self.xyz.extend(rig.x.iter().zip(&rig.y).zip(&rig.z).map(|((&x, &y), &z)| [x, y, z]));
        let (kind, intensity) = match &epoch.scan {
            Scan::Kinect(_) => (CloudKind::Kinect, None),
            Scan::Lidar(scan) => (CloudKind::Lidar, Some(scan.points.intensity.as_slice())),
        };
        let view = CloudView {
            sensor: &epoch.sensor,
            kind,
            epoch: epoch.number,
            t: epoch.t,
            unix: self.unix(epoch.t, wall),
            frame: "rig",
            xyz: &self.xyz,
            intensity,
        };
        stream.publish(Class::Cloud, &CloudLine::new(self.origin, &view, self.max_cloud_points));
    }

    fn event(&self, notice: &Notice, wall: &WallClock) {
        let Some(stream) = &self.stream else { return };
        let level = match notice.gravity {
            Gravity::Info => EventLevel::Info,
            Gravity::Warn => EventLevel::Warn,
            Gravity::Error => EventLevel::Error,
        };
        let when = (notice.t, self.unix(notice.t, wall));
        let line = EventLine::new(
            self.origin,
            when,
            notice.sensor.as_ref(),
            notice.kind.name(),
            level,
            notice.message.as_str(),
        );
        stream.publish(Class::Event, &line);
    }

    fn health(&self, health: &CoreHealth, wall: &WallClock, shell: &impl Fn() -> Shell) {
        let Some(stream) = self.stream.as_ref().filter(|stream| stream.wants(Class::Health)) else { return };
        let Shell { health: shell, reasons: of_shell } = shell();
        let level = match health.level {
            Level::Ok => HealthLevel::Ok,
            Level::Degraded => HealthLevel::Degraded,
            Level::Failed => HealthLevel::Failed,
        };
        let level = if of_shell.is_empty() { level } else { level.max(HealthLevel::Degraded) };
        let reasons = health.reasons.iter().map(|reason| reason.message.clone()).chain(of_shell).collect();
        let t = RigNs(health.t_ns);
        let line = HealthLine::new(self.origin, (t, self.unix(t, wall)), (level, reasons), health, shell);
        stream.publish(Class::Health, &line);
    }
}

/// The shell's part of health, with what of it is not as it should be.
#[derive(Clone, Debug, Default)]
pub struct Shell {
    /// What is so now.
    pub health: ShellHealth,
    /// What to know and do about it.
    pub reasons: Vec<String>,
}

fn log(notice: &Notice) {
    let (kind, t_s) = (notice.kind.name(), notice.t.0 as f64 * 1e-9);
    match notice.gravity {
        Gravity::Info => tracing::info!(kind, t_s, "{}", notice.message),
        Gravity::Warn => tracing::warn!(kind, t_s, "{}", notice.message),
        Gravity::Error => tracing::error!(kind, t_s, "{}", notice.message),
    }
}

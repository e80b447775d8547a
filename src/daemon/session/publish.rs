//! What came out of the core, to whoever wants it: the state stream, viewers and the log.

use tumbled_core::estimate::TargetState;
use tumbled_core::{CoreHealth, Epoch, Gravity, Notice, WallClock};
use tumbled_io::live::SessionClock;
use tumbled_model::{RigNs, Span, UnixNs};

use super::engine::Step;
use crate::foxglove::FoxgloveBridge;
use crate::stream::state::Delivery;
use crate::stream::{
    Class, CloudLine, CloudView, EventLine, HealthLine, Publisher, ShellHealth, StateLine, StreamOrigin,
};
use crate::telemetry::{Telemetry, TelemetrySender};

/// Turns what came out into lines of the stream, views and lines of the log.
#[derive(Debug)]
pub struct Publish {
    origin: StreamOrigin,
    /// Wall time at rig time 0, for what lies before the first anchor.
    unix_at_zero: UnixNs,
    audience: Option<Audience>,
}

/// Those who are served.
#[derive(Debug)]
pub struct Audience {
    /// The state stream's clients.
    pub stream: Publisher,
    /// Points of a CLOUD line at most.
    pub max_cloud_points: usize,
    /// Viewers.
    pub viewers: Option<FoxgloveBridge>,
    /// The guidance computer.
    pub telemetry: Option<TelemetrySender>,
}

impl Publish {
    /// To an audience, or to the log alone.
    pub fn new(origin: StreamOrigin, unix_at_zero: UnixNs, audience: Option<Audience>) -> Self {
        Self { origin, unix_at_zero, audience }
    }

    /// The wall time of an instant: by the newest anchor at or before it.
    pub fn unix(&self, t: RigNs, wall: &WallClock) -> UnixNs {
        wall.unix(t).unwrap_or(self.unix_at_zero + Span(t.0))
    }

    /// Tells what one step brought. `shell` is asked only when health is told.
    /// `live`: a live session's clock, and when the core took the step up.
    pub fn step(&mut self, step: &Step<'_>, shell: impl Fn() -> ShellHealth, live: Option<(&SessionClock, RigNs)>) {
        for epoch in &step.outputs.epochs {
            self.cloud(epoch, step.wall);
        }
        for (state, epoch) in step.outputs.states.iter().zip(&step.outputs.epochs) {
            let delivery = live.map(|(clock, begun)| Delivery::new(epoch, begun, clock.now().rig));
            self.state(state, delivery, step.wall);
        }
        for notice in &step.outputs.notices {
            log(notice);
            self.event(notice, step.wall);
        }
        for health in &step.outputs.health {
            self.health(health, step.wall, &shell);
        }
    }

    /// Ends the viewers' part; the stream's own server tells its clients.
    pub fn stop(self) {
        if let Some(viewers) = self.audience.and_then(|audience| audience.viewers) {
            viewers.stop();
        }
    }

    fn cloud(&mut self, epoch: &Epoch, wall: &WallClock) {
        let unix = self.unix(epoch.t, wall);
        let Some(audience) = &mut self.audience else { return };
        let view = CloudView::of_epoch(epoch, unix);
        if audience.stream.wants(Class::Cloud) {
            audience.stream.publish(Class::Cloud, &CloudLine::new(self.origin, &view, audience.max_cloud_points));
        }
        if let Some(viewers) = &mut audience.viewers {
            viewers.cloud(&view);
        }
    }

    fn state(&mut self, state: &TargetState, delivery: Option<Delivery>, wall: &WallClock) {
        let unix = self.unix(state.t, wall);
        let Some(audience) = &mut self.audience else { return };
        if let Some(telemetry) = &mut audience.telemetry {
            telemetry.send(&Telemetry::of_epoch(state, unix));
        }
        if audience.stream.wants(Class::State) {
            let line = StateLine::of_epoch(self.origin, state, unix).delivered(delivery);
            audience.stream.publish(Class::State, &line);
        }
    }

    fn event(&mut self, notice: &Notice, wall: &WallClock) {
        let unix = self.unix(notice.t, wall);
        let Some(audience) = &mut self.audience else { return };
        let line = EventLine::of_notice(self.origin, notice, unix);
        audience.stream.publish(Class::Event, &line);
        if let Some(viewers) = &mut audience.viewers {
            viewers.event(&line);
        }
    }

    fn health(&mut self, health: &CoreHealth, wall: &WallClock, shell: &impl Fn() -> ShellHealth) {
        let t = RigNs(health.t_ns);
        let unix = self.unix(t, wall);
        let Some(audience) = &mut self.audience else { return };
        let line = HealthLine::new(self.origin, (t, unix), health.clone(), shell());
        audience.stream.publish(Class::Health, &line);
        if let Some(viewers) = &mut audience.viewers {
            viewers.health(&line, unix.0);
        }
    }
}

fn log(notice: &Notice) {
    let (kind, t_s) = (notice.kind.name(), format_args!("{:.3}", notice.t.0 as f64 * 1e-9));
    match notice.gravity {
        Gravity::Info => tracing::info!(kind, %t_s, "{}", notice.message),
        Gravity::Warn => tracing::warn!(kind, %t_s, "{}", notice.message),
        Gravity::Error => tracing::error!(kind, %t_s, "{}", notice.message),
    }
}

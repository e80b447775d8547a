//! What came out of the core, to whoever wants it: the state stream, viewers and the log.

use std::sync::Arc;
use std::time::{Duration, Instant};

use tumbled_core::estimate::{Mode, MountingReport, Predictor, StateReason, TargetState};
use tumbled_core::evaluate::TruthSample;
use tumbled_core::{CoreHealth, Epoch, Gravity, Notice, WallClock};
use tumbled_io::live::SessionClock;
use tumbled_model::{RigNs, SensorId, Span, UnixNs};

use super::beat::Beat;
use super::engine::Step;
use super::surface::SurfaceTold;
use crate::foxglove::{DepthView, FoxgloveBridge};
use crate::stream::state::Delivery;
use crate::stream::{
    Ahead, Class, CloudLine, CloudView, EventLine, HealthLine, ModelLine, PointLine, Publisher, ShellHealth, SigmaLine,
    StateLine, StreamOrigin, TruthLine,
};
use crate::telemetry::{Telemetry, TelemetryOutlet};
use crate::web::Latest;

/// HEALTH comes so often, on the session's timeline; where that stands still, by this machine's clock.
const HEALTH_EVERY: Duration = Duration::from_secs(1);

/// Turns what came out into lines of the stream, views and lines of the log.
#[derive(Debug)]
pub struct Publish {
    origin: StreamOrigin,
    /// Wall time at rig time 0, for what lies before the first anchor.
    unix_at_zero: UnixNs,
    audience: Option<Audience>,
    /// The sensors' mountings were told not to be as the config says.
    mounting_alarm: bool,
    /// The newest HEALTH and when it was told.
    health: Option<(Instant, HealthLine)>,
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
    /// How far ahead points are predicted.
    pub horizons: Vec<Span>,
    /// What the operator's page and the metrics are asked for.
    pub web: Option<Arc<Latest>>,
    /// The guidance computer.
    pub telemetry: Option<TelemetryOutlet>,
    /// Those who want states between epochs.
    pub beat: Option<Beat>,
    /// What was told of the target's surface.
    pub surface: SurfaceTold,
    /// Where a simulated target truly is; `None`: it is not simulated.
    pub truth: Option<Truth>,
}

/// Where a simulated target truly is at a time; `None`: the scene has none then.
pub struct Truth(pub Box<dyn Fn(RigNs) -> Option<TruthSample> + Send>);

impl core::fmt::Debug for Truth {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Truth").finish_non_exhaustive()
    }
}

impl Publish {
    /// To an audience, or to the log alone.
    pub fn new(origin: StreamOrigin, unix_at_zero: UnixNs, audience: Option<Audience>) -> Self {
        Self { origin, unix_at_zero, audience, mounting_alarm: false, health: None }
    }

    /// The wall time of an instant: by the newest anchor at or before it.
    pub fn unix(&self, t: RigNs, wall: &WallClock) -> UnixNs {
        wall.unix_or_from(t, self.unix_at_zero)
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
            self.mountings(state, step);
        }
        for (state, predictor) in step.outputs.states.iter().zip(&step.outputs.predictors) {
            self.points(state, predictor, step);
        }
        self.newest(step);
        self.surface(step);
        for notice in &step.outputs.notices {
            log(notice.gravity, notice.kind.name(), notice.t, &notice.message);
            self.event(notice, step.wall);
        }
        for health in &step.outputs.health {
            self.health(health, step, &shell);
        }
    }

    /// A replay begins anew: times go back to its start.
    pub fn begin_anew(&mut self) {
        self.mounting_alarm = false;
        self.health = None;
        if let Some(beat) = self.audience.as_ref().and_then(|audience| audience.beat.as_ref()) {
            beat.clear();
        }
        let message = "the replay begins anew: times go back to its start";
        let times = (RigNs(0), self.unix_at_zero);
        self.tell(&EventLine::new(self.origin, times, None, "restarted", Gravity::Info, message));
        tracing::info!("{message}");
    }

    /// Ends predictions and the viewers' part; the stream's own server tells its clients.
    pub fn stop(self) {
        let Some(Audience { viewers, beat, .. }) = self.audience else { return };
        drop(beat);
        if let Some(viewers) = viewers {
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
            if let Some(depth) = DepthView::of_epoch(epoch, unix) {
                viewers.depth(&depth);
            }
        }
    }

    fn state(&mut self, state: &TargetState, delivery: Option<Delivery>, wall: &WallClock) {
        let unix = self.unix(state.t, wall);
        let Some(audience) = &mut self.audience else { return };
        if let Some(telemetry) = audience.telemetry.as_ref().filter(|telemetry| telemetry.kinds().epochs()) {
            telemetry.send(&Telemetry::of_epoch(state, unix));
        }
        let is_wanted = audience.stream.wants(Class::State);
        if is_wanted || audience.web.is_some() || audience.viewers.is_some() {
            let line = StateLine::of_epoch(self.origin, state, unix).delivered(delivery);
            if is_wanted {
                audience.stream.publish(Class::State, &line);
            }
            if let Some(viewers) = &mut audience.viewers {
                viewers.state(&line, unix.0);
            }
            if let Some(web) = &audience.web {
                web.state(line);
            }
        }
        if let Some(truth) = audience.truth.as_ref().filter(|_| audience.stream.wants(Class::Truth))
            && let Some(sample) = (truth.0)(state.t)
        {
            audience.stream.publish(Class::Truth, &TruthLine::new(self.origin, state.epoch, &sample, unix));
        }
    }

    /// The target's surface as of a step's newest epoch, where somebody looks at it and it is due.
    fn surface(&mut self, step: &Step<'_>) {
        let Some(state) = step.outputs.states.last() else { return };
        let unix = self.unix(state.t, step.wall);
        let Some(Audience { stream, viewers, surface, max_cloud_points, .. }) = &mut self.audience else { return };
        let viewers = viewers.as_ref().filter(|viewers| viewers.wants_surface());
        let (model, contour) = (stream.wants(Class::Model), stream.wants(Class::Contour));
        if !model && !contour && viewers.is_none() {
            return;
        }
        let Some(due) = surface.due(step, (state.epoch, state.t, unix)) else { return };
        if model {
            stream.publish(Class::Model, &ModelLine::new(self.origin, &due.model, *max_cloud_points));
        }
        if let Some(line) = due.contour.as_ref().filter(|_| contour) {
            stream.publish(Class::Contour, line);
        }
        if let Some(viewers) = viewers {
            viewers.surface(&due.model, due.contour.as_ref());
        }
    }

    /// The newest epoch of a step: what is predicted with, and where its uncertainty comes from.
    fn newest(&mut self, step: &Step<'_>) {
        let (Some(audience), Some(predictor)) = (&self.audience, step.outputs.predictors.last()) else { return };
        if let Some(beat) = &audience.beat {
            beat.set(predictor, self.unix_now(step.wall));
        }
        if audience.stream.wants(Class::Sigma)
            && let Some(health) = step.estimate_health()
        {
            let t = RigNs(health.t_ns);
            let times = (t, self.unix(t, step.wall));
            let line = SigmaLine::new(self.origin, health.epoch, times, health.sigma_by_source);
            audience.stream.publish(Class::Sigma, &line);
        }
    }

    /// Wall time at rig time 0 as the newest anchor has it.
    fn unix_now(&self, wall: &WallClock) -> UnixNs {
        // No anchor lies beyond: a session is shorter than this, 146 years.
        const END: RigNs = RigNs(i64::MAX / 2);
        wall.unix(END).map_or(self.unix_at_zero, |unix| unix - Span(END.0))
    }

    fn points(&mut self, state: &TargetState, predictor: &Predictor, step: &Step<'_>) {
        let unix = self.unix(state.t, step.wall);
        let Some(audience) = &self.audience else { return };
        if step.points().is_empty() || !audience.stream.wants(Class::Point) {
            return;
        }
        // Where nobody knows the state, nobody knows what comes of it.
        let known = state.motion.is_some();
        let ahead = |after: &Span| Some(Ahead { after: *after, motion: predictor.motion_at(state.t + *after)? });
        let ahead: Vec<Ahead> = audience.horizons.iter().filter(|_| known).filter_map(ahead).collect();
        for point in step.points() {
            audience.stream.publish(Class::Point, &PointLine::new(self.origin, state, unix, point, &ahead));
        }
    }

    /// Tells once when a tracked target shows that mountings are not as the config says, and once when they are again.
    fn mountings(&mut self, state: &TargetState, step: &Step<'_>) {
        let is_alarm = state.reasons.contains(&StateReason::Extrinsic);
        let is_tracked = matches!(state.mode, Mode::Tracking | Mode::Predicted);
        if !is_tracked || is_alarm == self.mounting_alarm {
            return;
        }
        self.mounting_alarm = is_alarm;
        let found = step.estimate_health().map(|health| health.mountings).unwrap_or_default();
        let (gravity, message) = if is_alarm {
            let sentences = found.iter().filter(|report| report.alarm).map(MountingReport::sentence);
            (Gravity::Warn, sentences.collect::<Vec<String>>().join("; "))
        } else {
            (Gravity::Info, "the sensors agree again as well as their mountings' stated σ say".to_owned())
        };
        let sensor = found.iter().find(|report| report.alarm).map(|report| SensorId::from(report.sensor.as_str()));
        let times = (state.t, self.unix(state.t, step.wall));
        let line = EventLine::new(self.origin, times, sensor.as_ref(), "extrinsic", gravity, &message);
        log(gravity, "extrinsic", state.t, &message);
        self.tell(&line);
    }

    fn event(&mut self, notice: &Notice, wall: &WallClock) {
        let unix = self.unix(notice.t, wall);
        self.tell(&EventLine::of_notice(self.origin, notice, unix));
    }

    fn tell(&mut self, line: &EventLine) {
        let Some(audience) = &mut self.audience else { return };
        audience.stream.publish(Class::Event, line);
        if let Some(viewers) = &mut audience.viewers {
            viewers.event(line);
        }
    }

    fn health(&mut self, health: &CoreHealth, step: &Step<'_>, shell: &impl Fn() -> ShellHealth) {
        let t = RigNs(health.t_ns);
        let unix = self.unix(t, step.wall);
        let Some(audience) = &mut self.audience else { return };
        let line = HealthLine::new(self.origin, (t, unix), health.clone(), step.estimate_health(), shell());
        if let Some(viewers) = &mut audience.viewers {
            viewers.health(&line, unix.0);
        }
        tell_health(audience, line.clone());
        self.health = Some((Instant::now(), line));
    }

    /// While no event is played, because a replay is slow, is held or is at its end: the newest HEALTH once a second with
    /// the shell's facts of now, so that those who listen know that it lives.
    pub fn repeat_health(&mut self, shell: impl Fn() -> ShellHealth) {
        let (Some(audience), Some((told, newest))) = (&mut self.audience, &mut self.health) else { return };
        if told.elapsed() < HEALTH_EVERY {
            return;
        }
        *told = Instant::now();
        newest.renew(shell());
        tell_health(audience, newest.clone());
    }
}

fn tell_health(audience: &Audience, line: HealthLine) {
    audience.stream.publish(Class::Health, &line);
    if let Some(web) = &audience.web {
        web.health(line);
    }
}

fn log(gravity: Gravity, kind: &str, t: RigNs, message: &str) {
    let t_s = format_args!("{:.3}", t.0 as f64 * 1e-9);
    match gravity {
        Gravity::Info => tracing::info!(kind, %t_s, "{message}"),
        Gravity::Warn => tracing::warn!(kind, %t_s, "{message}"),
        Gravity::Error => tracing::error!(kind, %t_s, "{message}"),
    }
}

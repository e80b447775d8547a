//! What a replay is told while it plays: pause, speed, from the start again, on to a time. It changes when events are seen,
//! never what they are.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use tumbled_model::{RigNs, Span};

use super::pace::Speed;

/// The hold on a replay. Clones share it.
#[derive(Clone, Debug)]
pub struct Transport(Arc<Mutex<Playing>>);

/// How it plays.
#[derive(Debug)]
struct Playing {
    speed: Speed,
    paused: bool,
    /// Without waiting up to here, then it pauses.
    until: Option<RigNs>,
    /// Where the pace counts from; `None`: from the next event.
    anchor: Option<(Instant, RigNs)>,
    /// Of the newest event that was due.
    at: Option<RigNs>,
    /// It is to begin anew.
    restart: bool,
    /// It cannot begin anew, because of this.
    no_restart: Option<&'static str>,
    /// Everything was played.
    ended: bool,
}

/// What an event has to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Due {
    /// It is due.
    Now,
    /// It will be after this time, unless something else is ordered.
    After(Duration),
    /// It is not before something else is ordered.
    Held,
    /// Everything begins anew.
    Restart,
}

/// An order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled POST /api/transport")]
pub struct TransportOrder {
    /// What to do.
    #[serde(rename = "do")]
    pub deed: Deed,
    /// `speed`: `"max"`, or how many times as fast, a number; `to`: the time on the session's timeline, s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub value: Option<Value>,
}

/// What a replay can be told.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Deed {
    /// It waits where it is.
    Pause,
    /// It goes on.
    Play,
    /// It goes on at another speed.
    Speed,
    /// It plays from the start again.
    Restart,
    /// It plays as fast as it can to a time, from the start again if that has passed, and pauses there.
    To,
}

/// How a replay plays.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled GET /api/transport")]
pub struct TransportReport {
    /// Whether the one who asks may steer it.
    pub allowed: bool,
    /// It waits for `play`.
    pub paused: bool,
    /// How many times as fast as it was recorded; null: as fast as it can.
    pub speed: Option<f64>,
    /// The newest event's time, s on the session's timeline; null: none came yet.
    pub t_s: Option<f64>,
    /// Everything was played.
    pub ended: bool,
    /// Why it cannot begin anew; null: it can.
    pub no_restart: Option<String>,
}

impl Transport {
    /// At a speed. `no_restart`: why it cannot begin anew.
    pub fn new(speed: Speed, no_restart: Option<&'static str>) -> Self {
        let playing = Playing {
            speed,
            paused: false,
            until: None,
            anchor: None,
            at: None,
            restart: false,
            no_restart,
            ended: false,
        };
        Self(Arc::new(Mutex::new(playing)))
    }

    /// Carries an order out.
    ///
    /// # Errors
    /// A sentence for people: what cannot be done, and what can.
    pub fn order(&self, order: &TransportOrder) -> Result<(), String> {
        self.lock().order(order)
    }

    /// How it plays; `allowed`: whether the one who asks may steer it.
    pub fn report(&self, allowed: bool) -> TransportReport {
        let playing = self.lock();
        TransportReport {
            allowed,
            paused: playing.paused,
            speed: match playing.speed {
                Speed::Max => None,
                Speed::Times(times) => Some(times),
            },
            t_s: playing.at.map(|t| t.0 as f64 * 1e-9),
            ended: playing.ended,
            no_restart: playing.no_restart.map(str::to_owned),
        }
    }

    /// Everything was played.
    pub fn end(&self) {
        self.lock().ended = true;
    }

    /// Whether it is to begin anew; it is told so once.
    pub fn take_restart(&self) -> bool {
        let mut playing = self.lock();
        if !playing.restart {
            return false;
        }
        (playing.restart, playing.ended, playing.at, playing.anchor) = (false, false, None, None);
        true
    }

    /// What an event that arrived at `arrived` has to do.
    pub(super) fn due(&self, arrived: RigNs) -> Due {
        self.lock().due(arrived, Instant::now())
    }

    /// What time it is on the session's timeline; `None`: no pace is kept.
    pub(super) fn now(&self) -> Option<RigNs> {
        let playing = self.lock();
        let Speed::Times(times) = playing.speed else { return None };
        if playing.paused || playing.until.is_some() || playing.ended {
            return None;
        }
        let (began, first) = playing.anchor?;
        Some(first + Span((began.elapsed().as_secs_f64() * times * 1e9) as i64))
    }

    fn lock(&self) -> MutexGuard<'_, Playing> {
        // Whole after every order.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Playing {
    fn order(&mut self, order: &TransportOrder) -> Result<(), String> {
        match order.deed {
            Deed::Pause => self.paused = true,
            Deed::Play => (self.paused, self.until) = (false, None),
            Deed::Speed => {
                let speed = match &order.value {
                    Some(Value::String(text)) => text.parse::<Speed>(),
                    value => value.clone().unwrap_or_default().to_string().parse(),
                };
                self.speed = speed.map_err(|error| error.to_string())?;
            }
            Deed::Restart => {
                self.begin_anew()?;
                (self.paused, self.until) = (false, None);
            }
            Deed::To => {
                let seconds = order.value.as_ref().and_then(Value::as_f64).filter(|s| (0.0..=1e9).contains(s));
                let seconds = seconds.ok_or("`to` takes a time on the session's timeline as `value`, s, 0 to 1e9")?;
                let t = RigNs((seconds * 1e9) as i64);
                if self.ended || self.at.is_some_and(|at| at >= t) {
                    self.begin_anew()?;
                }
                (self.paused, self.until) = (false, Some(t));
            }
        }
        // The pace counts anew from the next event.
        self.anchor = None;
        Ok(())
    }

    fn begin_anew(&mut self) -> Result<(), String> {
        if let Some(why) = self.no_restart {
            return Err(format!("it cannot begin anew: {why}"));
        }
        self.restart = true;
        Ok(())
    }

    fn due(&mut self, arrived: RigNs, now: Instant) -> Due {
        if self.restart {
            return Due::Restart;
        }
        if self.until.is_some_and(|until| arrived >= until) {
            (self.paused, self.until) = (true, None);
        }
        if self.paused {
            return Due::Held;
        }
        if let (Speed::Times(times), None) = (self.speed, self.until) {
            let (began, first) = *self.anchor.get_or_insert((now, arrived));
            let due_s = ((arrived - first).as_secs_f64() / times).clamp(0.0, 1e9);
            let left = Duration::from_secs_f64(due_s).saturating_sub(now.saturating_duration_since(began));
            if !left.is_zero() {
                return Due::After(left);
            }
        }
        self.at = Some(arrived);
        Due::Now
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    const S: i64 = 1_000_000_000;

    fn order(transport: &Transport, deed: Deed, value: Option<Value>) -> Result<(), String> {
        transport.order(&TransportOrder { deed, value })
    }

    #[test]
    fn a_paused_replay_holds_and_goes_on_where_it_was() {
        let transport = Transport::new(Speed::Max, None);
        assert_eq!(transport.due(RigNs(S)), Due::Now);
        order(&transport, Deed::Pause, None).expect("pauses");
        assert_eq!((transport.due(RigNs(2 * S)), transport.report(true).paused), (Due::Held, true));
        order(&transport, Deed::Play, None).expect("plays");
        assert_eq!((transport.due(RigNs(2 * S)), transport.report(true).t_s), (Due::Now, Some(2.0)));
    }

    #[test]
    fn it_runs_to_a_time_and_pauses_there_at_any_speed() {
        let transport = Transport::new(Speed::Times(0.001), None);
        order(&transport, Deed::To, Some(json!(3))).expect("runs");
        let due = [1, 2, 3].map(|s| transport.due(RigNs(s * S)));
        assert_eq!(due, [Due::Now, Due::Now, Due::Held]);
        // Back to 1 s: from the start again, and on to it.
        order(&transport, Deed::To, Some(json!(1.5))).expect("runs");
        assert_eq!(transport.due(RigNs(3 * S)), Due::Restart);
        assert!(transport.take_restart() && !transport.take_restart());
        assert_eq!([0, 1, 2].map(|s| transport.due(RigNs(s * S))), [Due::Now, Due::Now, Due::Held]);
    }

    #[test]
    fn another_speed_counts_from_where_it_is() {
        let transport = Transport::new(Speed::Times(1.0), None);
        assert_eq!(transport.due(RigNs(0)), Due::Now);
        assert!(matches!(transport.due(RigNs(10 * S)), Due::After(left) if left > Duration::from_secs(9)));
        order(&transport, Deed::Speed, Some(json!(100))).expect("a speed");
        // The event that waits is the first of the new pace.
        assert_eq!(transport.due(RigNs(10 * S)), Due::Now);
        assert!(matches!(transport.due(RigNs(20 * S)), Due::After(left) if left <= Duration::from_millis(100)));
        order(&transport, Deed::Speed, Some(json!("max"))).expect("a speed");
        assert_eq!((transport.due(RigNs(20 * S)), transport.now()), (Due::Now, None));
    }

    #[test]
    fn what_cannot_be_done_is_said_and_changes_nothing() {
        let transport = Transport::new(Speed::Times(2.0), Some("it is recorded"));
        for (deed, value) in [
            (Deed::Speed, Some(json!(0))),
            (Deed::Speed, None),
            (Deed::Speed, Some(json!("fast"))),
            (Deed::To, None),
            (Deed::To, Some(json!(-1))),
            (Deed::Restart, None),
        ] {
            let error = order(&transport, deed, value).expect_err("it cannot be done");
            assert!(!error.is_empty());
        }
        assert_eq!(transport.due(RigNs(S)), Due::Now);
        assert!(order(&transport, Deed::To, Some(json!(0.5))).expect_err("it has passed").contains("it is recorded"));
        assert_eq!((transport.report(false).speed, transport.take_restart()), (Some(2.0), false));
    }
}

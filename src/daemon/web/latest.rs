//! The newest that is known, for those who ask now and then.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tumbled_core::health::Level;

use crate::stream::{HealthLine, StateLine};

/// Upper bounds of the latencies' classes, s; above the last one is the rest.
pub const LATENCY_BOUNDS_S: [f64; 9] = [0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0, 2.0];

/// The same of the core's work on an epoch, s.
pub const FUSION_BOUNDS_S: [f64; 9] = [0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.15, 0.3, 1.0];

/// HEALTH comes once a second; after this the session hangs.
pub const HEALTH_LATE: Duration = Duration::from_secs(5);

/// Latencies of epochs since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Latencies {
    /// Per class of its bounds, each for itself, and the rest.
    pub counts: [u64; LATENCY_BOUNDS_S.len() + 1],
    /// Of all of them, s.
    pub sum_s: f64,
}

impl Latencies {
    fn count(&mut self, bounds_s: &[f64; LATENCY_BOUNDS_S.len()], latency_s: f64) {
        let class = bounds_s.iter().position(|bound| latency_s <= *bound).unwrap_or(bounds_s.len());
        self.counts[class] += 1;
        self.sum_s += latency_s;
    }
}

/// What is known at one moment.
#[derive(Clone, Debug, Default)]
pub struct Known {
    /// The newest epoch's STATE.
    pub state: Option<Arc<StateLine>>,
    /// The newest HEALTH and how long ago it came.
    pub health: Option<(Duration, Arc<HealthLine>)>,
    /// How long epochs took; live only.
    pub latencies: Latencies,
    /// How long the core worked on them; live only.
    pub fusion: Latencies,
}

impl Known {
    /// Why the daemon is not well; `Ok`: it measures, or waits for a target.
    ///
    /// # Errors
    /// A sentence for people.
    pub fn well(&self) -> Result<(), String> {
        let Some((age, health)) = &self.health else {
            return Err("no HEALTH yet: the session has just begun".to_owned());
        };
        if *age > HEALTH_LATE {
            let age_s = age.as_secs();
            return Err(format!(
                "the last HEALTH is {age_s} s old, one a second is due: the session hangs or has ended"
            ));
        }
        if health.level != Level::Failed {
            return Ok(());
        }
        let reasons = health.core.reasons.iter().chain(&health.shell.reasons);
        let failed: Vec<&str> =
            reasons.filter(|reason| reason.level == Level::Failed).map(|reason| &*reason.message).collect();
        Err(format!("failed: {}", failed.join("; ")))
    }
}

/// The newest STATE and HEALTH. A moment's lock on either side: nobody waits for a reader's connection.
#[derive(Debug, Default)]
pub struct Latest {
    inner: Mutex<Inner>,
}

#[derive(Debug, Default)]
struct Inner {
    state: Option<Arc<StateLine>>,
    health: Option<(Instant, Arc<HealthLine>)>,
    latencies: Latencies,
    fusion: Latencies,
}

impl Latest {
    /// A new epoch's state.
    pub fn state(&self, line: StateLine) {
        let mut inner = self.lock();
        if let Some(delivery) = line.delivery {
            inner.latencies.count(&LATENCY_BOUNDS_S, delivery.latency_ms.total * 1e-3);
            inner.fusion.count(&FUSION_BOUNDS_S, delivery.latency_ms.compute * 1e-3);
        }
        inner.state = Some(Arc::new(line));
    }

    /// A new HEALTH.
    pub fn health(&self, line: HealthLine) {
        self.lock().health = Some((Instant::now(), Arc::new(line)));
    }

    /// What is known now.
    pub fn known(&self) -> Known {
        let inner = self.lock();
        let health = inner.health.as_ref().map(|(came, line)| (came.elapsed(), Arc::clone(line)));
        Known { state: inner.state.clone(), health, latencies: inner.latencies, fusion: inner.fusion }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        // Whole after every statement.
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_latency_is_counted_in_the_first_class_that_holds_it() {
        let mut latencies = Latencies::default();
        for latency_s in [0.02, 0.021, 5.0] {
            latencies.count(&LATENCY_BOUNDS_S, latency_s);
        }
        assert_eq!(latencies.counts, [1, 1, 0, 0, 0, 0, 0, 0, 0, 1]);
        assert!((latencies.sum_s - 5.041).abs() < 1e-12);
    }

    #[test]
    fn a_session_without_health_is_not_well_and_says_so() {
        let error = Latest::default().known().well().expect_err("nothing yet");
        assert!(error.contains("no HEALTH"), "{error}");
    }
}

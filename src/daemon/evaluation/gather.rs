//! What a session gives for its evaluation: the states that are scored, and counts of all.

use std::collections::BTreeMap;

use tumbled_core::TurntableSample;
use tumbled_core::estimate::{Mode, StateReason, TargetState, Validity};
use tumbled_core::evaluate::EstimateSample;
use tumbled_model::{RigNs, UnixNs};

use crate::cli::Failure;
use crate::session::Step;
use crate::session::play::Listener;

/// States kept, 1.3 kB each: two hours of a Kinect and a LiDAR.
const STATES: usize = 300_000;
/// Angles kept, 100 bytes each: a day at 50 a second.
const ANGLES: usize = 5_000_000;

/// What else is known of a state that is scored.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mark {
    /// Wall time of its time.
    pub unix: UnixNs,
    /// Whether its validity is `ok`: the others are `degraded`.
    pub is_ok: bool,
    /// The stated σ of its spin axis, rad, and of its rate, rad/s, where it spins.
    pub spin_sigma: Option<(f64, f64)>,
}

/// What was gathered.
#[derive(Debug)]
pub struct Gathered {
    /// States of mode `tracking` that are not `invalid`, on the session's timeline.
    pub estimates: Vec<EstimateSample>,
    /// What else is known of each of them.
    pub marks: Vec<Mark>,
    /// Where turntables were.
    pub turntable: Vec<TurntableSample>,
    /// Epochs of each mode, in the order of [`MODES`].
    pub modes: [u64; MODES.len()],
    /// Epochs with each reason.
    pub reasons: BTreeMap<StateReason, u64>,
    /// The first and the last epoch.
    pub span: Option<(RigNs, RigNs)>,
    /// States and angles beyond what is kept.
    pub beyond: u64,
    unix_at_zero: UnixNs,
}

/// The modes, as they are reported.
pub const MODES: [Mode; 5] = [Mode::NoTarget, Mode::Acquiring, Mode::Tracking, Mode::Predicted, Mode::Lost];

impl Gathered {
    /// Nothing yet; `unix_at_zero`: wall time at the session's start, for inputs without anchors.
    pub fn new(unix_at_zero: UnixNs) -> Self {
        Self {
            estimates: Vec::new(),
            marks: Vec::new(),
            turntable: Vec::new(),
            modes: [0; MODES.len()],
            reasons: BTreeMap::new(),
            span: None,
            beyond: 0,
            unix_at_zero,
        }
    }

    /// Wall time at the session's start.
    pub fn unix_at_zero(&self) -> UnixNs {
        self.unix_at_zero
    }

    fn state(&mut self, state: &TargetState, unix: UnixNs) {
        self.span = Some((self.span.map_or(state.t, |(from, _)| from), state.t));
        for (count, _) in self.modes.iter_mut().zip(MODES).filter(|(_, mode)| *mode == state.mode) {
            *count += 1;
        }
        for reason in &state.reasons {
            *self.reasons.entry(*reason).or_default() += 1;
        }
        let is_scored = state.mode == Mode::Tracking && state.validity != Validity::Invalid;
        let Some(motion) = state.motion.as_ref().filter(|_| is_scored) else { return };
        if self.estimates.len() >= STATES {
            self.beyond += 1;
            return;
        }
        self.estimates.push(EstimateSample {
            t: state.t,
            t_rig_target: motion.t_rig_target,
            velocity_mps: motion.velocity_mps,
            angular_velocity_rps: motion.angular_velocity_rps,
            covariance: Some(motion.covariance),
            nis: state.nis,
            momentum: motion.momentum,
        });
        let spin_sigma = motion.spin.map(|spin| (spin.axis_sigma_rad, spin.rate_sigma_rps));
        self.marks.push(Mark { unix, is_ok: state.validity == Validity::Ok, spin_sigma });
    }
}

impl Listener for Gathered {
    fn step(&mut self, step: &Step<'_>) -> Result<(), Failure> {
        for state in &step.outputs.states {
            let unix = step.wall.unix_or_from(state.t, self.unix_at_zero);
            self.state(state, unix);
        }
        let room = ANGLES - self.turntable.len();
        let angles = &step.outputs.turntable;
        self.turntable.extend(angles.iter().take(room).cloned());
        self.beyond += angles.len().saturating_sub(room) as u64;
        Ok(())
    }
}

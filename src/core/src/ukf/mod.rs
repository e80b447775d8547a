//! The filter: poses of several sensors to the target's pose, motion and spin, with a covariance that can be believed.
//!
//! ```text
//!   PoseMeasurement ─▶ history ─▶ predict (cubature points) ─▶ gate ─▶ update ─▶ Estimate
//!                      (late ones in their place)                      (square-root array)
//! ```
//! A sensor's pose is `Z = Exp(e) T Exp(b) Exp(n)`: e is constant in the rig (extrinsic, warp, beam tilt), b is forgotten
//! over an angle travelled, n is noise. e, b and a Kinect's lateness are states beside the target's, so that the covariance
//! holds them. Poses' errors are body twists, `T = T̂ Exp(ξ)`, rotation first. (Design note `method.md` §8.)
//!
//! * [`FilterOptions`], [`SensorPrior`]: what it has to be told; [`PoseMeasurement`]: what it is fed;
//! * [`Filter`]: start, update, predict; [`Verdict`]: what became of a pose;
//! * [`MotionPredictor`]: its predictions without it;
//! * [`Estimate`], [`Spin`], [`Momentum`], [`SigmaBySource`]: what it says.

mod clohessy_wiltshire;
mod dynamics;
mod estimate;
mod gate;
mod history;
mod inertia;
mod measurement;
mod options;
mod paper;
mod predictor;
mod root;
mod sigma;
mod spin;
mod start;
mod state;
mod update;

pub use estimate::{Estimate, SigmaBySource};
pub use gate::{Used, Verdict};
pub(crate) use options::BEAM_TILT_RAD;
pub use options::{
    CalibrationTreatment, FilterMethod, FilterOptions, Motion, PoseMeasurement, SensorPrior, StatedUncertainty,
};
pub use predictor::MotionPredictor;
pub use spin::{Momentum, Spin};

use history::History;
use nalgebra::{Isometry3, Matrix6, Vector6};
use state::{RATE, Setup, VELOCITY};
use tumbled_model::{RigNs, Twist};

/// How often something became of a pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FilterCounts {
    /// Taken as they are.
    pub full: u64,
    /// Taken with their noise widened.
    pub soft: u64,
    /// Refused by the gate.
    pub rejected: u64,
    /// Older than the two seconds that are remembered.
    pub too_old: u64,
    /// No pose of a known sensor.
    pub unusable: u64,
    /// The filter's numbers failed, and it went back to where it stood: the sign of a fault.
    pub failed: u64,
}

impl FilterCounts {
    fn count(&mut self, used: Used) {
        let counter = match used {
            Used::Full => &mut self.full,
            Used::Soft => &mut self.soft,
            Used::Rejected => &mut self.rejected,
            Used::TooOld => &mut self.too_old,
            Used::Unusable => &mut self.unusable,
            Used::Failed => &mut self.failed,
        };
        *counter = counter.saturating_add(1);
    }
}

/// What is not known of a motion that something has changed, one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disturbance {
    /// m/s.
    pub velocity_mps: f64,
    /// rad/s.
    pub rate_rps: f64,
    /// For so long it went unnoticed, s: the pose is off by what that made.
    pub unnoticed_s: f64,
}

/// The filter of one target.
#[derive(Clone, Debug)]
pub struct Filter {
    setup: Setup,
    history: History,
    counts: FilterCounts,
}

impl Filter {
    /// Starts from a window of poses, a second of them or six of slow sensors, of any sensors and in any order; some may be
    /// wrong. The target's frame is the one its poses are given in. None where no three poses of one sensor make a motion.
    pub fn start(options: FilterOptions, priors: Vec<SensorPrior>, window: &[PoseMeasurement]) -> Option<Self> {
        let setup = Setup::new(options, priors);
        let begun = start::start(&setup, window)?;
        let mut filter = Self { setup, history: History::new(begun.state), counts: FilterCounts::default() };
        for pose in &begun.poses {
            filter.update(pose);
        }
        Some(filter)
    }

    /// Takes a pose. A late one, of up to two seconds before the newest, is taken in its place and the later ones again.
    pub fn update(&mut self, z: &PoseMeasurement) -> Verdict {
        let verdict = self.history.insert(&self.setup, z);
        self.counts.count(verdict.used);
        verdict
    }

    /// Something pushes the target, or its stage starts or stops: velocity and rate are known no better than this, and the
    /// pose no better than what that made before it was noticed. Calibration stays as it is.
    pub fn disturb(&mut self, by: &Disturbance) {
        let Disturbance { velocity_mps, rate_rps, unnoticed_s } = *by;
        let widened =
            [(0, rate_rps * unnoticed_s), (3, velocity_mps * unnoticed_s), (VELOCITY, velocity_mps), (RATE, rate_rps)];
        self.history.change(|state| state.root.widen(&widened));
    }

    /// The target at a time: from the last pose before it. Does not change the filter.
    pub fn predict(&self, t: RigNs) -> Estimate {
        Estimate::of(&self.setup, &sigma::predict(&self.setup, self.history.before(t), t))
    }

    /// What predicts the target from the newest pose on, without the filter.
    pub fn predictor(&self) -> MotionPredictor {
        MotionPredictor::of(&self.setup, self.history.last())
    }

    /// The target at the newest pose.
    pub fn estimate(&self) -> Estimate {
        Estimate::of(&self.setup, self.history.last())
    }

    /// The most likely pose at a time, without its covariance.
    pub fn pose_at(&self, t: RigNs) -> Isometry3<f64> {
        sigma::mean_at(&self.setup, self.history.before(t), t).target.pose
    }

    /// Where a sensor's points, put into the rig by the file's extrinsic, fit the target's model: `T̂ Exp(bias)`. For a
    /// sensor that is not known, and where calibration is no state, the target's pose.
    pub fn seen_by(&self, t: RigNs, sensor: usize) -> Isometry3<f64> {
        let state = sigma::mean_at(&self.setup, self.history.before(t), t);
        let bias = measurement::bias(&self.setup, &state, sensor);
        state.target.pose * Twist::from_vector(&bias).exp()
    }

    /// By how much the extrinsic of `b` to `a` has left the file's: a twist in the axes of `a`'s `nominal`, rotation first,
    /// with its covariance. None for sensors that are not known, and where calibration is no state.
    pub fn extrinsic_drift(&self, a: usize, b: usize) -> Option<(Vector6<f64>, Matrix6<f64>)> {
        estimate::extrinsic_drift(&self.setup, self.history.last(), a, b)
    }

    /// How late a sensor's stamps are, s, and the standard deviation; for a Kinect whose lateness is a state.
    pub fn lateness(&self, sensor: usize) -> Option<(f64, f64)> {
        let state = self.history.last();
        let time = self.setup.layout.slots(sensor)?.time?;
        let variance = state.root.covariance::<1, 1>(time, time).x;
        Some((state.sensors.get(sensor)?.late_s, libm::sqrt(variance)))
    }

    /// Where the newest pose's uncertainty comes from. None where calibration is no state.
    pub fn sigma_by_source(&self) -> Option<SigmaBySource> {
        SigmaBySource::of(&self.setup, self.history.last())
    }

    /// Whether six poses in a row were refused.
    pub fn is_lost(&self) -> bool {
        gate::is_lost(self.history.last())
    }

    /// What became of the poses so far.
    pub fn counts(&self) -> FilterCounts {
        self.counts
    }
}

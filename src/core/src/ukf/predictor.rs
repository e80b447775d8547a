//! What of the filter predicts: the target's own states, without the sensors'.
//!
//! The target moves whatever the sensors' errors are: what the two have in common matters to the next pose, not to a
//! prediction. The root is upper triangular, so its upper left block is the whole covariance of the target's states.

use super::estimate::Estimate;
use super::root::Root;
use super::sigma;
use super::state::{Setup, State};
use tumbled_model::RigNs;

/// The target at the newest pose, and how it goes on. Does not change; cheap to clone (3 kB at most).
#[derive(Clone, Debug, PartialEq)]
pub struct MotionPredictor {
    setup: Setup,
    state: State,
}

impl MotionPredictor {
    /// Of a filter's newest state.
    pub(super) fn of(setup: &Setup, state: &State) -> Self {
        let root = Root::leading(&state.root, setup.layout.core);
        Self { setup: setup.of_target(), state: State { sensors: Vec::new(), root, ..state.clone() } }
    }

    /// When the newest pose was.
    pub fn t(&self) -> RigNs {
        self.state.t
    }

    /// The target at a time, with the covariance grown by the motion's noise: what [`super::Filter::predict`] says.
    pub fn at(&self, t: RigNs) -> Estimate {
        Estimate::of(&self.setup, &sigma::predict(&self.setup, &self.state, t))
    }
}

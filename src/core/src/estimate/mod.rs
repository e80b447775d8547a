//! Epochs to the target's pose and motion.
//!
//! ```text
//!   Epoch ─▶ segment: the target's points ─▶ track: a frame, laid on the model ─▶ ukf: the motion ─▶ TargetState
//!               ▲ where it should be             ▲ where it should lie            │
//!               └────────────────────────────────┴──────── prediction ────────────┘
//! ```
//!
//! * [`settings`]: what has to be known; [`state`]: what comes out;
//! * `sensors`: each sensor's part; `acquire`: from nothing to a motion; `reacquire`: found again; `axis`: whether it stays; `orders`: an operator's; `estimator`: the whole.

mod acquire;
mod axis;
mod estimator;
mod orders;
mod reacquire;
mod sensors;
pub mod settings;
pub mod state;

pub(crate) use estimator::Estimator;

pub use settings::{EstimateSettings, TargetMotionKind, TargetSearch, Trust};
pub use state::{Mode, MotionCovariance, SpinState, StateInputs, StateReason, TargetMotion, TargetState, Validity};

//! Epochs to the target's pose and motion.
//!
//! ```text
//!   Epoch ─▶ segment: the target's points ─▶ track: a frame, laid on the model ─▶ ukf: the motion ─▶ TargetState
//!               ▲ where it should be             ▲ where it should lie            │
//!               └────────────────────────────────┴──────── prediction ────────────┘
//! ```
//!
//! * [`settings`]: what has to be known; [`state`]: what comes out;
//! * `sensors`: each sensor's part; `company`: what stands beside the target; `acquire`: from nothing to a motion; `reacquire`: found again; `axis`: whether it stays;
//!   `begin`: how a filter is begun; `manoeuvre`: a motion that has changed; `tracking`: a frame to the model and to the filter; `age`: for how long a state is good;
//!   `orders`: an operator's; `estimator`: the whole;
//! * `predictor`: the target between epochs; `points`: the motion of its points;
//! * `mounting`: whether the sensors are mounted as the config says; `report`: what the estimation says of itself;
//!   `standing`: since when.

mod acquire;
mod age;
mod axis;
mod begin;
mod company;
mod estimator;
mod manoeuvre;
mod mounting;
mod orders;
mod points;
mod predictor;
mod reacquire;
mod report;
mod sensors;
pub mod settings;
mod standing;
pub mod state;
mod tracking;

pub(crate) use estimator::Estimator;
pub use estimator::KeptFrame;
pub use points::{NamedPoint, PointMotion};
pub use predictor::Predictor;
pub use report::{EstimateHealth, LatenessReport, MountingReport, SigmaParts, SigmaReport, SpinReport};
pub use settings::{EstimateSettings, TargetMotionKind, TargetSearch, Trust};
pub(crate) use standing::Standing;
pub use state::{Mode, MotionCovariance, SpinState, StateInputs, StateReason, TargetMotion, TargetState, Validity};

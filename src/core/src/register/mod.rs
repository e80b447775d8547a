//! Registration of two clouds of one body, seen by different sensors from different places.
//!
//! ```text
//!   clouds ─▶ check ─▶ roles: the denser is the surface, the sparser the probes
//!          ─▶ surface: normals, curvature, noise, look-up grid   ─┐
//!          ─▶ free space: what each sensor saw through            ├▶ search ─▶ score ─▶ refine ─▶ probe ─▶ modes
//!                                                                 ┘                                          │
//!                                       outcome: pose, covariance, accepted or why not, other modes ◀────────┘
//! ```
//!
//! * [`cloud`]: what goes in; [`outcome`]: what comes out, and why it may be refused;
//! * [`register()`]: any method by its name;
//! * [`freespace`]: what a sensor saw through; [`score`]: how well a pose explains both clouds;
//! * [`cga`]: the default method; search, refinement and judgement are its parts;
//! * [`paper`]: our reconstruction of the published method; [`baseline`]: the methods it is compared with.

pub mod baseline;
mod check;
pub mod cloud;
mod descend;
mod dispatch;
pub mod freespace;
mod modes;
pub mod outcome;
pub mod paper;
mod pose;
mod refine;
pub mod score;
mod search;
mod solve;
mod starts;

pub use cloud::{Cloud, DepthView, RangeView, SensorKind, View};
pub use dispatch::{MethodOptions, register};
pub use freespace::{FreeSpace, Sighting};
pub use outcome::{Doubt, Mode, RegisterError, Registration};
pub use score::{Parts, Placement, Scorer, Weights};
pub use search::SearchOptions;
pub use solve::{Acceptance, CgaOptions, cga};

use nalgebra::Isometry3;

/// How clouds are registered.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub enum Method {
    /// Points against anchored spheres, searched over SO(3), judged by lines of sight (method.md §3.3–4.6).
    #[default]
    Cga,
    /// Our reconstruction of the published method (method.md §3.1, §4.1).
    CgaPaper,
    /// Point to point.
    Icp,
    /// Point to plane.
    PlaneIcp,
    /// Distribution to distribution.
    Gicp,
    /// Curvature-based descriptor.
    Cbd,
}

/// What is known of the pose beforehand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// The guess.
    pub t_reference_moving: Isometry3<f64>,
    /// Its standard deviation in rotation, rad, of each axis.
    pub sigma_rotation_rad: f64,
    /// Its standard deviation at the moving cloud's centroid, m, of each axis.
    pub sigma_translation_m: f64,
}

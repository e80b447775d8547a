//! The published rotation experiment: a target that is turned in 15 steps of 22.5° at 5°/s and rests after each, about x, y
//! and z, seen by both published sensor sets; or a recording of one.
//!
//! ```text
//!   set, axis ─▶ scene ─▶ simulated once ─┬▶ lanes: fused, each sensor alone, the published filter ─┐
//!   INPUT… ─▶ the same lanes ─────────────┴▶ gicp: frame after frame ──────────────────────────────┴▶ rests ─▶ rows
//! ```
//!
//! * [`methods`]: the lanes; [`chain`]: GICP from frame to frame; [`rests`]: when the target rests, and what is said of it then;
//! * [`simulated`], [`recorded`]: where sessions come from;
//! * [`figures`]: steps, attitudes and axes of the rests; [`report`]: for machines and for people.

pub mod chain;
pub mod figures;
pub mod methods;
pub mod recorded;
pub mod report;
pub mod rests;
pub mod simulated;

pub use report::PoseExperimentReport;

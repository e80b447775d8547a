//! The reconstruction experiment: models of targets that turn once, held against their true surfaces.
//!
//! ```text
//!   target, seed ─▶ simulated once ─▶ lanes: fused, each sensor alone ─▶ models ─▶ laid on the mesh ─▶ figures ─▶ report
//! ```
//!
//! * [`truth`]: what of the true surface and its edges was seen; [`trial`]: one target and seed; [`report`]: for machines and people.

pub mod report;
pub mod trial;
pub mod truth;

pub use report::ReconstructionReport;

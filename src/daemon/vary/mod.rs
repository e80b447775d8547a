//! `replay --vary`: what one capture says of each assumption about the rig.
//!
//! * [`assumption`]: what is varied, and how a config is changed by it;
//! * [`report`]: the figures against each value, and where they are least;
//! * [`page`]: the same as curves.

pub mod assumption;
pub mod page;
pub mod report;

pub use assumption::{Assumption, parse};
pub use report::VaryReport;

//! The states of a session held against the truth.
//!
//! ```text
//!   INPUT… ─▶ play ─▶ gather: states, turntable ──┐
//!   truth.csv ─▶ truth ───────────────────────────┴─▶ interval ─▶ core's evaluate ─▶ figures ─▶ report: text, page
//! ```

pub mod figures;
pub mod gather;
pub mod interval;
pub mod page;
pub mod report;
pub mod score;
pub mod text;
pub mod truth;

pub use gather::Gathered;
pub use report::EvaluateReport;

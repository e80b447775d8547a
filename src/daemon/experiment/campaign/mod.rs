//! The acceptance campaigns: trials over seeds, and claims about their figures.
//!
//! * [`mod@file`]: what is measured and what it must reach, a TOML file; `registration` comes with the program;
//! * [`claims`]: figures of pooled trials held against a claim;
//! * [`report`]: all of it, as JSON, as a page and as a table for the documentation;
//! * [`pose`]: campaigns of another kind: whole sessions, and what is said of the target's pose and spin.

pub mod claims;
pub mod file;
pub mod pose;
pub mod report;

pub use file::{Campaign, CampaignFile};
pub use report::CampaignReport;

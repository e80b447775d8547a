//! The published experiments: on simulated sensors, whose truth is known, or on a recording.
//!
//! ```text
//!   spec, seed, index ─▶ pairs: target, attitude, sights ─▶ sensors' bytes ─▶ decoders ─▶ clouds, truth, overlap
//!                          └▶ trial: a method from a start ─▶ errors, verdict, time ─▶ figures ─▶ report: text, JSON, HTML
//! ```
//!
//! * [`pairs`]: two sensors' clouds of a target; [`thin`]: as many points as are asked for; [`organised`]: with the misses;
//! * [`trial`]: one registration, held against the truth; [`symmetry`]: poses that look the same;
//! * [`figures`]: what trials come to; [`bounds`]: how sure a share is;
//! * [`stored`]: pairs as files for other programs;
//! * [`registration`]: the experiment; [`sweep`]: the published method's parameters; [`recorded`]: pairs of a recording;
//! * [`pose`]: the rotation experiment: steps, and what is said of the target at its rests;
//! * [`reconstruction`]: models against true surfaces;
//! * [`lanes`]: a simulated session through several configs at once;
//! * [`campaign`]: the acceptance figures; [`machine`]: where they were measured;
//! * [`text`], [`page`], [`plot`]: figures for people.

pub mod bounds;
pub mod campaign;
pub mod figures;
pub mod lanes;
pub mod machine;
pub mod organised;
pub mod page;
pub mod pairs;
pub mod plot;
pub mod pose;
pub mod reconstruction;
pub mod recorded;
pub mod registration;
pub mod stored;
pub mod sweep;
pub mod symmetry;
pub mod text;
pub mod thin;
pub mod trial;

pub use pairs::{Attitudes, Pair, PairError, PairSpec, PointCounts, Stand};
pub use trial::{Start, Trial};

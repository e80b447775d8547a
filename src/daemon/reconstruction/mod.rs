//! A session's target as a model: points, planes, contour.
//!
//! ```text
//!   play ─▶ gather: frames that show the target ─▶ make: laid on the whole model once more, fused ─▶ core's recon
//!                                                     └▶ files: PLY, OBJ, JSON; picture; report
//! ```

pub mod files;
pub mod gather;
pub mod make;
pub mod picture;
pub mod report;

pub use gather::Frames;
pub use make::Made;
pub use report::ReconstructReport;

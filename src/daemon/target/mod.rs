//! A target that is kept for later sessions: its model, and with it its frame.
//!
//! The file is a text `.ply` that MeshLab and CloudCompare open: points with normals and σ, and in its header whose it is. Its
//! digest is over the points alone: the same points are the same frame, whatever the file and the target are called.

mod file;
mod sizes;

pub use file::{LARGEST, SavedTarget, TargetFileError};
pub use sizes::Sizes;

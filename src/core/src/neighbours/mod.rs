//! Who is near whom: nearest points, k nearest, all within a radius. Deterministic: of equal distances the lowest index.
//!
//! * [`KdTree`]: for queries anywhere; [`Neighbours`]: what a query of the k nearest answers.

mod nearest;
mod tree;

pub use nearest::Neighbours;
pub use tree::KdTree;

//! Who is near whom: nearest points, k nearest, all within a radius. Deterministic: of equal distances the lowest index.
//!
//! * [`KdTree`]: for queries anywhere; [`Neighbours`]: what a query of the k nearest answers.

mod cells;
mod lattice;
mod nearest;
mod tree;

pub(crate) use cells::{Neighbourhood, bounds, each_knn};
pub(crate) use lattice::{Lattice, NOBODY};
pub use nearest::Neighbours;
pub use tree::KdTree;

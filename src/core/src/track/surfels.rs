//! The model's surface elements, a column per quantity, in the target's frame.

use crate::register::{Cloud, SensorKind, View};
use nalgebra::{Point3, Vector3};
use tumbled_model::RigNs;

/// Small pieces of the target's surface: columns of equal length, in the target's frame, in the order they were first seen.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Surfels {
    pub(super) positions: Vec<Point3<f64>>,
    pub(super) normals: Vec<Vector3<f64>>,
    pub(super) weights: Vec<f64>,
    pub(super) last_seen: Vec<RigNs>,
}

/// One of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surfel {
    /// Where it lies, m.
    pub position: Point3<f64>,
    /// Unit, out of the body.
    pub normal: Vector3<f64>,
    /// What is known of it along its normal: one over the variance, 1/m², above 0.
    pub weight: f64,
}

impl Surfels {
    /// Of another session: none was seen in this one yet.
    pub fn of(surfels: impl IntoIterator<Item = Surfel>) -> Self {
        let mut columns = Self::default();
        for Surfel { position, normal, weight } in surfels {
            columns.positions.push(position);
            columns.normals.push(normal);
            columns.weights.push(weight);
            columns.last_seen.push(RigNs(0));
        }
        columns
    }

    /// One after the other.
    pub fn rows(&self) -> impl Iterator<Item = Surfel> + '_ {
        let rows = self.positions.iter().zip(&self.normals).zip(&self.weights);
        rows.map(|((position, normal), weight)| Surfel { position: *position, normal: *normal, weight: *weight })
    }

    /// How many.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Where they lie, m.
    pub fn positions(&self) -> &[Point3<f64>] {
        &self.positions
    }

    /// Unit normals, out of the body.
    pub fn normals(&self) -> &[Vector3<f64>] {
        &self.normals
    }

    /// What is known of each along its normal: one over the variance, 1/m².
    pub fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// When each was last measured.
    pub fn last_seen(&self) -> &[RigNs] {
        &self.last_seen
    }

    /// The model as a cloud that a registration from scratch may be asked of: nobody's viewpoint, the target's frame.
    pub fn cloud(&self) -> Cloud {
        Cloud {
            sensor: SensorKind::Kinect,
            points: self.positions.iter().map(|place| place.cast()).collect(),
            viewpoint: None,
            view: View::Bare,
        }
    }
}

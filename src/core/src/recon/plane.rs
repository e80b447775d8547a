//! A plane of the target: where it lies, how well that is known, and where it has points.

use super::raster::Raster;
use crate::cga::Plane;
use nalgebra::{Point2, Point3, Unit, Vector3};

/// A plane that was found.
#[derive(Clone, Debug, PartialEq)]
pub struct FoundPlane {
    /// Unit, out of the body.
    pub normal: Vector3<f64>,
    /// n·x of its points, m.
    pub height_m: f64,
    /// The middle of its points.
    pub centroid: Point3<f64>,
    /// Unit directions in it, that of its longer extent first; with the normal right-handed.
    pub tangents: [Vector3<f64>; 2],
    /// Of its height at the centroid: one standard deviation, m.
    pub height_sigma_m: f64,
    /// Of its tilt along each of the tangents (a turn about the other one), rad.
    pub tilt_sigma_rad: [f64; 2],
    /// Root mean square distance of its points before they were laid on it, m.
    pub rms_m: f64,
    /// What its points cover, m².
    pub area_m2: f64,
    /// Its points, by their numbers, rising.
    pub members: Vec<u32>,
    pub(super) raster: Raster,
}

impl FoundPlane {
    /// As a vector of G(4,1).
    pub fn conformal(&self) -> Plane<f64> {
        Plane::new(&Unit::new_unchecked(self.normal), self.height_m)
    }

    /// How far a place is above it, m: outside the body.
    pub fn height(&self, place: &Point3<f64>) -> f64 {
        self.normal.dot(&place.coords) - self.height_m
    }

    /// A place's coordinates in it, along its tangents from its centroid, m.
    pub fn in_plane(&self, place: &Point3<f64>) -> Point2<f64> {
        let [u, v] = &self.tangents;
        let from = place - self.centroid;
        Point2::new(from.dot(u), from.dot(v))
    }

    /// The place of coordinates in it.
    pub fn lift(&self, at: &Point2<f64>) -> Point3<f64> {
        let [u, v] = &self.tangents;
        // The centroid is weighted: on the plane to rounding only.
        let middle = self.centroid - self.normal * self.height(&self.centroid);
        middle + u * at.x + v * at.y
    }

    /// Whether the foot of a place lies where the plane has points, or within a cell of it.
    pub fn covers(&self, place: &Point3<f64>) -> bool {
        self.raster.is_near(&self.in_plane(place), 1)
    }

    /// Closed polygons around what its points cover, m, one for each patch; their sides follow the raster.
    pub fn outlines(&self) -> Vec<Vec<Point3<f64>>> {
        let lift = |outline: Vec<Point2<f64>>| outline.iter().map(|at| self.lift(at)).collect();
        self.raster.outlines().into_iter().map(lift).collect()
    }

    /// σ of its height at a place in it, m.
    pub fn sigma_at_m(&self, place: &Point3<f64>) -> f64 {
        let at = self.in_plane(place);
        let [first, second] = self.tilt_sigma_rad;
        libm::sqrt(
            self.height_sigma_m * self.height_sigma_m
                + (at.x * first) * (at.x * first)
                + (at.y * second) * (at.y * second),
        )
    }
}

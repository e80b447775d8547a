//! A triangle, ready for rays.

use super::bvh::Line;
use crate::shape::{Material, Mesh};
use nalgebra::{Point3, Vector3};

/// Triangles reach this much beyond their edges (part of an edge): a ray at the seam of two meets at least one.
const SEAM: f64 = 1e-12;
/// A ray this close to a triangle's plane (sine of the angle) sees none of it, and would find it anywhere by rounding.
const EDGE_ON: f64 = 1e-10;

/// A triangle with area.
#[derive(Clone, Copy, Debug)]
pub(super) struct Facet {
    corner: Point3<f64>,
    /// From that corner to the two others.
    sides: [Vector3<f64>; 2],
    /// Below this a determinant means edge-on.
    edge_on: f64,
    /// Its place in the mesh.
    pub(super) place: u32,
    pub(super) material: Material,
}

impl Facet {
    /// The mesh's triangles in order; those without area, or with corners that are not there, cannot be seen.
    pub(super) fn all(mesh: &Mesh) -> impl Iterator<Item = Self> + '_ {
        mesh.triangles.iter().zip(0..).filter_map(|(triangle, place)| {
            let [a, b, c] = mesh.corners(triangle)?;
            let sides = [b - a, c - a];
            let doubled_area = (b - a).cross(&(c - a)).norm();
            let seen = doubled_area > 0.0 && doubled_area.is_finite() && a.coords.iter().all(|x| x.is_finite());
            let edge_on = doubled_area * EDGE_ON;
            seen.then_some(Self { corner: a, sides, edge_on, place, material: triangle.material })
        })
    }

    pub(super) fn corners(&self) -> [Point3<f64>; 3] {
        let [ab, ac] = self.sides;
        [self.corner, self.corner + ab, self.corner + ac]
    }

    /// Outward, length 1, body frame.
    pub(super) fn normal(&self) -> Vector3<f64> {
        let [ab, ac] = self.sides;
        ab.cross(&ac).normalize()
    }

    /// Where a line meets it (Möller and Trumbore 1997), from either side; negative behind the origin.
    pub(super) fn range(&self, line: &Line) -> Option<f64> {
        let [ab, ac] = &self.sides;
        let p = line.direction.cross(ac);
        let determinant = ab.dot(&p);
        if determinant.abs() <= self.edge_on {
            return None;
        }
        let scale = 1.0 / determinant;
        let from_corner = line.origin - self.corner;
        let u = from_corner.dot(&p) * scale;
        if !(-SEAM..=1.0 + SEAM).contains(&u) {
            return None;
        }
        let q = from_corner.cross(ab);
        let v = line.direction.dot(&q) * scale;
        (v >= -SEAM && u + v <= 1.0 + SEAM).then(|| ac.dot(&q) * scale)
    }
}

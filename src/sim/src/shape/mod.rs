//! Triangle meshes and what their surfaces are made of.

#[cfg(test)]
pub(crate) mod measure;
pub mod solid;

use nalgebra::{Isometry3, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What a surface is made of, as the sensors see it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Material {
    /// Light and diffuse: returns at every incidence.
    #[default]
    Matt,
    /// Black: weak returns, and few at range or grazing incidence.
    Dark,
    /// Metal foil: bright near normal incidence, nothing or clutter beyond.
    Foil,
}

/// A triangle by its corners' places in [`Mesh::vertices`], counter-clockwise seen from outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Triangle {
    /// The corners.
    pub corners: [u32; 3],
    /// What it is made of.
    pub material: Material,
}

/// A body's surface in its own frame, metres.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mesh {
    /// Corners of the triangles.
    pub vertices: Vec<Point3<f64>>,
    /// The triangles. Each one's corners are places in `vertices`.
    pub triangles: Vec<Triangle>,
}

impl Mesh {
    /// Adds another mesh, moved.
    pub fn add(&mut self, other: &Self, placed: &Isometry3<f64>) {
        let first = self.vertices.len() as u32;
        self.vertices.extend(other.vertices.iter().map(|vertex| placed * vertex));
        self.triangles.extend(other.triangles.iter().map(|triangle| Triangle {
            corners: triangle.corners.map(|corner| corner + first),
            material: triangle.material,
        }));
    }

    /// A triangle's corners; `None` where it names a vertex that is not there.
    pub fn corners(&self, triangle: &Triangle) -> Option<[Point3<f64>; 3]> {
        let [a, b, c] = triangle.corners.map(|corner| self.vertices.get(corner as usize).copied());
        Some([a?, b?, c?])
    }

    /// The lowest and the highest coordinates, m; of no vertex: both the origin.
    pub fn extents(&self) -> [Point3<f64>; 2] {
        let first = self.vertices.first().copied().unwrap_or_else(Point3::origin);
        self.vertices.iter().fold([first, first], |[low, high], vertex| [low.inf(vertex), high.sup(vertex)])
    }

    /// Its longest extent along x, y or z, m.
    pub fn size_m(&self) -> f64 {
        let [low, high] = self.extents();
        (high - low).amax()
    }

    /// Every coordinate multiplied, so that the origin stays in its place.
    pub fn scale(&mut self, factor: f64) {
        self.vertices.iter_mut().for_each(|vertex| *vertex *= factor);
    }

    /// A sphere about the body's origin that holds it: its radius, m.
    pub fn radius(&self) -> f64 {
        self.vertices.iter().map(|vertex| vertex.coords.norm()).fold(0.0, f64::max)
    }
}

/// The outward normal of a triangle, length 1; zero for one without area.
pub fn normal([a, b, c]: [Point3<f64>; 3]) -> Vector3<f64> {
    (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_default()
}

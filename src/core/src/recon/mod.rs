//! The target's surface from what was registered: planes, points without their scatter across them, and the contour
//! (method.md §6).
//!
//! ```text
//!   registered frames ─▶ fuse ─▶ points ─▶ grow, merge ─▶ planes ─┬▶ flatten: points on their planes
//!                                                                 ├▶ crease: where two planes meet ────┐
//!                                                                 └▶ raster, rim, boundary: where one ends ─┴▶ contour
//! ```
//!
//! * [`fuse()`]: points of frames, one for each bit of surface, by their inverse variances;
//! * [`plane`]: a plane, how well it is known, and where it has points;
//! * [`contour`]: edges of the contour; [`score`]: a model held against the true surface.
//!
//! All in the target's frame, metres. The same points give the same result to the bit.

mod boundary;
pub mod contour;
mod crease;
pub mod fuse;
mod grow;
mod line_up;
mod moments;
pub mod plane;
mod raster;
mod rim;
pub mod score;
mod span;
#[cfg(test)]
mod tests;

pub use contour::{Edge, EdgeKind};
pub use fuse::{Fused, FusedPoint, RegisteredFrame, Sighting, fuse};
pub use plane::FoundPlane;

use crate::neighbours::{KdTree, Neighbours};
use nalgebra::{Point3, Vector3};

/// How a surface is made of points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReconSettings {
    /// How rough the surfaces themselves are, σ_s, m: so much of a point's distance from its plane is left. 0: points are
    /// put on their planes.
    pub surface_sigma_m: f64,
    /// What is left of the sensors' slow errors after fusing, m: added to every point's own σ where planes are found.
    pub slow_sigma_m: f64,
    /// Points of a plane, at least.
    pub least_points: usize,
    /// Whether planes are found at all; without them points stay as they are, and there is no contour.
    pub planes: bool,
}

impl Default for ReconSettings {
    fn default() -> Self {
        Self { surface_sigma_m: 0.002, slow_sigma_m: 0.003, least_points: 40, planes: true }
    }
}

/// A target's surface.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reconstruction {
    /// The points, those of planes with what of their scatter is noise taken away.
    pub points: Vec<FusedPoint>,
    /// Each point's plane, by its place in `planes`; `None`: it is on none, and as it was measured.
    pub plane_of: Vec<Option<u32>>,
    /// The planes, the one with the most points first.
    pub planes: Vec<FoundPlane>,
    /// The contour: creases first, longest first.
    pub edges: Vec<Edge>,
    /// Spacing of the points, m.
    pub spacing_m: f64,
}

/// Points nearer than this, m, are the same to every sensor.
const LEAST_SPACING_M: f64 = 1e-3;
/// A point off its plane by more than this many σ is other structure, and stays.
const OTHER_STRUCTURE: f64 = 3.0;
/// A point faces as its plane does: the least cosine of their normals, for one that is laid on a plane found without it.
const SAME_FACING: f64 = 0.5;

/// Planes, points without scatter, and the contour. `frames`: those that the points were fused of, by which boundaries are drawn
/// sharper than by the points; none: they are drawn by the points.
pub fn reconstruct(points: &[FusedPoint], frames: &[RegisteredFrame], settings: &ReconSettings) -> Reconstruction {
    let places: Vec<Point3<f32>> = points.iter().map(|point| point.place.cast()).collect();
    let tree = KdTree::build(&places);
    let spacing_m = spacing_m(&tree, &places);
    let mut made = Reconstruction {
        points: points.to_vec(),
        plane_of: vec![None; points.len()],
        planes: Vec::new(),
        edges: Vec::new(),
        spacing_m,
    };
    if !settings.planes {
        return made;
    }
    made.planes = grow::planes(points, &tree, spacing_m, settings);
    for (plane, number) in made.planes.iter().zip(0u32..) {
        for member in &plane.members {
            if let Some(of) = made.plane_of.get_mut(*member as usize) {
                *of = Some(number);
            }
        }
    }
    for (point, of) in made.points.iter_mut().zip(&made.plane_of) {
        let Some(plane) = of.and_then(|number| made.planes.get(number as usize)) else { continue };
        let sigma_m = libm::hypot(point.sigma_m, settings.slow_sigma_m);
        point.place = without_scatter(plane, &point.place, sigma_m, settings.surface_sigma_m);
    }
    made.edges = contour::edges(&made, frames, settings);
    made
}

/// The spacing of points on a surface, m: the median distance to the fourth nearest other one. In a square grid it is the grid's,
/// of points scattered at random 1.1 times the root of a point's share of the area. At least 1 mm.
fn spacing_m(tree: &KdTree, places: &[Point3<f32>]) -> f64 {
    let mut near = Neighbours::with_capacity(5);
    let mut fourth: Vec<f32> = Vec::with_capacity(places.len());
    for place in places.iter().filter(|place| place.iter().all(|c| c.is_finite())) {
        tree.knn(place, 5, &mut near);
        fourth.extend(near.iter().map(|(_, squared)| squared).max_by(f32::total_cmp));
    }
    let middle = fourth.len() / 2;
    if fourth.is_empty() {
        return LEAST_SPACING_M;
    }
    let median = f64::from(*fourth.select_nth_unstable_by(middle, f32::total_cmp).1);
    libm::sqrt(median).max(LEAST_SPACING_M)
}

impl Reconstruction {
    /// A measured point without its scatter across the plane it lies on; `normal`: towards the side it was seen from,
    /// `sigma_m`: its standard deviation along that normal. `None`: it is on no plane, or off it by more than three σ.
    pub fn flatten(
        &self,
        place: &Point3<f64>,
        normal: &Vector3<f64>,
        sigma_m: f64,
        settings: &ReconSettings,
    ) -> Option<(u32, Point3<f64>)> {
        let reach = OTHER_STRUCTURE * sigma_m.max(settings.slow_sigma_m);
        let mut best: Option<(f64, u32)> = None;
        for (plane, number) in self.planes.iter().zip(0u32..) {
            let off = plane.height(place).abs();
            let is_on = off <= reach && plane.normal.dot(normal) > SAME_FACING && plane.covers(place);
            if is_on && best.is_none_or(|(least, _)| off < least) {
                best = Some((off, number));
            }
        }
        let (_, number) = best?;
        let plane = self.planes.get(number as usize)?;
        Some((number, without_scatter(plane, place, sigma_m, settings.surface_sigma_m)))
    }

    /// How thick the planes are: 1.4826 times the median distance of their points, m, with the given points' places.
    /// `None`: no point is on a plane.
    pub fn thickness_m(&self, points: &[FusedPoint]) -> Option<f64> {
        let off = points.iter().zip(&self.plane_of).filter_map(|(point, of)| {
            let plane = self.planes.get((*of)? as usize)?;
            Some(plane.height(&point.place).abs())
        });
        robust_sigma(off.collect())
    }
}

/// 1.4826 times the median of distances: the σ of a normal distribution with that median. `None`: of none.
pub fn robust_sigma(mut distances: Vec<f64>) -> Option<f64> {
    let middle = distances.len() / 2;
    if distances.is_empty() {
        return None;
    }
    let (_, median, _) = distances.select_nth_unstable_by(middle, f64::total_cmp);
    Some(1.4826 * *median)
}

/// δ' = δ σ_s² / (σ_s² + σ²): what is expected of the true height where surface and noise are normal.
fn without_scatter(plane: &FoundPlane, place: &Point3<f64>, sigma_m: f64, surface_sigma_m: f64) -> Point3<f64> {
    let height = plane.height(place);
    if height.abs() > OTHER_STRUCTURE * sigma_m {
        return *place;
    }
    let (own, noise) = (surface_sigma_m * surface_sigma_m, sigma_m * sigma_m);
    let kept = if own + noise > 0.0 { own / (own + noise) } else { 1.0 };
    place + plane.normal * (height * (kept - 1.0))
}

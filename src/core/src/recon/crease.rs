//! Creases: where two planes meet, the line π₁ ∧ π₂ of G(4,1).

use super::contour::{Edge, EdgeKind};
use super::fuse::steady;
use super::plane::FoundPlane;
use super::span::{covered, shared};
use super::{FusedPoint, Reconstruction};
use crate::cga::Plane;
use nalgebra::{Point3, Vector3};

/// Planes that meet at less than this have no line: sin 8°.
const LEAST_SINE: f64 = 0.139_173_101;
/// Both planes have points so near the line, in spacings; and along it without greater gaps than this.
const NEAR: f64 = 2.0;
const GAP: f64 = 4.0;
/// The shortest, m: a strut's width where it meets a wall is none.
const SHORTEST_M: f64 = 0.05;
/// An end so near a third plane's points, in spacings, is the corner of the three.
const CORNER: f64 = 3.5;
/// A third plane crosses the line at no smaller sine.
const CROSSING: f64 = 0.35;

/// A line: a unit direction and the place on it nearest the origin.
pub(super) struct Line {
    pub(super) direction: Vector3<f64>,
    pub(super) place: Point3<f64>,
}

/// The line of two planes. π₁ ∧ π₂ has the bivector n₁ ∧ n₂, whose dual n₁ × n₂ is the line's direction l, and the part
/// m ∧ e∞, m = d₂ n₁ − d₁ n₂, which places it: the point nearest the origin is (l × m) / |l|². `None`: they meet at less than 8°.
pub(super) fn meet(first: &Plane<f64>, second: &Plane<f64>) -> Option<Line> {
    let along = first.normal().cross(&second.normal());
    let sine = along.norm();
    if sine < LEAST_SINE {
        return None;
    }
    let moment = first.normal() * second.height_over_origin() - second.normal() * first.height_over_origin();
    let place = Point3::from(along.cross(&moment) / (sine * sine));
    Some(Line { direction: along / sine, place })
}

/// The creases of all pairs of planes.
pub(super) fn creases(made: &Reconstruction) -> Vec<Edge> {
    let numbered: Vec<(&FoundPlane, u32)> = made.planes.iter().zip(0u32..).collect();
    let mut creases = Vec::new();
    for ((first, a), at) in numbered.iter().zip(1..) {
        for (second, b) in numbered.iter().skip(at) {
            let Some(line) = meet(&first.conformal(), &second.conformal()) else { continue };
            let near = NEAR * made.spacing_m;
            let on = |plane: &FoundPlane| covered(along(&made.points, plane, &line, near), GAP * made.spacing_m);
            for (from, to) in shared(&on(first), &on(second)) {
                // The outermost points lie half a spacing inside on the average.
                let ends = [(from, -0.5), (to, 0.5)].map(|(at, side)| {
                    let at = at + side * made.spacing_m;
                    corner(made, [*a, *b], &line, at).unwrap_or(at)
                });
                let [from, to] = ends;
                if to - from < SHORTEST_M {
                    continue;
                }
                let ends = ends.map(|at| line.place + line.direction * at);
                let crease = edge(first, second, [*a, *b], &line, ends);
                if crease.direction_sigma_rad <= super::boundary::VAGUE_RAD {
                    creases.push(crease);
                }
            }
        }
    }
    creases
}

/// Where along a line a plane's points near it lie.
fn along(points: &[FusedPoint], plane: &FoundPlane, line: &Line, near: f64) -> Vec<f64> {
    let at = steady(points, &plane.members).filter_map(|point| {
        let from = point.place - line.place;
        let at = from.dot(&line.direction);
        (from.norm_squared() - at * at <= near * near).then_some(at)
    });
    at.collect()
}

/// Where a third plane with points near cuts the line near an end.
fn corner(made: &Reconstruction, planes: [u32; 2], line: &Line, at: f64) -> Option<f64> {
    let mut best: Option<(f64, f64)> = None;
    for (plane, number) in made.planes.iter().zip(0u32..) {
        let slope = plane.normal.dot(&line.direction);
        if planes.contains(&number) || slope.abs() < CROSSING {
            continue;
        }
        let cut = -plane.height(&line.place) / slope;
        let place = line.place + line.direction * cut;
        let off = (cut - at).abs();
        let is_near = off <= CORNER * made.spacing_m && plane.raster.is_near(&plane.in_plane(&place), 3);
        if is_near && best.is_none_or(|(least, _)| off < least) {
            best = Some((off, cut));
        }
    }
    best.map(|(_, cut)| cut)
}

fn edge(first: &FoundPlane, second: &FoundPlane, planes: [u32; 2], line: &Line, ends: [Point3<f64>; 2]) -> Edge {
    let sine = first.normal.cross(&second.normal).norm();
    let middle = nalgebra::center(&ends[0], &ends[1]);
    let both = |of: &dyn Fn(&FoundPlane) -> f64| {
        let (a, b) = (of(first), of(second));
        libm::sqrt(a * a + b * b) / sine
    };
    let tilt = |plane: &FoundPlane| {
        let [u, v] = plane.tangents.map(|tangent| tangent.dot(&line.direction));
        let [a, b] = plane.tilt_sigma_rad;
        libm::hypot(u * a, v * b)
    };
    Edge {
        kind: EdgeKind::Crease,
        ends,
        planes: planes.to_vec(),
        angle_rad: Some(libm::acos(first.normal.dot(&second.normal).clamp(-1.0, 1.0))),
        sigma_m: both(&|plane| plane.sigma_at_m(&middle)),
        direction_sigma_rad: both(&tilt),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Unit;

    #[test]
    fn the_line_of_two_planes_lies_on_both() {
        let plane = |n: Vector3<f64>, d| Plane::new(&Unit::new_normalize(n), d);
        let (a, b) = (plane(Vector3::new(1.0, 0.2, -0.3), 0.4), plane(Vector3::new(-0.1, 1.0, 0.5), -0.7));
        let line = meet(&a, &b).unwrap();
        for at in [-2.0, 0.0, 3.5] {
            let place = line.place + line.direction * at;
            assert!((a.normal().dot(&place.coords) - 0.4).abs() < 1e-12);
            assert!((b.normal().dot(&place.coords) + 0.7).abs() < 1e-12);
        }
        // Nearest to the origin: across the direction.
        assert!(line.place.coords.dot(&line.direction).abs() < 1e-12);
        // 5° apart: no line.
        let tilted = plane(Vector3::new(1.0, 0.2 + 0.09, -0.3), 0.4);
        assert!(meet(&a, &tilted).is_none());
    }
}

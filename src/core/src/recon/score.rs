//! A model held against the surface it is of.

use super::{Edge, EdgeKind};
use nalgebra::{Isometry3, Matrix6, Point3, Vector3, Vector6};
use tumbled_model::Twist;

/// An edge lies on a true one within this, m, and within this angle: cos 1°.
const SAME_EDGE_M: f64 = 0.015;
const SAME_EDGE_COSINE: f64 = 0.999_847_695;
/// Edges are compared in steps of this, m.
const STEP_M: f64 = 0.005;
/// Rounds of laying a model on the surface.
const ROUNDS: usize = 12;
/// A point farther from the surface than this, m, does not pull.
const PULL_M: f64 = 0.03;

/// A triangle with its outward unit normal and a ball that holds it.
#[derive(Clone, Copy, Debug)]
struct Facet {
    corners: [Point3<f64>; 3],
    normal: Vector3<f64>,
    middle: Point3<f64>,
    radius: f64,
}

/// A true surface of triangles.
#[derive(Clone, Debug, Default)]
pub struct TrueSurface {
    facets: Vec<Facet>,
}

/// A straight true edge.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrueEdge {
    /// Its ends, m.
    pub ends: [Point3<f64>; 2],
}

impl TrueSurface {
    /// Of triangles, counter-clockwise seen from outside; those without area are left out.
    pub fn new(triangles: impl Iterator<Item = [Point3<f64>; 3]>) -> Self {
        let facet = |corners: [Point3<f64>; 3]| {
            let [a, b, c] = corners;
            let normal = (b - a).cross(&(c - a)).try_normalize(1e-12)?;
            let middle = Point3::from((a.coords + b.coords + c.coords) / 3.0);
            let radius = corners.iter().map(|corner| (corner - middle).norm()).fold(0.0, f64::max);
            Some(Facet { corners, normal, middle, radius })
        };
        Self { facets: triangles.filter_map(facet).collect() }
    }

    /// The nearest place of the surface, and the outward normal there. `None`: there is no surface.
    pub fn nearest(&self, place: &Point3<f64>) -> Option<(Point3<f64>, Vector3<f64>)> {
        let mut best: Option<(f64, Point3<f64>, Vector3<f64>)> = None;
        for facet in &self.facets {
            let least = (place - facet.middle).norm() - facet.radius;
            if best.is_some_and(|(off, ..)| least >= off) {
                continue;
            }
            let on = facet.nearest(place);
            let off = (on - place).norm();
            if best.is_none_or(|(least, ..)| off < least) {
                best = Some((off, on, facet.normal));
            }
        }
        best.map(|(_, on, normal)| (on, normal))
    }

    /// How far a place is from the surface, m. Infinite where there is none.
    pub fn distance_m(&self, place: &Point3<f64>) -> f64 {
        self.nearest(place).map_or(f64::INFINITY, |(on, _)| (on - place).norm())
    }

    /// The pose (model's frame to the surface's) at which points lie best on the surface, from a pose near it: a model's frame is
    /// its own choice. Point to plane, with a kernel.
    pub fn aligned(&self, points: &[Point3<f64>], start: &Isometry3<f64>) -> Isometry3<f64> {
        let mut pose = *start;
        for _ in 0..ROUNDS {
            let (mut square, mut pull) = (Matrix6::<f64>::zeros(), Vector6::zeros());
            for point in points {
                let place = pose * point;
                let Some((on, _)) = self.nearest(&place) else { return pose };
                let off = place - on;
                let length = off.norm();
                if length >= PULL_M || length <= 1e-9 {
                    continue;
                }
                let normal = off / length;
                let arm = place.coords.cross(&normal);
                let row = Vector6::new(arm.x, arm.y, arm.z, normal.x, normal.y, normal.z);
                let kernel = 1.0 / (1.0 + length * length / (0.005 * 0.005));
                square += row * row.transpose() * (kernel * kernel);
                pull += row * (kernel * kernel * length);
            }
            let Some(step) = (square + Matrix6::identity() * 1e-9).cholesky().map(|lower| lower.solve(&pull)) else {
                return pose;
            };
            pose = Twist::from_vector(&-step).exp() * pose;
        }
        pose
    }

    /// Where facets of different parts cut each other: edges that no triangle has.
    pub fn cuts(&self) -> Vec<TrueEdge> {
        let mut cuts = Vec::new();
        for (a, at) in self.facets.iter().zip(1..) {
            for b in self.facets.iter().skip(at) {
                let apart = (a.middle - b.middle).norm() > a.radius + b.radius;
                if apart || a.normal.cross(&b.normal).norm() < 0.1 {
                    continue;
                }
                let places: Vec<Point3<f64>> = a.pierced_by(b).into_iter().chain(b.pierced_by(a)).collect();
                let Some(first) = places.first() else { continue };
                let far = |from: &Point3<f64>| {
                    places.iter().copied().max_by(|a, b| (a - from).norm().total_cmp(&(b - from).norm()))
                };
                let Some(from) = far(first) else { continue };
                let Some(to) = far(&from) else { continue };
                if (to - from).norm() > 1e-3 {
                    cuts.push(TrueEdge { ends: [from, to] });
                }
            }
        }
        cuts
    }
}

impl Facet {
    fn nearest(&self, place: &Point3<f64>) -> Point3<f64> {
        let foot = place - self.normal * self.normal.dot(&(place - self.corners[0]));
        if self.holds(&foot) {
            return foot;
        }
        let [a, b, c] = self.corners;
        let on_side = |from: Point3<f64>, to: Point3<f64>| {
            let way = to - from;
            from + way * ((place - from).dot(&way) / way.norm_squared()).clamp(0.0, 1.0)
        };
        let near = |on: &Point3<f64>| (on - place).norm_squared();
        let [x, y, z] = [on_side(a, b), on_side(b, c), on_side(c, a)];
        let best = if near(&x) <= near(&y) { x } else { y };
        if near(&best) <= near(&z) { best } else { z }
    }

    /// Whether a place in its plane lies within it.
    fn holds(&self, place: &Point3<f64>) -> bool {
        let [a, b, c] = self.corners;
        [(a, b), (b, c), (c, a)].iter().all(|(from, to)| (to - from).cross(&(place - from)).dot(&self.normal) >= -1e-12)
    }

    /// Where the sides of another one pass through it.
    fn pierced_by(&self, other: &Self) -> Vec<Point3<f64>> {
        let [a, b, c] = other.corners;
        let through = |(from, to): (Point3<f64>, Point3<f64>)| {
            let [above, below] = [from, to].map(|end| self.normal.dot(&(end - self.corners[0])));
            if (above > 0.0) == (below > 0.0) {
                return None;
            }
            let place = from + (to - from) * (above / (above - below));
            self.holds(&place).then_some(place)
        };
        [(a, b), (b, c), (c, a)].into_iter().filter_map(through).collect()
    }
}

impl TrueEdge {
    /// m.
    pub fn length_m(&self) -> f64 {
        (self.ends[1] - self.ends[0]).norm()
    }

    /// Places along it, 5 mm apart.
    pub fn places(&self) -> impl Iterator<Item = Point3<f64>> + '_ {
        steps(&self.ends)
    }

    fn is_near(&self, place: &Point3<f64>, direction: &Vector3<f64>) -> bool {
        let way = self.ends[1] - self.ends[0];
        let Some(along) = way.try_normalize(1e-12) else { return false };
        if along.dot(direction).abs() < SAME_EDGE_COSINE {
            return false;
        }
        let at = ((place - self.ends[0]).dot(&along)).clamp(0.0, way.norm());
        (place - (self.ends[0] + along * at)).norm() <= SAME_EDGE_M
    }
}

fn steps(ends: &[Point3<f64>; 2]) -> impl Iterator<Item = Point3<f64>> + '_ {
    let way = ends[1] - ends[0];
    let count = libm::ceil(way.norm() / STEP_M).max(1.0) as usize;
    (0..count).map(move |step| ends[0] + way * ((step as f64 + 0.5) / count as f64))
}

/// Shares by length: of found edges (creases and boundaries, at a pose) on true ones within 1.5 cm and 1°; of places of true edges,
/// with their directions, on found ones likewise. `None`: of none.
pub fn precision_recall(
    found: &[Edge],
    pose: &Isometry3<f64>,
    all_true: &[TrueEdge],
    seen: &[(Point3<f64>, Vector3<f64>)],
) -> (Option<f64>, Option<f64>) {
    let published = found.iter().filter(|edge| edge.kind != EdgeKind::Occlusion);
    let edges: Vec<TrueEdge> = published.map(|edge| TrueEdge { ends: edge.ends.map(|end| pose * end) }).collect();
    let (mut right, mut count) = (0usize, 0usize);
    for edge in &edges {
        let Some(direction) = (edge.ends[1] - edge.ends[0]).try_normalize(1e-12) else { continue };
        for place in edge.places() {
            count += 1;
            right += usize::from(all_true.iter().any(|other| other.is_near(&place, &direction)));
        }
    }
    let hit = seen.iter().filter(|(place, direction)| edges.iter().any(|edge| edge.is_near(place, direction))).count();
    let share = |part: usize, of: usize| (of > 0).then(|| part as f64 / of as f64);
    (share(right, count), share(hit, seen.len()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of 1 m in z = 0, and one that stands through its middle along y.
    fn squares() -> TrueSurface {
        let square = |a: Point3<f64>, u: Vector3<f64>, v: Vector3<f64>| [[a, a + u, a + u + v], [a, a + u + v, a + v]];
        let flat = square(Point3::origin(), Vector3::x(), Vector3::y());
        let standing = square(Point3::new(0.5, 0.2, -0.3), Vector3::y() * 0.6, Vector3::z() * 0.6);
        TrueSurface::new(flat.into_iter().chain(standing))
    }

    #[test]
    fn distances_are_to_the_inside_the_sides_and_the_corners_of_triangles() {
        let flat = TrueSurface { facets: squares().facets[..2].to_vec() };
        assert!((flat.distance_m(&Point3::new(0.3, 0.2, -0.4)) - 0.4).abs() < 1e-12);
        assert!((flat.distance_m(&Point3::new(1.3, 0.2, 0.4)) - 0.5).abs() < 1e-12);
        assert!((flat.distance_m(&Point3::new(2.0, 2.0, 0.0)) - libm::sqrt(2.0)).abs() < 1e-12);
        assert_eq!(TrueSurface::default().distance_m(&Point3::origin()), f64::INFINITY);
    }

    #[test]
    fn parts_that_stand_in_each_other_have_the_edge_where_they_do() {
        // x = 0.5, z = 0, y from 0.2 to 0.8, in pieces.
        let cuts = squares().cuts();
        let length: f64 = cuts.iter().map(TrueEdge::length_m).sum();
        assert!((length - 0.6).abs() < 1e-9, "{cuts:?}");
        assert!(cuts.iter().flat_map(|cut| cut.ends).all(|end| (end.x - 0.5).abs() < 1e-12 && end.z.abs() < 1e-12));
    }

    #[test]
    fn an_edge_counts_within_1_5_cm_and_1_degree() {
        let edge = |turn_deg: f64, aside_m: f64| {
            let along = Vector3::new(libm::cos(turn_deg.to_radians()), libm::sin(turn_deg.to_radians()), 0.0) * 0.4;
            let from = Point3::new(-0.2, aside_m, 0.0);
            Edge {
                kind: EdgeKind::Crease,
                ends: [from, from + along],
                planes: vec![0, 1],
                angle_rad: None,
                sigma_m: 0.0,
                direction_sigma_rad: 0.0,
            }
        };
        let truth = TrueEdge { ends: [Point3::new(-0.2, 0.0, 0.0), Point3::new(0.2, 0.0, 0.0)] };
        let seen: Vec<_> = truth.places().map(|place| (place, Vector3::x())).collect();
        let score = |edge: Edge| precision_recall(&[edge], &Isometry3::identity(), &[truth], &seen);
        assert_eq!(score(edge(0.9, 0.002)), (Some(1.0), Some(1.0)));
        assert_eq!(score(edge(1.1, 0.002)), (Some(0.0), Some(0.0)));
        assert_eq!(score(edge(0.0, 0.016)), (Some(0.0), Some(0.0)));
        let (precision, recall) = precision_recall(&[], &Isometry3::identity(), &[truth], &seen);
        assert_eq!((precision, recall), (None, Some(0.0)));
    }
}

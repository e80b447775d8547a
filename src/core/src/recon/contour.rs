//! The contour: creases and boundaries, each edge once.

use super::boundary;
use super::crease;
use super::rim::Rim;
use super::{ReconSettings, Reconstruction, RegisteredFrame};
use nalgebra::{Point3, Vector3};

/// What an edge is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum EdgeKind {
    /// Where two planes meet.
    Crease,
    /// Where a plane ends, seen from directions 20° or more apart.
    Boundary,
    /// Where the points of a plane end, from one direction only: something in front may have hidden what goes on.
    Occlusion,
}

/// A straight edge, target's frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Edge {
    /// What it is.
    pub kind: EdgeKind,
    /// Where it begins and ends, m.
    pub ends: [Point3<f64>; 2],
    /// The planes it belongs to, by number, rising: two of a crease.
    pub planes: Vec<u32>,
    /// Of a crease: between the planes' normals, rad.
    pub angle_rad: Option<f64>,
    /// Across it, at its middle: one standard deviation, m.
    pub sigma_m: f64,
    /// Of its direction, rad.
    pub direction_sigma_rad: f64,
}

impl Edge {
    /// m.
    pub fn length_m(&self) -> f64 {
        (self.ends[1] - self.ends[0]).norm()
    }

    /// Unit, from its first end to its second.
    pub fn direction(&self) -> Vector3<f64> {
        (self.ends[1] - self.ends[0]).try_normalize(1e-12).unwrap_or_else(Vector3::x)
    }

    /// How far a place is from it, m.
    pub fn distance_m(&self, place: &Point3<f64>) -> f64 {
        let [from, to] = &self.ends;
        let way = to - from;
        let at = ((place - from).dot(&way) / way.norm_squared().max(1e-18)).clamp(0.0, 1.0);
        (place - (from + way * at)).norm()
    }

    fn point(&self, at: f64) -> Point3<f64> {
        self.ends[0] + self.direction() * at
    }
}

/// A boundary so near a crease, m, and so parallel to it, cos 15°, is the crease.
const IS_CREASE_M: f64 = 0.025;
const IS_CREASE_COSINE: f64 = 0.965_925_826;
/// A boundary is looked at in steps of this, m; what is left of one is at least so long.
const STEP_M: f64 = 0.005;
const SHORTEST_M: f64 = 0.04;
/// Edges within 5°, 2 cm across and 5 cm along are one.
const MERGED_COSINE: f64 = 0.996_194_698;
const MERGED_ASIDE_M: f64 = 0.02;
const MERGED_GAP_M: f64 = 0.05;

/// All edges: creases, what of the boundaries is none, pieces of one edge joined; creases first, then the longest.
pub(super) fn edges(made: &Reconstruction, frames: &[RegisteredFrame], settings: &ReconSettings) -> Vec<Edge> {
    let creases = merged(crease::creases(made));
    let ends = made.planes.iter().zip(0u32..).flat_map(|(plane, number)| {
        let rim = Rim::of(made, plane, frames, settings);
        boundary::boundaries(&rim, plane, number)
    });
    let ends: Vec<Edge> = ends.flat_map(|edge| without(&edge, &creases)).collect();
    let mut edges = creases;
    edges.extend(merged(ends));
    edges.sort_by(|a, b| {
        let rest = |edge: &Edge| edge.kind != EdgeKind::Crease;
        rest(a).cmp(&rest(b)).then(b.length_m().total_cmp(&a.length_m())).then(a.planes.cmp(&b.planes))
    });
    edges
}

/// The parts of a boundary that are no crease.
fn without(edge: &Edge, creases: &[Edge]) -> Vec<Edge> {
    let direction = edge.direction();
    let parallel: Vec<&Edge> =
        creases.iter().filter(|crease| crease.direction().dot(&direction).abs() > IS_CREASE_COSINE).collect();
    if parallel.is_empty() {
        return vec![edge.clone()];
    }
    let steps = (edge.length_m() / STEP_M) as usize;
    let left = (0..=steps).map(|step| step as f64 * STEP_M).filter(|at| {
        let place = edge.point(*at);
        parallel.iter().all(|crease| crease.distance_m(&place) > IS_CREASE_M)
    });
    let spans = super::span::covered(left.collect(), 1.5 * STEP_M);
    let long = spans.into_iter().filter(|(from, to)| to - from >= SHORTEST_M);
    long.map(|(from, to)| Edge { ends: [edge.point(from), edge.point(to)], ..edge.clone() }).collect()
}

/// Joins edges that are one, the longest first, until none are left.
fn merged(mut edges: Vec<Edge>) -> Vec<Edge> {
    loop {
        edges.sort_by(|a, b| b.length_m().total_cmp(&a.length_m()).then(a.planes.cmp(&b.planes)));
        let before = edges.len();
        let mut kept: Vec<Edge> = Vec::with_capacity(before);
        for edge in edges {
            match kept.iter_mut().find(|other| are_one(other, &edge)) {
                Some(other) => *other = joined(other, &edge),
                None => kept.push(edge),
            }
        }
        if kept.len() == before {
            return kept;
        }
        edges = kept;
    }
}

fn are_one(long: &Edge, short: &Edge) -> bool {
    let direction = long.direction();
    if short.direction().dot(&direction).abs() < MERGED_COSINE {
        return false;
    }
    let along = short.ends.map(|end| (end - long.ends[0]).dot(&direction));
    let aside = short.ends.iter().zip(along).all(|(end, at)| (end - long.point(at)).norm() < MERGED_ASIDE_M);
    let (from, to) = (along[0].min(along[1]), along[0].max(along[1]));
    aside && from <= long.length_m() + MERGED_GAP_M && to >= -MERGED_GAP_M
}

/// One edge of two: direction and place by their inverse variances, from the first end to the last.
fn joined(long: &Edge, short: &Edge) -> Edge {
    let weight = |sigma: f64| 1.0 / (sigma * sigma).max(1e-18);
    let turns = [long, short].map(|edge| weight(edge.direction_sigma_rad));
    let flipped = if short.direction().dot(&long.direction()) < 0.0 { -1.0 } else { 1.0 };
    let direction = long.direction() * turns[0] + short.direction() * (flipped * turns[1]);
    let direction = direction.try_normalize(1e-12).unwrap_or_else(|| long.direction());
    let middle = |edge: &Edge| nalgebra::center(&edge.ends[0], &edge.ends[1]);
    let [a, b] = [long, short].map(|edge| weight(edge.sigma_m));
    let place = middle(long) + (middle(short) - middle(long)) * (b / (a + b));
    let ends = long.ends.iter().chain(&short.ends).map(|end| (end - place).dot(&direction));
    let (from, to) = ends.fold((f64::INFINITY, f64::NEG_INFINITY), |(from, to), at| (from.min(at), to.max(at)));
    let mut planes = [long.planes.clone(), short.planes.clone()].concat();
    planes.sort_unstable();
    planes.dedup();
    Edge {
        kind: long.kind.min(short.kind),
        ends: [place + direction * from, place + direction * to],
        planes,
        angle_rad: long.angle_rad,
        // What bent one may have bent the other: no better than the better one.
        sigma_m: long.sigma_m.min(short.sigma_m),
        direction_sigma_rad: long.direction_sigma_rad.min(short.direction_sigma_rad),
    }
}

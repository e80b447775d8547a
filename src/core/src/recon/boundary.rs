//! Boundaries: where a plane's points end.

use super::contour::{Edge, EdgeKind};
use super::line_up::lined_up;
use super::plane::FoundPlane;
use super::rim::{Rim, Strip};
use nalgebra::{Point2, Vector2};

/// An outline is split where it is off its chord by so many cells (Douglas and Peucker 1973).
const SPLIT: f64 = 2.5;
/// The shortest side, m.
const SHORTEST_M: f64 = 0.04;
/// Points this far inside and outside a side belong to it, in cells.
const INSIDE: f64 = 3.0;
const OUTSIDE: f64 = 1.5;
/// A side with points beyond it, up to so many cells away, along so much of it, is a gap in what was seen. A strut that goes on from a
/// plate is none.
const BEYOND: f64 = 8.0;
const GOES_ON: f64 = 0.35;
/// A line is published where its direction is known to 1° with 95 %: one standard deviation of half a degree, rad.
pub(super) const VAGUE_RAD: f64 = 0.008_727;
/// The outermost points lie a quarter of a spacing inside on the average: those of a voxel that the edge cuts are its mean.
const INSET: f64 = 0.25;
/// Stretches with an outermost point, at least, for a line.
const LEAST_STRETCHES: usize = 4;
/// So many points of frames say as much as one alone: neighbours and successive frames err alike.
const ALIKE: f64 = 4.0;
/// Neighbouring sides that meet at more than this have a corner, sin 20°, so near their ends, in cells.
const CORNER_SINE: f64 = 0.342;
const CORNER_CELLS: f64 = 3.0;
/// A boundary seen from views less than this apart may be where something in front ended: 20°, rad.
const CONFIRMED_RAD: f64 = 0.349;

/// A side of an outline with a line through its outermost points.
pub(super) struct Side {
    pub(super) from: Point2<f64>,
    pub(super) to: Point2<f64>,
    pub(super) sigma_m: f64,
    /// Points that it was drawn by, as many as are independent.
    pub(super) count: f64,
    /// These points, on the line they are the edge of.
    pub(super) places: Vec<Point2<f64>>,
    /// Of its direction: one standard deviation, rad.
    pub(super) direction_sigma_rad: f64,
    views_rad: f64,
}

impl Side {
    /// By points 2 mm off in turn, each of which counts: robustly 1.4826 times that.
    #[cfg(test)]
    pub(super) fn drawn([from, to]: [Point2<f64>; 2], places: Vec<Point2<f64>>) -> Self {
        let (sigma_m, count) = (0.002 * 1.4826, places.len() as f64);
        let direction_sigma_rad = sigma_m * libm::sqrt(12.0 / count) / (to - from).norm();
        Self { from, to, sigma_m, count, places, direction_sigma_rad, views_rad: 0.0 }
    }

    pub(super) fn length(&self) -> f64 {
        (self.to - self.from).norm()
    }

    pub(super) fn direction(&self) -> Vector2<f64> {
        (self.to - self.from) / self.length().max(1e-12)
    }
}

/// The boundaries of a plane.
pub(super) fn boundaries(rim: &Rim, plane: &FoundPlane, number: u32) -> Vec<Edge> {
    let cell_m = plane.raster.cell_m();
    let sides_of = |outline: &Vec<Point2<f64>>| {
        let corners = simplified(outline, SPLIT * cell_m);
        let next = corners.iter().cycle().skip(1);
        corners.iter().zip(next).map(|(from, to)| side(rim, cell_m, from, to)).collect()
    };
    let mut outlines: Vec<Vec<Option<Side>>> = plane.raster.outlines().iter().map(sides_of).collect();
    lined_up(&mut outlines.iter_mut().flatten().flatten().collect::<Vec<_>>(), cell_m);
    let mut edges = Vec::new();
    for sides in &mut outlines {
        meet_neighbours(sides, CORNER_CELLS * cell_m);
        for side in sides.iter().flatten() {
            if side.length() < SHORTEST_M || side.direction_sigma_rad > VAGUE_RAD {
                continue;
            }
            edges.push(Edge {
                kind: if side.views_rad >= CONFIRMED_RAD { EdgeKind::Boundary } else { EdgeKind::Occlusion },
                ends: [plane.lift(&side.from), plane.lift(&side.to)],
                planes: vec![number],
                angle_rad: None,
                // Across the plane as well as in it.
                sigma_m: libm::hypot(side.sigma_m / libm::sqrt(side.count), plane.height_sigma_m),
                direction_sigma_rad: side.direction_sigma_rad,
            });
        }
    }
    edges
}

/// A closed outline's corners that matter.
fn simplified(outline: &[Point2<f64>], most_off: f64) -> Vec<Point2<f64>> {
    let Some(first) = outline.first() else { return Vec::new() };
    let farthest = (0..outline.len()).max_by(|a, b| {
        let far = |at: &usize| outline.get(*at).map_or(0.0, |corner| (corner - first).norm_squared());
        far(a).total_cmp(&far(b)).then(b.cmp(a))
    });
    let half = farthest.unwrap_or(0);
    let closed: Vec<Point2<f64>> = outline.iter().chain([first]).copied().collect();
    let mut kept = vec![false; closed.len()];
    let mut waiting = vec![(0, half), (half, closed.len() - 1)];
    while let Some((from, to)) = waiting.pop() {
        for end in [from, to] {
            kept.iter_mut().skip(end).take(1).for_each(|kept| *kept = true);
        }
        let (Some(a), Some(b)) = (closed.get(from), closed.get(to)) else { continue };
        let mut worst = (most_off, None);
        for (corner, at) in closed.iter().zip(0..).take(to).skip(from + 1) {
            let off = off_segment(corner, a, b);
            if off > worst.0 {
                worst = (off, Some(at));
            }
        }
        if let Some(at) = worst.1 {
            waiting.extend([(from, at), (at, to)]);
        }
    }
    let mut corners: Vec<Point2<f64>> = closed.iter().zip(&kept).filter(|(_, kept)| **kept).map(|(c, _)| *c).collect();
    corners.pop();
    corners
}

fn off_segment(place: &Point2<f64>, a: &Point2<f64>, b: &Point2<f64>) -> f64 {
    let (way, from) = (b - a, place - a);
    let at = (from.dot(&way) / way.norm_squared().max(1e-18)).clamp(0.0, 1.0);
    (from - way * at).norm()
}

/// The line through the outermost points along a side of an outline that goes anticlockwise.
fn side(rim: &Rim, cell_m: f64, from: &Point2<f64>, to: &Point2<f64>) -> Option<Side> {
    let length = (to - from).norm();
    if length < SHORTEST_M {
        return None;
    }
    let along = (to - from) / length;
    let out = Vector2::new(along.y, -along.x);
    let reach = (INSIDE * cell_m, OUTSIDE * cell_m);
    let strip = Strip { from: *from, along, out, length, reach, stretch: cell_m };
    // Where the surface goes on beyond, it was not seen there often enough: no edge.
    let farther = Strip { reach: (-OUTSIDE * cell_m, BEYOND * cell_m), ..strip };
    let beyond = farther.outermost(rim.fused.iter().copied());
    if beyond.len() as f64 * cell_m > GOES_ON * length {
        return None;
    }
    let outermost = strip.outermost(rim.fused.iter().copied());
    if outermost.len() < LEAST_STRETCHES {
        return None;
    }
    let mut views: Vec<f64> = outermost.iter().map(|(_, _, views)| *views).collect();
    let middle = views.len() / 2;
    let views_rad = *views.select_nth_unstable_by(middle, f64::total_cmp).1;
    let mut last = rim.last_seen(&strip);
    // At its ends a side goes round the corner.
    last.retain(|(at, _)| (cell_m..=length - cell_m).contains(at));
    let stretches = last.len() as f64 / ALIKE;
    let (places, count) = if stretches >= LEAST_STRETCHES as f64 {
        (last, stretches)
    } else {
        let count = outermost.len() as f64;
        (outermost.into_iter().map(|(at, off, _)| (at, off)).collect(), count)
    };
    let (level, slope, sigma_m) = fitted(&places, cell_m)?;
    let inset = out * (INSET * cell_m);
    let at = |at: f64| from + along * at + out * (level + slope * at) + inset;
    let places = places.iter().map(|(at, off)| from + along * *at + out * *off + inset).collect();
    let direction_sigma_rad = sigma_m * libm::sqrt(12.0 / count) / length;
    Some(Side { from: at(0.0), to: at(length), sigma_m, count, places, direction_sigma_rad, views_rad })
}

/// off = level + slope · at, by least squares in which far points lose their say; with the scatter about it, m.
pub(super) fn fitted(found: &[(f64, f64)], cell_m: f64) -> Option<(f64, f64, f64)> {
    let (mut level, mut slope) = (0.0, 0.0);
    let mut scatter = 0.0;
    for round in 0..6 {
        let (mut w, mut x, mut y, mut xx, mut xy) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (at, off) in found {
            let left = off - level - slope * at;
            let robust = if round == 0 { 1.0 } else { 1.0 / (1.0 + left * left / (0.25 * cell_m * cell_m)) };
            let weight = robust * robust;
            w += weight;
            x += weight * at;
            y += weight * off;
            xx += weight * at * at;
            xy += weight * at * off;
        }
        let spread = xx * w - x * x;
        if w <= 0.0 || spread <= 1e-12 {
            return None;
        }
        slope = (xy * w - x * y) / spread;
        level = (y - slope * x) / w;
        let left = found.iter().map(|(at, off)| (off - level - slope * at).abs());
        scatter = super::robust_sigma(left.collect()).unwrap_or(0.0);
    }
    Some((level, slope, scatter.max(0.1 * cell_m)))
}

/// Ends of neighbouring sides are put into the corner where they meet.
fn meet_neighbours(sides: &mut [Option<Side>], reach: f64) {
    let count = sides.len();
    for at in 0..count {
        let next = (at + 1) % count;
        let (Some(Some(a)), Some(Some(b))) = (sides.get(at), sides.get(next)) else { continue };
        let (u, v) = ((a.to - a.from).normalize(), (b.to - b.from).normalize());
        let sine = u.x * v.y - u.y * v.x;
        if sine.abs() < CORNER_SINE || at == next {
            continue;
        }
        let between = b.from - a.from;
        let corner = a.from + u * ((between.x * v.y - between.y * v.x) / sine);
        if (corner - a.to).norm() > reach || (corner - b.from).norm() > reach {
            continue;
        }
        if let Some(Some(a)) = sides.get_mut(at) {
            a.to = corner;
        }
        if let Some(Some(b)) = sides.get_mut(next) {
            b.from = corner;
        }
    }
}

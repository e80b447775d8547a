//! Boundaries: where a plane's points end.

use super::contour::{Edge, EdgeKind};
use super::plane::FoundPlane;
use super::{FusedPoint, Reconstruction};
use nalgebra::{Point2, Vector2};

/// An outline is split where it is off its chord by so many cells (Douglas and Peucker 1973).
const SPLIT: f64 = 2.5;
/// The shortest side, m.
const SHORTEST_M: f64 = 0.04;
/// Points this far inside and outside a side belong to it, in cells.
const INSIDE: f64 = 3.0;
const OUTSIDE: f64 = 1.5;
/// A side with points beyond it, up to so many cells away, one for every fifth cell, is a gap in what was seen.
const BEYOND: f64 = 8.0;
const GOES_ON: f64 = 0.2;
/// A line whose direction is known no better than this is none: 2°, rad.
const VAGUE_RAD: f64 = 0.035;
/// The outermost points lie a quarter of a spacing inside on the average: those of a voxel that the edge cuts are its mean.
const INSET: f64 = 0.25;
/// Stretches with an outermost point, at least, for a line.
const LEAST_STRETCHES: usize = 4;
/// Neighbouring sides that meet at more than this have a corner, sin 20°, so near their ends, in cells.
const CORNER_SINE: f64 = 0.342;
const CORNER_CELLS: f64 = 3.0;
/// A boundary seen from views less than this apart may be where something in front ended: 20°, rad.
const CONFIRMED_RAD: f64 = 0.349;

/// A side of an outline with a line through its outermost points.
struct Side {
    from: Point2<f64>,
    to: Point2<f64>,
    sigma_m: f64,
    stretches: usize,
    views_rad: f64,
}

/// The boundaries of a plane.
pub(super) fn boundaries(made: &Reconstruction, plane: &FoundPlane, number: u32) -> Vec<Edge> {
    let members = plane.members.iter().filter_map(|member| made.points.get(*member as usize));
    let flat: Vec<(Point2<f64>, &FusedPoint)> = members.map(|point| (plane.in_plane(&point.place), point)).collect();
    let mut edges = Vec::new();
    for outline in plane.raster.outlines() {
        let corners = simplified(&outline, SPLIT * plane.raster.cell_m());
        let next = corners.iter().cycle().skip(1);
        let mut sides: Vec<Option<Side>> =
            corners.iter().zip(next).map(|(from, to)| side(&flat, plane.raster.cell_m(), from, to)).collect();
        meet_neighbours(&mut sides, CORNER_CELLS * plane.raster.cell_m());
        for side in sides.into_iter().flatten() {
            let length = (side.to - side.from).norm();
            if length < SHORTEST_M {
                continue;
            }
            let count = side.stretches as f64;
            let direction_sigma_rad = side.sigma_m * libm::sqrt(12.0 / count) / length;
            if direction_sigma_rad > VAGUE_RAD {
                continue;
            }
            edges.push(Edge {
                kind: if side.views_rad >= CONFIRMED_RAD { EdgeKind::Boundary } else { EdgeKind::Occlusion },
                ends: [plane.lift(&side.from), plane.lift(&side.to)],
                planes: vec![number],
                angle_rad: None,
                // Across the plane as well as in it.
                sigma_m: libm::hypot(side.sigma_m / libm::sqrt(count), plane.height_sigma_m),
                direction_sigma_rad,
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
fn side(flat: &[(Point2<f64>, &FusedPoint)], cell_m: f64, from: &Point2<f64>, to: &Point2<f64>) -> Option<Side> {
    let length = (to - from).norm();
    if length < SHORTEST_M {
        return None;
    }
    let along = (to - from) / length;
    let out = Vector2::new(along.y, -along.x);
    let mut outermost: Vec<Option<(f64, f64, f64)>> = vec![None; (length / cell_m) as usize + 1];
    for (place, point) in flat {
        let offset = place - from;
        let (at, off) = (offset.dot(&along), offset.dot(&out));
        if !(0.0..=length).contains(&at) || off < -INSIDE * cell_m || off > OUTSIDE * cell_m {
            continue;
        }
        if let Some(held) = outermost.get_mut((at / cell_m) as usize)
            && held.is_none_or(|(_, most, _)| off > most)
        {
            *held = Some((at, off, point.views_rad));
        }
    }
    // Where the surface goes on beyond, it was not seen there often enough: no edge.
    let beyond = flat.iter().filter(|(place, _)| {
        let offset = place - from;
        let (at, off) = (offset.dot(&along), offset.dot(&out));
        (0.0..=length).contains(&at) && (OUTSIDE * cell_m..BEYOND * cell_m).contains(&off)
    });
    if beyond.count() as f64 * cell_m > GOES_ON * length {
        return None;
    }
    let found: Vec<(f64, f64, f64)> = outermost.into_iter().flatten().collect();
    if found.len() < LEAST_STRETCHES {
        return None;
    }
    let (level, slope, sigma_m) = fitted(&found, cell_m)?;
    let mut views: Vec<f64> = found.iter().map(|(_, _, views)| *views).collect();
    let middle = views.len() / 2;
    let views_rad = *views.select_nth_unstable_by(middle, f64::total_cmp).1;
    let at = |at: f64| from + along * at + out * (level + slope * at + INSET * cell_m);
    Some(Side { from: at(0.0), to: at(length), sigma_m, stretches: found.len(), views_rad })
}

/// off = level + slope · at, by least squares in which far points lose their say; with the scatter about it, m.
fn fitted(found: &[(f64, f64, f64)], cell_m: f64) -> Option<(f64, f64, f64)> {
    let (mut level, mut slope) = (0.0, 0.0);
    let mut scatter = 0.0;
    for round in 0..6 {
        let (mut w, mut x, mut y, mut xx, mut xy) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (at, off, _) in found {
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
        let left = found.iter().map(|(at, off, _)| (off - level - slope * at).abs());
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

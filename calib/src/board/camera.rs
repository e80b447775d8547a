//! The board in the camera's view: the flat, connected region of the board's size.

use nalgebra::{Point3, Vector3};

use crate::blocks::Blocks;
use crate::plane::Plane;
use crate::view::{CameraView, Ranged, camera_sigma_m};

/// Boards are not looked for farther away, m.
const FARTHEST_M: f64 = 4.0;
/// A region of fewer blocks is no board.
const LEAST_BLOCKS: usize = 30;
/// Reach of the neighbourhood that a region begins with, blocks.
const SEED: usize = 2;
/// A point belongs to a plane within this many standard deviations, and within this distance at least, m.
const BELONGS: (f64, f64) = (3.0, 0.010);
/// How far a side may be off the board's, a share.
const SIZE_SHARE: f64 = 0.15;
/// Of the points' extents along a side this share at either end is left out: stray pixels of ragged edges.
const STRAY: f64 = 0.005;

/// A board's sides, m, the longer first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BoardSize {
    /// The longer side, m.
    pub long_m: f64,
    /// The shorter side, m.
    pub short_m: f64,
}

impl BoardSize {
    /// From two sides in any order, m.
    pub fn new(a_m: f64, b_m: f64) -> Self {
        Self { long_m: a_m.max(b_m), short_m: a_m.min(b_m) }
    }

    /// The larger of the two sides' shares by which another is off.
    fn off(&self, found: &Self) -> f64 {
        (found.long_m / self.long_m - 1.0).abs().max((found.short_m / self.short_m - 1.0).abs())
    }
}

impl core::fmt::Display for BoardSize {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{:.2} x {:.2} m", self.long_m, self.short_m)
    }
}

/// A rectangle in the camera's frame, and the board's points in it.
#[derive(Clone, Debug, PartialEq)]
pub struct Seen {
    /// Its plane.
    pub plane: Plane,
    /// Its middle.
    pub middle: Point3<f64>,
    /// Along the longer and the shorter side, length 1.
    pub sides: [Vector3<f64>; 2],
    /// How long they are found to be.
    pub size: BoardSize,
    /// Its points without those near its edge, where pixels mix with what is behind.
    pub points: Vec<Ranged>,
}

/// Why there is no board.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NotSeen {
    /// Nothing flat of any size.
    #[error("the Kinect sees nothing flat within {FARTHEST_M} m")]
    NothingFlat,
    /// Flat things, none of them the board's size.
    #[error("the Kinect sees nothing flat of {expected} within 15 %; the nearest in size is {nearest}")]
    OtherSize {
        /// The board's.
        expected: BoardSize,
        /// The nearest found.
        nearest: BoardSize,
    },
}

/// Finds the board.
///
/// # Errors
/// [`NotSeen`]: nothing has its size.
pub(super) fn find(view: &CameraView, board: &BoardSize) -> Result<Seen, NotSeen> {
    let blocks = Blocks::new(view, FARTHEST_M);
    let mut taken = vec![false; blocks.len()];
    let mut nearest: Option<(f64, Seen)> = None;
    for seed in 0..blocks.len() {
        if taken.get(seed).copied().unwrap_or(true) {
            continue;
        }
        let Some((plane, region)) = region(&blocks, seed) else { continue };
        region.iter().for_each(|block| taken.iter_mut().skip(*block).take(1).for_each(|taken| *taken = true));
        if region.len() < LEAST_BLOCKS {
            continue;
        }
        let Some(seen) = measure(view, &blocks, plane, &region) else { continue };
        let off = board.off(&seen.size);
        if nearest.as_ref().is_none_or(|(least, _)| off < *least) {
            nearest = Some((off, seen));
        }
    }
    match nearest {
        Some((off, seen)) if off <= SIZE_SHARE => Ok(seen),
        Some((_, seen)) => Err(NotSeen::OtherSize { expected: *board, nearest: seen.size }),
        None => Err(NotSeen::NothingFlat),
    }
}

fn belongs(plane: &Plane, point: &Point3<f64>) -> bool {
    plane.beyond_m(point).abs() < (BELONGS.0 * camera_sigma_m(point.z)).max(BELONGS.1)
}

/// The connected blocks in the plane that the seed's neighbourhood begins; `None`: that is not flat.
fn region(blocks: &Blocks, seed: usize) -> Option<(Plane, Vec<usize>)> {
    let begin: Vec<Point3<f64>> = blocks.around(seed, SEED).filter_map(|block| blocks.point(block)).collect();
    if begin.len() < (2 * SEED + 1) * (2 * SEED + 1) {
        return None;
    }
    let mut plane = Plane::fit(begin.iter().copied())?;
    if !begin.iter().all(|point| belongs(&plane, point)) {
        return None;
    }
    let mut found = Vec::new();
    // The first plane is of a small patch: twice more with what it found.
    for _ in 0..3 {
        found = grown(blocks, seed, &plane);
        plane = Plane::fit(found.iter().filter_map(|block| blocks.point(*block)))?;
    }
    Some((plane, found))
}

fn grown(blocks: &Blocks, seed: usize, plane: &Plane) -> Vec<usize> {
    let mut visited = vec![false; blocks.len()];
    let mut found = Vec::new();
    let mut open = vec![seed];
    while let Some(block) = open.pop() {
        let Some(visited) = visited.get_mut(block) else { continue };
        if core::mem::replace(visited, true) {
            continue;
        }
        if blocks.point(block).is_some_and(|point| belongs(plane, &point)) {
            found.push(block);
            open.extend(blocks.around(block, 1));
        }
    }
    found.sort_unstable();
    found
}

/// The region's rectangle, and its points away from the edge.
fn measure(view: &CameraView, blocks: &Blocks, plane: Plane, region: &[usize]) -> Option<Seen> {
    let inside = |block: &usize| region.binary_search(block).is_ok();
    // With the blocks around it, whose pixels may belong to it too.
    let mut whole: Vec<usize> = region.iter().flat_map(|block| blocks.around(*block, 1)).collect();
    whole.sort_unstable();
    whole.dedup();
    let points = |blocks_of: &[usize]| -> Vec<Point3<f64>> {
        let pixels = blocks_of.iter().flat_map(|block| blocks.pixels(*block));
        pixels.filter_map(|(u, v)| view.point(u, v)).filter(|point| belongs(&plane, point)).collect()
    };
    let interior: Vec<usize> =
        region.iter().copied().filter(|block| blocks.around(*block, 1).filter(inside).count() == 9).collect();
    let interior = points(&interior);
    let (sides, middle, size) = rectangle(&plane, &points(&whole))?;
    // The plane of the whole region carries its edges: anew from the points that count.
    let points: Vec<Ranged> = interior.into_iter().map(Ranged::of_camera).collect();
    let plane = Plane::refined(plane, &points);
    Some(Seen { plane, middle, sides, size, points })
}

/// The least and the largest of some numbers.
type Extent = (f64, f64);

/// The rectangle of least area about points of a plane.
fn rectangle(plane: &Plane, points: &[Point3<f64>]) -> Option<([Vector3<f64>; 2], Point3<f64>, BoardSize)> {
    let [a, b] = plane.across();
    let mut least = f64::INFINITY;
    let mut best: Option<([Vector3<f64>; 2], [Extent; 2])> = None;
    // Every 100th is enough to find the attitude of a rectangle, and sorting is what costs.
    let some: Vec<&Point3<f64>> = points.iter().step_by((points.len() / 2_000).max(1)).collect();
    for degrees in 0..90 {
        let (sin, cos) = libm::sincos(f64::from(degrees).to_radians());
        let sides = [a * cos + b * sin, b * cos - a * sin];
        let [first, second] = sides.map(|side| extent(some.iter().map(|point| side.dot(&point.coords))));
        let (first, second) = (first?, second?);
        let area = (first.1 - first.0) * (second.1 - second.0);
        if area < least {
            least = area;
            best = Some((sides, [first, second]));
        }
    }
    let ([first, second], [(first_low, first_high), (second_low, second_high)]) = best?;
    let middle = first * (0.5 * (first_low + first_high))
        + second * (0.5 * (second_low + second_high))
        + plane.normal * plane.distance_m;
    let (along, beside) = (first_high - first_low, second_high - second_low);
    let sides = if along >= beside { [first, second] } else { [second, first] };
    Some((sides, Point3::from(middle), BoardSize::new(along, beside)))
}

fn extent(values: impl Iterator<Item = f64>) -> Option<Extent> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    let stray = (values.len() as f64 * STRAY) as usize;
    Some((*values.get(stray)?, *values.get(values.len().checked_sub(1 + stray)?)?))
}

//! The board among a LiDAR's points: near where the camera's board must be by the present guess.

use nalgebra::{Isometry3, Point3};

use super::camera::Seen;
use crate::draws::Draws;
use crate::plane::Plane;
use crate::view::{LidarPoint, Ranged};

/// A LiDAR's point belongs to a plane within this distance, m: three standard deviations of its noise.
const BELONGS_M: f64 = 0.060;
/// Draws of three points.
const DRAWS: usize = 200;
/// A plane farther than this from where the camera has it is another one, cosine of 25°.
const SAME_COSINE: f64 = 0.906;
/// Fewer points on fewer beams fix no plane.
const LEAST_POINTS: usize = 60;
const LEAST_RINGS: usize = 3;

/// How far from the camera's rectangle points are looked at, m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Margin {
    /// Beyond its edges; below 0: this much of its edge is left out, where beams hit two surfaces.
    pub(super) beside_m: f64,
    /// Before and behind it.
    pub(super) off_m: f64,
}

impl Margin {
    /// With a guess as drawings give it: several degrees and a decimetre.
    pub(super) const GUESS: Self = Self { beside_m: 0.15, off_m: 0.35 };
    /// With a place that a first solution found.
    pub(super) const FOUND: Self = Self { beside_m: -0.03, off_m: 0.10 };
}

/// Why there is no board.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NotHit {
    /// Too few points where it must be.
    #[error(
        "the LiDAR has {points} points on {rings} beams where the board must be, {LEAST_POINTS} on {LEAST_RINGS} are needed"
    )]
    TooFew {
        /// Points.
        points: usize,
        /// Beams.
        rings: usize,
    },
    /// Points, but no plane near the camera's attitude.
    #[error("the LiDAR sees no plane within 25 degrees of the board's where the board must be")]
    NoPlane,
}

/// The points of the board, and their plane, in the LiDAR's frame.
///
/// # Errors
/// [`NotHit`]: nothing is there, or something else.
pub(super) fn find(
    points: &[LidarPoint],
    seen: &Seen,
    t_lidar_camera: &Isometry3<f64>,
    margin: &Margin,
) -> Result<(Plane, Vec<Ranged>), NotHit> {
    let t_camera_lidar = t_lidar_camera.inverse();
    let [long, short] = seen.sides;
    let half = [0.5 * seen.size.long_m + margin.beside_m, 0.5 * seen.size.short_m + margin.beside_m];
    let origin = t_camera_lidar * Point3::origin();
    // Beside the rectangle is decided by where the ray meets the plane. By where the point was measured, range errors would
    // decide near the edges: of diverging rays those measured too far would be left out, and the board drawn nearer.
    let near = |point: &&LidarPoint| {
        let measured = t_camera_lidar * point.point();
        let beyond = seen.plane.beyond_m(&measured);
        let (before, after) = (-seen.plane.beyond_m(&origin), beyond);
        let met = origin + (measured - origin) * (before / (before + after).max(0.1));
        let way = met - seen.middle;
        beyond.abs() < margin.off_m && long.dot(&way).abs() < half[0] && short.dot(&way).abs() < half[1]
    };
    let near: Vec<(Point3<f64>, u8)> = points.iter().filter(near).map(|point| (point.point(), point.ring)).collect();
    let enough = |some: &[(Point3<f64>, u8)]| {
        let mut rings: Vec<u8> = some.iter().map(|(_, ring)| *ring).collect();
        rings.sort_unstable();
        rings.dedup();
        let (points, rings) = (some.len(), rings.len());
        if points < LEAST_POINTS || rings < LEAST_RINGS { Err(NotHit::TooFew { points, rings }) } else { Ok(()) }
    };
    enough(&near)?;
    let expected = t_lidar_camera.rotation * seen.plane.normal;
    let alike = |plane: &Plane| plane.normal.dot(&expected) > SAME_COSINE;
    let mut plane = consensus(&near, &alike).ok_or(NotHit::NoPlane)?;
    let mut board = Vec::new();
    for _ in 0..4 {
        board = near.iter().filter(|(point, _)| plane.beyond_m(point).abs() < BELONGS_M).copied().collect();
        plane = Plane::fit(board.iter().map(|(point, _)| *point)).ok_or(NotHit::NoPlane)?;
    }
    enough(&board)?;
    if !alike(&plane) {
        return Err(NotHit::NoPlane);
    }
    let board: Vec<Ranged> = board.into_iter().map(|(point, _)| Ranged::of_lidar(point)).collect();
    Ok((Plane::refined(plane, &board), board))
}

/// The plane through three of the points that most others are near; counted on a thousand of them at most.
fn consensus(points: &[(Point3<f64>, u8)], alike: &dyn Fn(&Plane) -> bool) -> Option<Plane> {
    let mut draws = Draws::new();
    let some: Vec<Point3<f64>> =
        points.iter().step_by((points.len() / 1_000).max(1)).map(|(point, _)| *point).collect();
    let mut best: Option<(usize, Plane)> = None;
    for _ in 0..DRAWS {
        let three: [Option<&Point3<f64>>; 3] = core::array::from_fn(|_| some.get(draws.below(some.len())));
        let [Some(a), Some(b), Some(c)] = three else { return None };
        let normal = (b - a).cross(&(c - a));
        // Three points nearly on a line fix no plane.
        if normal.norm() < 1e-3 {
            continue;
        }
        let plane = Plane::through(a, normal.normalize());
        if !alike(&plane) {
            continue;
        }
        let count = some.iter().filter(|point| plane.beyond_m(point).abs() < BELONGS_M).count();
        if best.is_none_or(|(most, _)| count > most) {
            best = Some((count, plane));
        }
    }
    best.map(|(_, plane)| plane)
}

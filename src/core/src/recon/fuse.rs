//! Registered frames to one point for each bit of the target's surface.

use crate::neighbours::KdTree;
use crate::register::SensorKind;
use crate::track::{BeamBiases, CAMERA_SLOPE_RAD, Growing, LIDAR_SLOPE_RAD, Observed, TrackFrame};
use nalgebra::{Isometry3, Point3, Vector3};
use tumbled_model::RigNs;

/// A point seen in fewer frames than this, of a target seen in many, is a flying pixel or noise.
const LEAST_FRAMES: u32 = 3;
/// Many.
const MANY_FRAMES: usize = 12;

/// A measured point of the target's surface, target's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// Where, m.
    pub place: Point3<f64>,
    /// Unit, towards the sensor.
    pub normal: Vector3<f64>,
    /// One standard deviation along the sight, m.
    pub sigma_m: f64,
}

/// A frame laid on the target: its points in the target's frame.
#[derive(Clone, Debug, PartialEq)]
pub struct RegisteredFrame {
    /// What made it.
    pub kind: SensorKind,
    /// When.
    pub t: RigNs,
    /// Where the sensor stood, target's frame, m.
    pub viewpoint: Point3<f64>,
    /// Its points, without the beams' biases.
    pub points: Vec<Sighting>,
}

impl RegisteredFrame {
    /// A frame at a pose (target's frame to rig), of a LiDAR without what is known of its beams.
    pub fn new(frame: &TrackFrame, t_rig_target: &Isometry3<f64>, beams: Option<&BeamBiases>) -> Self {
        let inverse = t_rig_target.inverse();
        let from = frame.shot().viewpoint;
        let corrected = |place: &Point3<f64>, number: usize| match (beams, frame.beams().get(number)) {
            (Some(beams), Some(beam)) => beams.corrected(place, *beam, &from),
            _ => *place,
        };
        let rows = frame.points().iter().zip(frame.normals()).zip(frame.sigma_m()).zip(0..);
        let points = rows.map(|(((place, normal), sigma_m), number)| Sighting {
            place: inverse * corrected(place, number),
            normal: inverse * normal,
            sigma_m: *sigma_m,
        });
        Self { kind: frame.kind(), t: frame.shot().t, viewpoint: inverse * from, points: points.collect() }
    }

    fn observed(&self) -> impl Iterator<Item = Observed> + '_ {
        self.points.iter().map(|Sighting { place, normal, sigma_m }| Observed {
            place: *place,
            normal: *normal,
            sigma_m: *sigma_m,
        })
    }

    fn noisiest_m(&self) -> f64 {
        self.points.iter().map(|point| point.sigma_m).fold(0.0, f64::max)
    }
}

/// A bit of the target's surface, target's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FusedPoint {
    /// Where, m.
    pub place: Point3<f64>,
    /// Unit, out of the body.
    pub normal: Vector3<f64>,
    /// One standard deviation along the normal, m: of the points' noise alone.
    pub sigma_m: f64,
    /// Points of Kinects and of LiDARs in it.
    pub kinect: u32,
    /// See `kinect`.
    pub lidar: u32,
    /// The widest angle between the first sight on it and any other, rad.
    pub views_rad: f64,
    /// A LiDAR saw it, next to what cameras saw, and they did not: its spots reach over an edge, and lie where the next surface
    /// pulls them. It is a point of the surface, but does not tell where that ends.
    pub beside_cameras: bool,
}

/// What was fused.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Fused {
    /// The points, in the order they were first seen.
    pub points: Vec<FusedPoint>,
    /// Of each frame's points the fused one that each is part of; `None`: of none.
    pub part_of: Vec<Vec<Option<u32>>>,
    /// Points left out because too few frames saw them.
    pub rare: usize,
}

/// A camera saw a place of a surface so often, as a share of what is usual on it, or it was a flying pixel that came again.
const STEADY: f64 = 0.2;
/// So many returns of a LiDAR are no flying pixels: its spots are few on any place.
const STEADY_RETURNS: u32 = 2;
/// How far cameras' sight of an edge goes before a LiDAR's, m: three spots at 2 m.
const CAMERAS_REACH_M: f32 = 0.04;
/// Frames of cameras that have seen a point, at least, for it to be seen by them.
const SEEN_BY_CAMERAS: u32 = 3;

/// Those of a surface's points, by their numbers, that were seen often enough to tell where it ends.
pub(super) fn steady<'a>(points: &'a [FusedPoint], members: &'a [u32]) -> impl Iterator<Item = &'a FusedPoint> {
    let of_it = || members.iter().filter_map(|member| points.get(*member as usize));
    let mut counts: Vec<u32> = of_it().map(|point| point.kinect).collect();
    let middle = counts.len() / 2;
    let usual = if counts.is_empty() { 0 } else { *counts.select_nth_unstable(middle).1 };
    let least = STEADY * f64::from(usual);
    of_it().filter(move |point| {
        f64::from(point.kinect) >= least || (point.lidar >= STEADY_RETURNS && !point.beside_cameras)
    })
}

/// What was seen of one surfel.
#[derive(Clone, Copy, Debug, Default)]
struct Seen {
    kinect: u32,
    lidar: u32,
    frames: u32,
    last: Option<usize>,
    first: Option<Vector3<f64>>,
    least_cosine: f64,
}

/// Fuses frames: a point moves the surfel it belongs to along its normal, by inverse variances, so that a LiDAR's point at 2 cm
/// does not smear a surface that a Kinect knows to 6 mm. Cameras go first: what a LiDAR alone saw is added to theirs.
pub fn fuse(frames: &[RegisteredFrame]) -> Fused {
    let mut model = Growing::default();
    let cameras = frames.iter().filter(|frame| frame.kind == SensorKind::Kinect);
    let lidars = frames.iter().filter(|frame| frame.kind == SensorKind::Lidar);
    let slope_rad = if cameras.clone().next().is_some() { CAMERA_SLOPE_RAD } else { LIDAR_SLOPE_RAD };
    for frame in cameras.chain(lidars) {
        model.insert(frame.observed(), frame.noisiest_m(), slope_rad, frame.t);
    }
    let mut seen = vec![Seen { least_cosine: 1.0, ..Seen::default() }; model.surfels.len()];
    let mut part_of = Vec::with_capacity(frames.len());
    for (frame, number) in frames.iter().zip(0..) {
        let homes: Vec<Option<u32>> = model.homes(frame.observed(), frame.noisiest_m()).collect();
        for (point, home) in frame.points.iter().zip(&homes) {
            let Some(seen) = home.and_then(|home| seen.get_mut(home as usize)) else { continue };
            match frame.kind {
                SensorKind::Kinect => seen.kinect = seen.kinect.saturating_add(1),
                SensorKind::Lidar => seen.lidar = seen.lidar.saturating_add(1),
            }
            if seen.last.replace(number) != Some(number) {
                seen.frames += 1;
            }
            let Some(sight) = (frame.viewpoint - point.place).try_normalize(1e-6) else { continue };
            let first = *seen.first.get_or_insert(sight);
            seen.least_cosine = seen.least_cosine.min(first.dot(&sight));
        }
        part_of.push(homes);
    }
    let surfels = &model.surfels;
    let least = if frames.len() >= MANY_FRAMES { LEAST_FRAMES } else { 1 };
    let mut renumbered = vec![None; surfels.len()];
    let mut points = Vec::new();
    let rows = surfels.positions().iter().zip(surfels.normals()).zip(surfels.weights()).zip(&seen).zip(&mut renumbered);
    for ((((place, normal), weight), seen), number) in rows {
        if seen.frames < least {
            continue;
        }
        *number = Some(points.len() as u32);
        points.push(FusedPoint {
            place: *place,
            normal: *normal,
            sigma_m: 1.0 / libm::sqrt(*weight),
            kinect: seen.kinect,
            lidar: seen.lidar,
            views_rad: libm::acos(seen.least_cosine.clamp(-1.0, 1.0)),
            beside_cameras: false,
        });
    }
    mark_beside_cameras(&mut points);
    let rare = surfels.len() - points.len();
    for home in part_of.iter_mut().flatten() {
        *home = home.and_then(|home| renumbered.get(home as usize).copied().flatten());
    }
    Fused { points, part_of, rare }
}

fn mark_beside_cameras(points: &mut [FusedPoint]) {
    let seen = |point: &FusedPoint| point.kinect >= SEEN_BY_CAMERAS;
    let places: Vec<Point3<f32>> = points.iter().filter(|point| seen(point)).map(|point| point.place.cast()).collect();
    let tree = KdTree::build(&places);
    for point in points.iter_mut().filter(|point| !seen(point)) {
        point.beside_cameras = tree.nearest(&point.place.cast(), CAMERAS_REACH_M * CAMERAS_REACH_M).is_some();
    }
}

//! Registered frames to one point for each bit of the target's surface.

use crate::neighbours::KdTree;
use crate::register::SensorKind;
use crate::track::{BeamBiases, Growing, Observed, TrackFrame, gate_m};
use nalgebra::{Isometry3, Point3, Vector3};
use tumbled_model::RigNs;

/// A point moves a surfel that faces as it does: the least cosine of their normals.
const SAME_FACING: f64 = 0.5;
/// So near along the surface a surfel is to the points it is made of, m.
const ASIDE_M: f64 = 0.013;
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
            (Some(beams), Some(beam)) => {
                let ray = (place - from).try_normalize(1e-6).unwrap_or_default();
                place - ray * beams.bias_m(*beam)
            }
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
    for frame in cameras.chain(lidars) {
        let noisiest = frame.points.iter().map(|point| point.sigma_m).fold(0.0, f64::max);
        let observed = |point: &Sighting| Observed { place: point.place, normal: point.normal, sigma_m: point.sigma_m };
        model.insert(frame.points.iter().map(observed), noisiest, frame.t);
    }
    let surfels = &model.surfels;
    let places: Vec<Point3<f32>> = surfels.positions().iter().map(|place| place.cast()).collect();
    let tree = KdTree::build(&places);
    let mut seen = vec![Seen { least_cosine: 1.0, ..Seen::default() }; surfels.len()];
    let mut part_of = Vec::with_capacity(frames.len());
    for (frame, number) in frames.iter().zip(0..) {
        let home = |point: &Sighting| {
            let gate = gate_m(point.sigma_m);
            let mut best = (ASIDE_M * ASIDE_M, u32::MAX);
            tree.within(&point.place.cast(), (gate * gate + ASIDE_M * ASIDE_M) as f32, |surfel, _| {
                let at = surfel as usize;
                let (Some(place), Some(normal)) = (surfels.positions().get(at), surfels.normals().get(at)) else {
                    return;
                };
                let offset = point.place - place;
                let along = offset.dot(normal);
                let aside = offset.norm_squared() - along * along;
                if along.abs() < gate && normal.dot(&point.normal) >= SAME_FACING && (aside, surfel) < best {
                    best = (aside, surfel);
                }
            });
            (best.1 != u32::MAX).then_some(best.1)
        };
        let homes: Vec<Option<u32>> = frame.points.iter().map(home).collect();
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
        });
    }
    let rare = surfels.len() - points.len();
    for home in part_of.iter_mut().flatten() {
        *home = home.and_then(|home| renumbered.get(home as usize).copied().flatten());
    }
    Fused { points, part_of, rare }
}

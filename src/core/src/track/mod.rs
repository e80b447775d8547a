//! Frame to model: each frame of each sensor registered to one growing model of the target (method.md §7).
//!
//! ```text
//!   pixels, returns ─▶ TrackFrame ─▶ fit ─▶ Fit ─▶ (a filter accepts it) ─▶ accept ─▶ model, beams' biases
//!    (deskewed)       points, normals  ▲                                       │
//!                                      └──── what of the model is seen ◀───────┘
//! ```
//!
//! No search and no prior: a fit starts from a predicted pose and finds the nearest one. What it answers for is in
//! [`Fit::is_trusted`] and [`Fit::is_firm`]. Frames whose points are all left out, far from the model or nonsense give a
//! fit that is not trusted, never an error.

mod beams;
mod bins;
mod descend;
mod deskew;
mod fit;
mod frame;
mod model;
mod surfels;
mod visible;
mod voxels;

pub use beams::BeamBiases;
pub use deskew::RigMotion;
pub use fit::Fit;
pub use frame::{LidarReturn, Pixel, Shot, TrackFrame};
pub(crate) use model::{CAMERA_SLOPE_RAD, LIDAR_SLOPE_RAD, Model as Growing, Observed};
pub use model::{MODEL_REACH_M, MOST_SURFELS};
pub use surfels::{Surfel, Surfels};

use crate::register::SensorKind;
use beams::Witness;
use bins::Bins;
use descend::Scene;
use model::Model;
use nalgebra::{Isometry3, Point3, UnitQuaternion};
use tumbled_model::se3::angle_between;
use tumbled_model::{RigNs, Span};
use visible::Visible;

/// Sensors at most: a frame of a higher number is registered like any other, but nothing of it is kept.
pub const MOST_SENSORS: usize = 16;
/// A sensor's frames are inserted once in so great a turn of the target, rad: 3°. More often is no more accurate.
const TURN_RAD: f64 = 3.0 * core::f64::consts::PI / 180.0;
/// So long after a camera's frame no LiDAR's is inserted: its beams' biases, a centimetre each, would bend surfaces that the
/// camera has measured better. Measured at 20 °/s and 2.2 m over six seeds: positions to 0.6 mm instead of 0.9 to 1.4.
const CAMERA_LASTS: Span = Span(2_000_000_000);
/// Better: by points of less than this, m. A Kinect's are from 2.7 m on no better than a LiDAR's.
const CAMERA_SIGMA_M: f64 = 0.006;

/// A piece of the model is shown where a point is so near, m: a camera's points are 4 mm apart, a LiDAR's rings 13 to 50.
const SHOWN_KINECT_M: f32 = 0.03;
const SHOWN_LIDAR_M: f32 = 0.06;

/// What is remembered of one sensor.
#[derive(Clone, Debug, Default)]
struct Memory {
    beams: BeamBiases,
    inserted: Option<UnitQuaternion<f64>>,
}

/// A target being tracked: its model, and what is known of the sensors by it.
#[derive(Clone, Debug, Default)]
pub struct Tracker {
    model: Model,
    sensors: Vec<Memory>,
    /// When a camera's frame was last believed.
    camera: Option<RigNs>,
    /// Whether a camera's frame is in the model.
    is_pictured: bool,
    visible: Visible,
    scene: Scene,
    corrected: Vec<Point3<f64>>,
    /// A frame's points in the target's frame.
    seen: Bins,
}

impl Tracker {
    /// Begins with a frame, which becomes the model: it defines the target's frame, by the pose it is given.
    pub fn begin(frame: &TrackFrame, t_rig_target: &Isometry3<f64>) -> Self {
        let mut tracker = Self::default();
        tracker.correct(frame);
        tracker.insert(frame, t_rig_target);
        tracker
    }

    /// Begins with a model that another session made, in its frame.
    pub fn known(surfels: Surfels) -> Self {
        Self { model: Model::known(surfels), ..Self::default() }
    }

    /// Registers a frame to what of the model its sensor sees, from a pose some degrees and centimetres away at most.
    /// Changes nothing that a later fit could see.
    pub fn fit(&mut self, frame: &TrackFrame, start: &Isometry3<f64>) -> Fit {
        self.correct(frame);
        let viewpoint = &frame.shot().viewpoint;
        let seen = self.visible.from(&self.model.surfels, &start.inverse_transform_point(viewpoint));
        self.scene.fill(&self.model.surfels, seen);
        let mut fit = self.scene.descend(frame, &self.corrected, start);
        if frame.kind() == SensorKind::Lidar {
            let unknown = BeamBiases::default();
            let known = self.sensors.get(frame.shot().sensor).map_or(&unknown, |memory| &memory.beams);
            let witnesses = self.scene.matches(&self.corrected, &fit.t_rig_target).filter_map(|found| {
                let (point, beam) = (self.corrected.get(found.number)?, frame.beams().get(found.number)?);
                let normal = fit.t_rig_target * found.normal;
                Some(Witness {
                    beam: *beam,
                    residual_m: found.residual_m,
                    cosine: beams::cosine(&normal, point, viewpoint),
                    sigma_m: *frame.sigma_m().get(found.number)?,
                })
            });
            fit.evidence = known.weigh(witnesses);
        }
        fit
    }

    /// The share of what a frame's sensor would see of the model at a pose that the frame shows: where the model is, points are.
    /// A body that is smaller than the model, or another one, leaves some of it bare. 0 of a model that could not be seen.
    pub fn shown(&mut self, frame: &TrackFrame, t_rig_target: &Isometry3<f64>) -> f64 {
        self.correct(frame);
        let inverse = t_rig_target.inverse();
        let reach = match frame.kind() {
            SensorKind::Kinect => SHOWN_KINECT_M,
            SensorKind::Lidar => SHOWN_LIDAR_M,
        };
        let places = self.corrected.iter().map(|point| (inverse * point).coords.cast::<f32>().into());
        self.seen.fill(places, reach);
        let seen = self.visible.from(&self.model.surfels, &(inverse * frame.shot().viewpoint));
        let is_shown = |number: &&u32| {
            let place = self.model.surfels.positions().get(**number as usize);
            place.is_some_and(|place| self.seen.nearest(place.coords.cast::<f32>().into(), reach * reach).is_some())
        };
        seen.iter().filter(is_shown).count() as f64 / seen.len().max(1) as f64
    }

    /// Of each group of places, rig frame, the share that lies nearer than `near_m` to the model at a pose.
    pub fn shares(&mut self, t_rig_target: &Isometry3<f64>, groups: &[Vec<Point3<f64>>], near_m: f64) -> Vec<f64> {
        let (inverse, near_m) = (t_rig_target.inverse(), near_m as f32);
        let model = self.model.surfels.positions().iter();
        self.seen.fill(model.map(|place| place.coords.cast::<f32>().into()), near_m);
        let is_near = |place: &&Point3<f64>| {
            self.seen.nearest((inverse * **place).coords.cast::<f32>().into(), near_m * near_m).is_some()
        };
        groups.iter().map(|group| group.iter().filter(is_near).count() as f64 / group.len().max(1) as f64).collect()
    }

    /// Takes a frame whose fit is believed: learns its beams' biases, and inserts it into the model at the fit's own pose if
    /// the fit is firm, the target has turned by 3° since this sensor's last insertion, and no camera sees it better.
    pub fn accept(&mut self, frame: &TrackFrame, fit: &Fit) {
        let sensor = frame.shot().sensor;
        let pose = &fit.t_rig_target;
        let is_due = match self.sensors.get(sensor) {
            Some(Memory { inserted: Some(last), .. }) => angle_between(last, &pose.rotation) >= TURN_RAD,
            _ => sensor < MOST_SENSORS,
        };
        let is_camera = frame.kind() == SensorKind::Kinect;
        let is_seen_better = !is_camera && self.camera.is_some_and(|last| frame.shot().t - last < CAMERA_LASTS);
        if is_camera && fit.is_firm() && mean(frame.sigma_m()) < CAMERA_SIGMA_M {
            self.camera = Some(frame.shot().t);
        }
        if is_due && fit.is_firm() && !is_seen_better {
            // With the biases the frame was registered with: before it has its say.
            self.correct(frame);
            self.insert(frame, pose);
        }
        if frame.kind() == SensorKind::Lidar
            && let Some(memory) = self.memory(sensor)
        {
            memory.beams.learn(&fit.evidence);
        }
    }

    /// The model, in the target's frame.
    pub fn surfels(&self) -> &Surfels {
        &self.model.surfels
    }

    /// What is known of the beams of a sensor. `None`: no frame of it was taken yet.
    pub fn beams(&self, sensor: usize) -> Option<&BeamBiases> {
        self.sensors.get(sensor).map(|memory| &memory.beams)
    }

    /// How many frames are in the model.
    pub fn insertions(&self) -> usize {
        self.model.insertions()
    }

    /// Surfels that were not made because the model was full or they lay beyond its reach.
    pub fn refused(&self) -> u64 {
        self.model.refused()
    }

    /// The frame's points without their beams' biases.
    fn correct(&mut self, frame: &TrackFrame) {
        self.corrected.clear();
        match self.sensors.get(frame.shot().sensor) {
            Some(memory) if frame.kind() == SensorKind::Lidar => {
                let viewpoint = &frame.shot().viewpoint;
                let rows = frame.points().iter().zip(frame.beams());
                self.corrected.extend(rows.map(|(point, beam)| memory.beams.corrected(point, *beam, viewpoint)));
            }
            _ => self.corrected.extend_from_slice(frame.points()),
        }
    }

    fn insert(&mut self, frame: &TrackFrame, t_rig_target: &Isometry3<f64>) {
        let inverse = t_rig_target.inverse();
        let rows = self.corrected.iter().zip(frame.normals()).zip(frame.sigma_m());
        let observed = rows.map(|((point, normal), sigma_m)| Observed {
            place: inverse * point,
            normal: inverse * normal,
            sigma_m: *sigma_m,
        });
        let noisiest = frame.sigma_m().iter().copied().fold(0.0, f64::max);
        let t = frame.shot().t;
        self.is_pictured |= frame.kind() == SensorKind::Kinect;
        let slope_rad = if self.is_pictured { CAMERA_SLOPE_RAD } else { LIDAR_SLOPE_RAD };
        self.model.insert(observed, noisiest, slope_rad, t);
        if let Some(memory) = self.memory(frame.shot().sensor) {
            memory.inserted = Some(t_rig_target.rotation);
        }
    }

    /// A sensor's memory, made when it is first asked for.
    fn memory(&mut self, sensor: usize) -> Option<&mut Memory> {
        if sensor >= MOST_SENSORS {
            return None;
        }
        if self.sensors.len() <= sensor {
            self.sensors.resize_with(sensor + 1, Memory::default);
        }
        self.sensors.get_mut(sensor)
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

//! The sensors as the estimation sees them, and their epochs as frames to be registered.

use super::settings::Trust;
use crate::config::CoreConfig;
use crate::epoch::{Epoch, Scan};
use crate::track::{LidarReturn, Pixel, RigMotion, Shot, TrackFrame};
use crate::ukf::{SensorPrior, StatedUncertainty};
use nalgebra::{Isometry3, Point3, Vector3};
use tumbled_model::{RigNs, SensorId};

/// Standard deviation of a LiDAR's range, the beams' own biases apart, m (method.md §7).
const RANGE_SIGMA_M: f64 = 0.0165;
/// Of what a LiDAR can see of the region, the least share for a crossing to be whole.
const WHOLE_CROSSING: f64 = 0.8;

/// One sensor that measures points.
#[derive(Clone, Debug)]
pub(super) struct PointSensor {
    /// Its name.
    pub(super) id: SensorId,
    /// Whether it is a Kinect; else a LiDAR.
    pub(super) is_kinect: bool,
    /// Sensor coordinates to rig coordinates.
    pub(super) t_rig_sensor: Isometry3<f64>,
    /// How well it is known.
    trust: Trust,
    /// Of a LiDAR's crossings so far, the largest share of the region that was seen.
    widest: Option<f64>,
    /// When it last measured the target.
    pub(super) measured: Option<RigNs>,
}

/// The rig's sensors, cameras first.
pub(super) fn of_config(config: &CoreConfig) -> Vec<PointSensor> {
    let sensor = |id: &SensorId, is_kinect, t_rig_sensor| PointSensor {
        id: id.clone(),
        is_kinect,
        t_rig_sensor,
        trust: config.estimate.trust(id),
        widest: None,
        measured: None,
    };
    let kinects = config.kinects.iter().map(|k| sensor(&k.id, true, k.t_rig_kinect.isometry));
    let lidars = config.lidars.iter().map(|l| sensor(&l.id, false, l.t_rig_lidar.isometry));
    kinects.chain(lidars).collect()
}

impl PointSensor {
    /// What the filter believes of it, for a target at `center`, rig frame.
    pub(super) fn prior(&self, center: &Vector3<f64>) -> SensorPrior {
        // The config says whole angles and lengths, the filter wants one axis of three.
        let axis = 1.0 / libm::sqrt(3.0);
        let stated = StatedUncertainty {
            rotation_rad: self.trust.rotation_rad * axis,
            translation_m: self.trust.translation_m * axis,
            time_s: self.trust.time_s,
            depth_scale: self.trust.depth_scale,
        };
        let nominal = Isometry3::from_parts((*center).into(), self.t_rig_sensor.rotation);
        let distance_m = (center - self.t_rig_sensor.translation.vector).norm();
        if self.is_kinect {
            SensorPrior::kinect(nominal, distance_m, &stated)
        } else {
            SensorPrior::lidar(nominal, distance_m, &stated)
        }
    }

    /// Whether a LiDAR saw less of the region with an epoch than it can: one that the stream begins or breaks off in shows a part
    /// of the target, and the origin of a target begun with it would be that part's. What lies beyond a limited view never shows.
    pub(super) fn saw_a_part(&mut self, epoch: &Epoch) -> bool {
        let Scan::Lidar(scan) = &epoch.scan else { return false };
        let widest = self.widest.unwrap_or(1.0);
        self.widest = Some(self.widest.unwrap_or(0.0).max(scan.coverage));
        scan.coverage < WHOLE_CROSSING * widest
    }

    /// The target's points of an epoch as a frame; `number` is the sensor's, `target` the points' indices.
    pub(super) fn frame(&self, number: usize, epoch: &Epoch, target: &[u32], motion: &RigMotion) -> TrackFrame {
        let viewpoint = Point3::from(self.t_rig_sensor.translation.vector);
        let shot = Shot { sensor: number, t: epoch.t, viewpoint };
        let (x, y, z) = (&epoch.rig.x, &epoch.rig.y, &epoch.rig.z);
        let place = |index: usize| Some(Point3::new(*x.get(index)?, *y.get(index)?, *z.get(index)?));
        match &epoch.scan {
            Scan::Kinect(scan) => {
                let sigma = scan.points.sigma_z();
                let pixel = |index: &u32| {
                    let index = *index as usize;
                    Some(Pixel { point: place(index)?, sigma_m: *sigma.get(index)? })
                };
                TrackFrame::of_kinect(shot, target.iter().filter_map(pixel))
            }
            Scan::Lidar(scan) => {
                let from_stamp = epoch.t - scan.stamp;
                let ret = |index: &u32| {
                    let index = *index as usize;
                    let dt_ns = i64::from(*scan.points.dt_ns.get(index)?) - from_stamp.0;
                    let beam = *scan.points.laser.get(index)?;
                    Some(LidarReturn { point: place(index)?, beam, dt_s: dt_ns as f32 * 1e-9 })
                };
                TrackFrame::of_lidar(shot, target.iter().filter_map(ret), RANGE_SIGMA_M, motion)
            }
        }
    }
}

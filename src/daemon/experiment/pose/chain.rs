//! GICP from frame to frame: what following a target without a model and without a filter comes to.

use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use tumbled_core::register::baseline::IterationOptions;
use tumbled_core::register::{Cloud, Method, MethodOptions, Prior, SensorKind, View, register};
use tumbled_core::{Epoch, Scan, Workers};
use tumbled_model::{RigNs, Span};
use tumbled_sim::noise::Noise;

use super::methods::Posed;
use crate::experiment::recorded::seen;
use crate::experiment::thin;

/// From one frame of the chain to the next: at 5°/s a target turns by 1° in that time, and more links would drift more.
const EVERY: Span = Span(190_000_000);
/// Points of a frame at most: the published middle density.
const POINTS: usize = 2653;

/// A chain of frames of one Kinect.
#[derive(Debug)]
pub struct Chain {
    t_rig_kinect: Isometry3<f64>,
    seed: u64,
    /// The last frame: when, and its cloud in the camera's frame.
    last: Option<(RigNs, Cloud)>,
    /// The camera's coordinates at the first frame to those now: how the target has moved since.
    moved: Isometry3<f64>,
    /// The middle of the first frame's points, camera's frame.
    origin: Vector3<f64>,
    links: u64,
}

impl Chain {
    /// Of a camera with this mounting; thinning begins with the seed.
    pub fn new(t_rig_kinect: Isometry3<f64>, seed: u64) -> Self {
        Self { t_rig_kinect, seed, last: None, moved: Isometry3::identity(), origin: Vector3::zeros(), links: 0 }
    }

    /// The next link, if it is time for one; the first frame's axes are the target's.
    pub fn take(&mut self, epoch: &Epoch) -> Option<Posed> {
        let is_due = self.last.as_ref().is_none_or(|(t, _)| epoch.t - *t >= EVERY);
        if !is_due || !matches!(epoch.scan, Scan::Kinect(_)) {
            return None;
        }
        let points = seen(epoch)?;
        let mut noise = Noise::new(self.seed, "chain.thin", self.links);
        let points = thin::voxelised(&points, POINTS, &mut noise);
        let cloud = Cloud { sensor: SensorKind::Kinect, points, viewpoint: Some(Point3::origin()), view: View::Bare };
        match &self.last {
            None => self.origin = middle(&cloud.points),
            Some((_, before)) => {
                let prior = Prior {
                    t_reference_moving: Isometry3::identity(),
                    sigma_rotation_rad: 2f64.to_radians(),
                    sigma_translation_m: 0.02,
                };
                // A link is a small motion: iterations that stop at a tenth of a degree would leave a tenth of it out.
                let points = IterationOptions {
                    rotation_epsilon_rad: 1e-6,
                    translation_epsilon_m: 1e-6,
                    ..IterationOptions::points()
                };
                let options = MethodOptions { points, ..MethodOptions::default() };
                // A link that fails leaves the frame out, and the next one reaches farther.
                let link = register(&cloud, before, Method::Gicp, Some(&prior), &options, &Workers::none()).ok()?;
                // It takes the new frame's coordinates to the old one's: the target has moved the other way.
                self.moved = link.t_reference_moving.inverse() * self.moved;
            }
        }
        self.links += 1;
        self.last = Some((epoch.t, cloud));
        let t_rig_target = self.t_rig_kinect * self.moved * Translation3::from(self.origin);
        Some(Posed { t: epoch.t, t_rig_target, rate_rps: None })
    }
}

fn middle(points: &[Point3<f32>]) -> Vector3<f64> {
    let sum: Vector3<f64> = points.iter().map(|point| point.coords.cast::<f64>()).sum();
    sum / points.len().max(1) as f64
}

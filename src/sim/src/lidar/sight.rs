//! Which beams can meet anything: bounding spheres against a firing group, then against each beam.

use super::beams::{Beam, Beams};
use crate::world::World;
use core::f64::consts::{PI, TAU};
use nalgebra::{Isometry3, Point3, Vector3};
use tumbled_model::RigNs;

/// Added to bounding spheres: bodies move while a group fires (10 m/s for 0.1 ms), and sums round. Metres.
const SPHERE_SLACK_M: f64 = 0.005;

/// Bodies that a group is tried against one by one; in a world of more every beam is cast.
const MAX_SPHERES: usize = 32;

/// Where a beam leaves and looks, lidar frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Aim {
    pub(super) origin: Point3<f64>,
    pub(super) direction: Vector3<f64>,
    /// Level, to the left of the direction.
    left: Vector3<f64>,
}

impl Aim {
    pub(super) fn new(beam: &Beam, sin_head: f64, cos_head: f64, turned: f64) -> Self {
        let (sin_turn, cos_turn) = libm::sincos(turned);
        let sin_rest = beam.sin_offset * cos_turn + beam.cos_offset * sin_turn;
        let cos_rest = beam.cos_offset * cos_turn - beam.sin_offset * sin_turn;
        let sin = sin_head * cos_rest + cos_head * sin_rest;
        let cos = cos_head * cos_rest - sin_head * sin_rest;
        let left = Vector3::new(sin, cos, 0.0);
        Self {
            origin: Point3::from(left * beam.left_m + Vector3::z() * beam.height_m),
            direction: Vector3::new(beam.cos_elevation * cos, -beam.cos_elevation * sin, beam.sin_elevation),
            left,
        }
    }

    /// The offsets to the side and up that a ray `apart_rad` from the middle has.
    pub(super) fn across(&self, apart_rad: f64) -> [Vector3<f64>; 2] {
        [self.left * apart_rad, self.direction.cross(&self.left) * apart_rad]
    }
}

/// The bodies that a group's beams can meet, as bounding spheres in the lidar frame.
pub(super) struct Sight {
    spheres: [(Point3<f64>, f64); MAX_SPHERES],
    pub(super) count: usize,
    /// The sensor stands inside a body's sphere: every beam can meet it.
    pub(super) inside: bool,
}

impl Sight {
    pub(super) fn of(
        world: &World,
        t: RigNs,
        t_rig_lidar: &Isometry3<f64>,
        beams: &Beams,
        head_rad: f64,
        footprint_rad: f64,
        turn_rad_per_ns: f64,
    ) -> Self {
        let mut sight = Self { spheres: [(Point3::origin(), 0.0); MAX_SPHERES], count: 0, inside: false };
        // Beams of this group point at most so far from where the head points.
        let half_turn_rad = 0.5 * turn_rad_per_ns * f64::from(beams.last_ns());
        let middle_rad = head_rad + half_turn_rad;
        let wide_rad = beams.widest_rad + half_turn_rad + footprint_rad;
        for sphere in world.at(t).spheres() {
            let centre = t_rig_lidar.inverse_transform_point(&sphere.centre);
            let radius = sphere.radius_m + SPHERE_SLACK_M;
            let level_m = (centre.x * centre.x + centre.y * centre.y).sqrt();
            let reach_m = radius + beams.reach_m;
            if centre.coords.norm() <= reach_m {
                sight.inside = true;
                continue;
            }
            // A sphere that stands over or under the sensor is at every azimuth.
            if level_m > reach_m {
                let away = libm::atan2(-centre.y, centre.x) - middle_rad;
                let away = (away - TAU * libm::round(away / TAU)).abs();
                if away > (wide_rad + libm::asin(reach_m / level_m)).min(PI) {
                    continue;
                }
            }
            match sight.spheres.get_mut(sight.count) {
                Some(place) => {
                    *place = (centre, radius);
                    sight.count += 1;
                }
                None => sight.inside = true,
            }
        }
        sight
    }

    /// Whether a beam passes through one of the spheres.
    pub(super) fn meets(&self, aim: &Aim, footprint_rad: f64) -> bool {
        self.spheres.iter().take(self.count).any(|(centre, radius)| {
            let from = centre - aim.origin;
            let along = from.dot(&aim.direction);
            let radius = radius + footprint_rad * along.max(0.0);
            along > -radius && from.norm_squared() - along * along <= radius * radius
        })
    }
}

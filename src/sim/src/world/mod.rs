//! Bodies in motion, and what a ray hits.
//!
//! A ray costs little where it meets nothing: a body is first tried as a sphere in the rig's frame, and only a ray
//! through that is moved into the body's frame and walks its tree.

mod bvh;
mod facet;

use crate::motion::{BodyState, Motion};
use crate::shape::{Material, Mesh};
use bvh::{Bvh, Line};
use nalgebra::{Isometry3, Point3, Vector3};
use std::sync::Arc;
use tumbled_model::RigNs;

/// What a body is, for masks and truth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    /// The target; in a calibration scene the board or the sphere.
    Target,
    /// What it stands on or hangs from: turns with the stage or not, and is no part of the target.
    Mount,
    /// Floor, walls, posts.
    Room,
    /// A person or another thing that should not be there.
    Intruder,
}

/// A body.
#[derive(Clone, Debug)]
pub struct Body {
    /// What it is.
    pub role: Role,
    /// Its surface.
    pub mesh: Arc<Mesh>,
    /// Where it is.
    pub motion: Arc<dyn Motion>,
}

/// A straight line from a point on, in the rig's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it begins, m.
    pub origin: Point3<f64>,
    /// Its direction, length 1.
    pub direction: Vector3<f64>,
}

/// Where a ray meets a surface first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance from the ray's origin, m.
    pub range_m: f64,
    /// The surface's normal on the side that is seen, rig's frame, length 1.
    pub normal: Vector3<f64>,
    /// What it is made of.
    pub material: Material,
    /// Whose surface.
    pub role: Role,
}

/// Everything there is to see.
#[derive(Clone, Debug, Default)]
pub struct World {
    bodies: Vec<Body>,
    /// Each body's surface; bodies that share a mesh share it.
    surfaces: Vec<Arc<Bvh>>,
}

/// Bodies that a [`Snapshot`] places without asking for memory; a scene has fewer.
const USUAL_BODIES: usize = 8;

/// The world at one instant: every body where it is then. Making one costs as much as its bodies' motions, and asks
/// for no memory in a world of up to eight bodies: make one per firing.
#[derive(Clone, Debug)]
pub struct Snapshot<'a> {
    usual: [Option<Placed<'a>>; USUAL_BODIES],
    more: Vec<Placed<'a>>,
}

/// A sphere that holds a body, for asking cheaply whether a sensor can see it at all.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodySphere {
    /// Whose.
    pub role: Role,
    /// Its middle, rig frame.
    pub centre: Point3<f64>,
    /// m.
    pub radius_m: f64,
}

/// A body where it is at the instant.
#[derive(Clone, Debug)]
struct Placed<'a> {
    role: Role,
    surface: &'a Bvh,
    t_rig_body: Isometry3<f64>,
    /// The middle of its sphere, rig frame.
    centre: Point3<f64>,
}

impl World {
    /// A world of these bodies. Builds each mesh's tree: tens of milliseconds for ten thousand triangles.
    pub fn new(bodies: Vec<Body>) -> Self {
        let mut surfaces: Vec<Arc<Bvh>> = Vec::with_capacity(bodies.len());
        for (n, body) in bodies.iter().enumerate() {
            let same = bodies.iter().take(n).zip(&surfaces).find(|(other, _)| Arc::ptr_eq(&other.mesh, &body.mesh));
            let surface = same.map_or_else(|| Arc::new(Bvh::new(&body.mesh)), |(_, surface)| Arc::clone(surface));
            surfaces.push(surface);
        }
        Self { bodies, surfaces }
    }

    /// The bodies.
    pub fn bodies(&self) -> &[Body] {
        &self.bodies
    }

    /// The target's state at an instant; `None`: there is no target.
    pub fn target(&self, t: RigNs) -> Option<BodyState> {
        let target = self.bodies.iter().find(|body| body.role == Role::Target)?;
        Some(target.motion.state(t))
    }

    /// The world at an instant.
    pub fn at(&self, t: RigNs) -> Snapshot<'_> {
        let mut placed = self.placed(t);
        Snapshot { usual: core::array::from_fn(|_| placed.next()), more: placed.collect() }
    }

    /// What a ray meets first at an instant, farther than `nearest_m`. For one ray at its own time; where several share
    /// a time, [`World::at`] places the bodies once for all of them.
    pub fn cast_at(&self, t: RigNs, ray: &Ray, nearest_m: f64) -> Option<Hit> {
        let mut first = None;
        self.placed(t).for_each(|placed| placed.cast(ray, nearest_m, &mut first));
        first
    }

    fn placed(&self, t: RigNs) -> impl Iterator<Item = Placed<'_>> {
        self.bodies.iter().zip(&self.surfaces).map(move |(body, surface)| {
            let t_rig_body = body.motion.state(t).t_rig_body;
            Placed { role: body.role, surface, t_rig_body, centre: t_rig_body * surface.centre }
        })
    }
}

impl Snapshot<'_> {
    /// What a ray meets first, farther than `nearest_m`; of two at the same range, the body that comes first.
    pub fn cast(&self, ray: &Ray, nearest_m: f64) -> Option<Hit> {
        let mut first = None;
        self.placed().for_each(|placed| placed.cast(ray, nearest_m, &mut first));
        first
    }

    /// Whether a surface stands between two points, farther than `clearance_m` from either: then light from the one
    /// does not reach the other. The clearance keeps a point on a surface from hiding itself.
    pub fn occluded(&self, from: &Point3<f64>, to: &Point3<f64>, clearance_m: f64) -> bool {
        let way = to - from;
        let length = way.norm();
        if length <= 2.0 * clearance_m {
            return false;
        }
        let ray = Ray { origin: *from, direction: way / length };
        self.placed().any(|placed| placed.blocks(&ray, clearance_m, length - clearance_m))
    }

    /// The spheres that hold the bodies, in their order.
    pub fn spheres(&self) -> impl Iterator<Item = BodySphere> {
        self.placed().map(|placed| BodySphere {
            role: placed.role,
            centre: placed.centre,
            radius_m: placed.surface.radius,
        })
    }

    fn placed(&self) -> impl Iterator<Item = &Placed<'_>> {
        self.usual.iter().map_while(Option::as_ref).chain(&self.more)
    }
}

impl Placed<'_> {
    /// Puts what a ray meets first here into `first`, if it is nearer.
    fn cast(&self, ray: &Ray, nearest_m: f64, first: &mut Option<Hit>) {
        let farthest_m = first.map_or(f64::INFINITY, |hit| hit.range_m);
        if !self.in_reach(ray, nearest_m, farthest_m) {
            return;
        }
        let Some((range_m, facet)) = self.surface.first(&self.line(ray), nearest_m, farthest_m) else { return };
        if range_m >= farthest_m {
            return;
        }
        let outward = self.t_rig_body * facet.normal();
        let normal = if outward.dot(&ray.direction) > 0.0 { -outward } else { outward };
        *first = Some(Hit { range_m, normal, material: facet.material, role: self.role });
    }

    fn blocks(&self, ray: &Ray, nearest_m: f64, farthest_m: f64) -> bool {
        self.in_reach(ray, nearest_m, farthest_m) && self.surface.any(&self.line(ray), nearest_m, farthest_m)
    }

    /// Whether a ray passes through the body's sphere between two ranges.
    fn in_reach(&self, ray: &Ray, nearest_m: f64, farthest_m: f64) -> bool {
        let to_centre = self.centre - ray.origin;
        let along = to_centre.dot(&ray.direction);
        let radius = self.surface.radius;
        let beside_squared = to_centre.norm_squared() - along * along;
        // Beside first: it is what most rays of a turning sensor fail.
        beside_squared <= radius * radius && along + radius > nearest_m && along - radius <= farthest_m
    }

    fn line(&self, ray: &Ray) -> Line {
        Line::new(
            self.t_rig_body.inverse_transform_point(&ray.origin),
            self.t_rig_body.inverse_transform_vector(&ray.direction),
        )
    }
}

#[cfg(test)]
mod tests;

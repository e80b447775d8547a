//! Bodies in motion, and what a ray hits.

use crate::motion::{BodyState, Motion};
use crate::shape::{Material, Mesh, normal};
use nalgebra::{Isometry3, Point3, Vector3};
use std::sync::Arc;
use tumbled_model::RigNs;

/// What a body is, for masks and truth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Role {
    /// The target.
    Target,
    /// What it stands on or hangs from: turns with the stage or not, and is no part of the target.
    Mount,
    /// Floor, walls, posts.
    Room,
    /// A person or another thing that should not be there.
    Intruder,
    /// A calibration board or sphere.
    Fixture,
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
}

/// The world at one instant: every body where it is then.
#[derive(Clone, Debug)]
pub struct Snapshot<'a> {
    bodies: Vec<(&'a Body, Isometry3<f64>)>,
}

impl World {
    /// A world of these bodies.
    pub fn new(bodies: Vec<Body>) -> Self {
        Self { bodies }
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
        Snapshot { bodies: self.bodies.iter().map(|body| (body, body.motion.state(t).t_rig_body)).collect() }
    }
}

impl Snapshot<'_> {
    /// What a ray meets first, farther than `nearest_m`.
    pub fn cast(&self, ray: &Ray, nearest_m: f64) -> Option<Hit> {
        let mut first: Option<Hit> = None;
        for (body, t_rig_body) in &self.bodies {
            let t_body_rig = t_rig_body.inverse();
            let (origin, direction) = (t_body_rig * ray.origin, t_body_rig * ray.direction);
            for triangle in &body.mesh.triangles {
                let Some(corners) = body.mesh.corners(triangle) else { continue };
                let Some(range_m) = meet(&origin, &direction, corners) else { continue };
                if range_m <= nearest_m || first.is_some_and(|hit| hit.range_m <= range_m) {
                    continue;
                }
                let outward = t_rig_body * normal(corners);
                let normal = if outward.dot(&ray.direction) > 0.0 { -outward } else { outward };
                first = Some(Hit { range_m, normal, material: triangle.material, role: body.role });
            }
        }
        first
    }
}

/// Where a line meets a triangle (Möller and Trumbore 1997), from either side; negative behind the origin.
fn meet(origin: &Point3<f64>, direction: &Vector3<f64>, [a, b, c]: [Point3<f64>; 3]) -> Option<f64> {
    let (ab, ac) = (b - a, c - a);
    let p = direction.cross(&ac);
    let determinant = ab.dot(&p);
    if determinant == 0.0 {
        return None;
    }
    let from_a = origin - a;
    let u = from_a.dot(&p) / determinant;
    let q = from_a.cross(&ab);
    let v = direction.dot(&q) / determinant;
    let inside = u >= 0.0 && v >= 0.0 && u + v <= 1.0;
    inside.then(|| ac.dot(&q) / determinant)
}

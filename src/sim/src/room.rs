//! What stands around a target: floor and walls, what carries the target, a person who walks by.

use crate::motion::{Motion, Still, Superposed};
use crate::shape::solid::{cuboid, cylinder, sphere};
use crate::shape::{Material, Mesh};
use crate::world::{Body, Role};
use nalgebra::{Isometry3, Point3, Vector3};
use std::sync::Arc;

/// A rectangular room without a ceiling, its walls along the rig's x and y.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Room {
    /// The middle of the floor, rig frame, m.
    pub floor: Point3<f64>,
    /// Length along x, along y, and the walls' height, m.
    pub size_m: Vector3<f64>,
}

impl Room {
    /// The floor and the four walls: one light surface that looks inward.
    pub fn body(&self) -> Body {
        let mut mesh = cuboid(self.size_m, 1, |_, _| Material::Matt);
        let top = self.size_m.z / 2.0;
        let all = core::mem::take(&mut mesh.triangles);
        let below_top = all.into_iter().filter(|triangle| {
            mesh.corners(triangle).is_some_and(|corners| corners.iter().any(|corner| corner.z < top))
        });
        // Seen from inside: the other way round.
        mesh.triangles = below_top
            .map(|mut triangle| {
                triangle.corners.reverse();
                triangle
            })
            .collect();
        still(Role::Room, mesh, self.floor + Vector3::z() * top)
    }
}

/// A round post that stands on `foot` (rig frame, m): a stage's column ([`Role::Mount`]) or a part of the building
/// ([`Role::Room`]).
pub fn post(role: Role, foot: Point3<f64>, radius_m: f64, height_m: f64, material: Material) -> Body {
    still(role, cylinder(radius_m, height_m, 24, material), foot)
}

/// A turntable under a target: a dark plate of this radius, 3 cm thick, its upper side at `top` (rig frame, m), on a
/// column down to the floor at height `floor_z_m`. The plate is round: it looks the same however far it has turned.
pub fn stage(top: Point3<f64>, plate_radius_m: f64, floor_z_m: f64) -> Body {
    const PLATE_M: f64 = 0.03;
    // The column ends inside the plate, so that no two surfaces lie in one plane.
    let height = (top.z - floor_z_m - PLATE_M / 2.0).max(PLATE_M);
    let mut mesh = Mesh::default();
    mesh.add(&cylinder(plate_radius_m, PLATE_M, 48, Material::Dark), &Isometry3::translation(0.0, 0.0, -PLATE_M));
    let column = cylinder(plate_radius_m / 3.0, height, 24, Material::Matt);
    mesh.add(&column, &Isometry3::translation(0.0, 0.0, -PLATE_M / 2.0 - height));
    still(Role::Mount, mesh, top)
}

/// A round stand that carries a target and goes where it goes, upright. It ends at the target's origin, and below the
/// floor of its room, where nobody sees it; `reach_m`: how far down it goes.
pub fn stand(target: Arc<dyn Motion>, radius_m: f64, reach_m: f64) -> Body {
    let mut mesh = Mesh::default();
    mesh.add(&cylinder(radius_m, reach_m, 24, Material::Dark), &Isometry3::translation(0.0, 0.0, -reach_m));
    let attitude = Arc::new(Still(Isometry3::identity()));
    Body { role: Role::Mount, mesh: Arc::new(mesh), motion: Arc::new(Superposed { path: target, attitude }) }
}

/// A person of 1.75 m who moves as told: see [`crate::motion::path::Walk`].
pub fn person(motion: Arc<dyn Motion>) -> Body {
    Body { role: Role::Intruder, mesh: Arc::new(person_mesh()), motion }
}

/// Two legs in dark cloth, body, arms, neck and head. Origin: on the floor between the feet; x ahead, z up.
fn person_mesh() -> Mesh {
    let mut mesh = Mesh::default();
    let mut add = |solid: Mesh, x: f64, y: f64, z: f64| mesh.add(&solid, &Isometry3::translation(x, y, z));
    for side in [-1.0, 1.0] {
        // In mid-stride: one leg a little ahead.
        add(cylinder(0.08, 0.88, 12, Material::Dark), 0.08 * side, 0.1 * side, 0.0);
        add(cylinder(0.045, 0.62, 12, Material::Matt), -0.04 * side, 0.26 * side, 0.82);
    }
    add(cuboid(Vector3::new(0.24, 0.42, 0.62), 1, |_, _| Material::Matt), 0.0, 0.0, 1.16);
    add(cylinder(0.06, 0.12, 12, Material::Matt), 0.0, 0.0, 1.44);
    add(sphere(0.12, 16, Material::Matt), 0.02, 0.0, 1.63);
    mesh
}

fn still(role: Role, mesh: Mesh, at: Point3<f64>) -> Body {
    Body { role, mesh: Arc::new(mesh), motion: Arc::new(Still(Isometry3::from(at.coords))) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::path::Walk;
    use crate::shape::measure::{area, extents};
    use crate::world::{Ray, World};
    use tumbled_model::RigNs;

    const ROOM: Room = Room { floor: Point3::new(2.0, 0.0, -1.2), size_m: Vector3::new(8.0, 6.0, 3.0) };

    fn cast(world: &World, t_s: i64, from: [f64; 3], toward: [f64; 3]) -> Option<(f64, Role, Vector3<f64>)> {
        let ray = Ray { origin: Point3::from(from), direction: Vector3::from(toward).normalize() };
        world.cast_at(RigNs(t_s * 1_000_000_000), &ray, 0.0).map(|hit| (hit.range_m, hit.role, hit.normal))
    }

    fn near(found: Option<(f64, Role, Vector3<f64>)>, range: f64, role: Role, normal: Vector3<f64>) {
        let (r, who, n) = found.unwrap();
        assert!((r - range).abs() < 1e-9 && who == role && (n - normal).norm() < 1e-9, "{r} {who:?} {n}");
    }

    #[test]
    fn a_room_is_closed_but_for_its_ceiling_and_looks_inward() {
        let body = ROOM.body();
        // Floor 8 × 6, walls 2 · (8 + 6) · 3.
        assert!((area(&body.mesh) - 132.0).abs() < 1e-9);
        for triangle in &body.mesh.triangles {
            let corners = body.mesh.corners(triangle).unwrap();
            assert!(crate::shape::normal(corners).dot(&corners[0].coords) < 0.0);
        }
        let world = World::new(vec![body]);
        // From the rig's origin: walls at x = −2 and 6, y = ±3, the floor 1.2 m below.
        near(cast(&world, 0, [0.0; 3], [1.0, 0.0, 0.0]), 6.0, Role::Room, -Vector3::x());
        near(cast(&world, 0, [0.0; 3], [-1.0, 0.0, 0.0]), 2.0, Role::Room, Vector3::x());
        near(cast(&world, 0, [0.0; 3], [0.0, -1.0, 0.0]), 3.0, Role::Room, Vector3::y());
        near(cast(&world, 0, [0.0; 3], [0.0, 0.0, -1.0]), 1.2, Role::Room, Vector3::z());
        assert_eq!(cast(&world, 0, [0.0; 3], [0.0, 0.0, 1.0]), None);
    }

    #[test]
    fn a_stage_stands_on_the_floor_and_carries_its_plate() {
        let world = World::new(vec![stage(Point3::new(2.0, 0.0, -0.5), 0.3, -1.2)]);
        near(cast(&world, 0, [2.1, 0.1, 0.0], [0.0, 0.0, -1.0]), 0.5, Role::Mount, Vector3::z());
        let (low, high) = extents(&world.bodies()[0].mesh);
        assert!((low.z + 0.7).abs() < 1e-12 && high.z.abs() < 1e-12 && (high.x - 0.3).abs() < 1e-12);
        let world = World::new(vec![post(Role::Room, Point3::new(0.0, 3.0, -1.2), 0.1, 2.0, Material::Matt)]);
        near(cast(&world, 0, [0.0, 3.0, 2.0], [0.0, 0.0, -1.0]), 1.2, Role::Room, Vector3::z());
    }

    #[test]
    fn a_stand_goes_with_its_target_and_stays_upright() {
        let turned = Isometry3::new(Vector3::new(2.0, 0.0, 0.5), Vector3::x() * 1.5);
        let world = World::new(vec![stand(Arc::new(Still(turned)), 0.02, 3.0)]);
        // The side toward the rig's origin, 0.1 m below the target's origin.
        near(
            cast(&world, 0, [0.0, 0.0, 0.4], [1.0, 0.0, 0.0]).map(|(r, who, n)| (r, who, n.map(f64::round))),
            1.98,
            Role::Mount,
            -Vector3::x(),
        );
        assert_eq!(cast(&world, 0, [0.0, 0.0, 0.6], [1.0, 0.0, 0.0]), None);
    }

    #[test]
    fn a_person_walks_through_the_room() {
        let path = [Point3::new(3.0, -2.0, -1.2), Point3::new(3.0, 2.0, -1.2)];
        let person = person(Arc::new(Walk::new(&path, 1.0, RigNs(0))));
        let (low, high) = extents(&person.mesh);
        assert!(low.z == 0.0 && (high.z - 1.75).abs() < 1e-12, "{low} {high}");
        let world = World::new(vec![ROOM.body(), person]);
        // At 2 s in the middle, facing +y: the trunk's side is at x = 3 − 0.21 m, from y = −0.12 to 0.12; the arm before
        // it, at x = 3 − 0.26 m, covers y = −0.085 to 0.005. At y = −0.1 the trunk is seen past the arm.
        near(cast(&world, 2, [0.0, -0.1, 0.1], [1.0, 0.0, 0.0]), 2.79, Role::Intruder, -Vector3::x());
        // By 4 s it has gone past; the wall is seen again.
        near(cast(&world, 4, [0.0, 0.0, 0.1], [1.0, 0.0, 0.0]), 6.0, Role::Room, -Vector3::x());
    }
}

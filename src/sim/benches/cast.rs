//! Nanoseconds per ray, and per placing of the world. `cargo bench -p tumbled-sim --bench cast`.
//!
//! Each sample casts 10 000 rays at the box bus, still at 3 m, from the rig's origin; divan's item is a ray. `beside`
//! misses its sphere, `past` goes through the sphere and misses the surface, `hit` meets it. `in_a_room` adds a mesh
//! of twelve large triangles around it all.

use divan::Bencher;
use divan::counter::ItemsCount;
use nalgebra::{Isometry3, Point3, Vector3};
use std::hint::black_box;
use std::sync::Arc;
use tumbled_model::RigNs;
use tumbled_sim::motion::profile::Profile;
use tumbled_sim::motion::tumble::Tumble;
use tumbled_sim::motion::turntable::Turntable;
use tumbled_sim::motion::{Motion, Still};
use tumbled_sim::noise::Noise;
use tumbled_sim::shape::{Material, Mesh, solid};
use tumbled_sim::target::TargetKind;
use tumbled_sim::world::{Body, Ray, Role, World};

fn main() {
    divan::main();
}

const RAYS: usize = 10_000;
const T: RigNs = RigNs(0);

fn body(role: Role, mesh: Mesh, motion: Still) -> Body {
    Body { role, mesh: Arc::new(mesh), motion: Arc::new(motion) }
}

fn world(room: bool) -> World {
    let turn = nalgebra::UnitQuaternion::from_scaled_axis(Vector3::new(0.4, 0.3, -0.8));
    let pose = Isometry3::from_parts(nalgebra::Translation3::new(3.0, 0.0, 0.0), turn);
    let mut bodies = vec![body(Role::Target, TargetKind::BoxBus.mesh(), Still(pose))];
    if room {
        let walls = solid::cuboid(Vector3::new(12.0, 8.0, 3.0), 1, |_, _| Material::Matt);
        bodies.push(body(Role::Room, walls, Still(Isometry3::identity())));
    }
    World::new(bodies)
}

/// Rays toward the sphere's square, or beside it, that end as asked.
fn rays(kind: &str) -> Vec<Ray> {
    let world = world(false);
    let snapshot = world.at(T);
    let sphere = snapshot.spheres().next().expect("one body");
    let mut noise = Noise::new(1, "bench", 0);
    let mut rays = Vec::with_capacity(RAYS);
    while rays.len() < RAYS {
        let mut across = || (2.0 * noise.uniform() - 1.0) * sphere.radius_m;
        let (y, z) = (across(), across());
        let side = if kind == "beside" { 3.0 } else { 0.0 };
        let direction = (sphere.centre + Vector3::new(0.0, y + side, z)).coords.normalize();
        let ray = Ray { origin: Point3::origin(), direction };
        let beside = sphere.centre.coords.cross(&direction).norm() > sphere.radius_m;
        let hit = snapshot.cast(&ray, 0.0).is_some();
        let wanted = match kind {
            "beside" => beside,
            "past" => !beside && !hit,
            _ => hit,
        };
        if wanted {
            rays.push(ray);
        }
    }
    rays
}

#[divan::bench(args = ["beside", "past", "hit"])]
fn box_bus(bencher: Bencher<'_, '_>, kind: &str) {
    cast(bencher, &world(false), &rays(kind));
}

#[divan::bench(args = ["beside", "past", "hit"])]
fn box_bus_in_a_room(bencher: Bencher<'_, '_>, kind: &str) {
    cast(bencher, &world(true), &rays(kind));
}

fn cast(bencher: Bencher<'_, '_>, world: &World, rays: &[Ray]) {
    let snapshot = world.at(T);
    bencher
        .counter(ItemsCount::new(rays.len()))
        .bench(|| rays.iter().filter_map(|ray| snapshot.cast(black_box(ray), 0.4)).map(|hit| hit.range_m).sum::<f64>());
}

#[divan::bench(args = ["still", "turntable", "tumble"])]
fn place_one_body(bencher: Bencher<'_, '_>, kind: &str) {
    let turning = Turntable {
        axis: Vector3::z_axis(),
        centre: Point3::new(2.0, 0.0, 0.0),
        mount: Isometry3::identity(),
        start_rad: 0.0,
        profile: Profile::Constant { rate_rps: 0.35 },
    };
    let (inertia, rates) = (Vector3::new(1.0, 1.5, 2.0), Vector3::new(0.1, 0.05, 0.4));
    let tumbling = Tumble::new(inertia, rates, Isometry3::identity(), Point3::origin()).expect("a body has these");
    let motion: Arc<dyn Motion> = match kind {
        "still" => Arc::new(Still(Isometry3::identity())),
        "turntable" => Arc::new(turning),
        _ => Arc::new(tumbling),
    };
    let world = World::new(vec![Body { role: Role::Target, mesh: Arc::new(TargetKind::BoxBus.mesh()), motion }]);
    bencher
        .counter(ItemsCount::new(1_000_usize))
        .bench(|| (0..1_000).filter(|k| world.at(black_box(RigNs(*k * 55_296))).spheres().next().is_some()).count());
}

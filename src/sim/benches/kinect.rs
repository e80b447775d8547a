//! Time a simulated Kinect frame takes on one thread.
//!
//! `cargo bench -p tumbled-sim --bench kinect`. A box bus of 0.8 m with two panels, turning, without and with a room.

use divan::Bencher;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use std::sync::Arc;
use tumbled_kinect::Intrinsics;
use tumbled_model::RigNs;
use tumbled_sim::kinect::{KinectModel, KinectParameters};
use tumbled_sim::motion::{BodyState, Motion, Still};
use tumbled_sim::shape::{Material, Mesh, Triangle};
use tumbled_sim::world::{Body, Role, World};

fn main() {
    divan::main();
}

fn cuboid([x, y, z]: [f64; 3]) -> Mesh {
    let sign = |corner: usize, bit: usize| if corner >> bit & 1 == 1 { 0.5 } else { -0.5 };
    let vertices = (0..8).map(|c| Point3::new(x * sign(c, 0), y * sign(c, 1), z * sign(c, 2))).collect();
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangle = |corners| Triangle { corners, material: Material::Matt };
    let triangles = faces.iter().flat_map(|&[a, b, c, d]| [triangle([a, b, c]), triangle([a, c, d])]).collect();
    Mesh { vertices, triangles }
}

/// 20°/s about the vertical.
#[derive(Debug)]
struct Spin(Vector3<f64>);

impl Motion for Spin {
    fn state(&self, t: RigNs) -> BodyState {
        let rate = Vector3::y() * 20_f64.to_radians();
        let rotation = UnitQuaternion::new(rate * (t.0 as f64 * 1e-9));
        let t_rig_body = Isometry3::from_parts(Translation3::from(self.0), rotation);
        BodyState { t_rig_body, velocity_mps: Vector3::zeros(), angular_velocity_rps: rate }
    }
}

fn world(metres: f64, with_room: bool) -> World {
    let mut target = cuboid([0.8, 0.6, 0.6]);
    for side in [-1.0, 1.0] {
        target.add(&cuboid([0.5, 0.4, 0.02]), &Isometry3::translation(side * 0.7, 0.0, 0.0));
    }
    let spin = Arc::new(Spin(Vector3::new(0.0, 0.0, metres)));
    let mut bodies = vec![Body { role: Role::Target, mesh: Arc::new(target), motion: spin }];
    if with_room {
        let room = Still(Isometry3::translation(0.0, -0.5, 2.0));
        bodies.push(Body { role: Role::Room, mesh: Arc::new(cuboid([6.0, 3.0, 6.0])), motion: Arc::new(room) });
    }
    World::new(bodies)
}

#[divan::bench(args = [1.5, 2.0, 3.0])]
fn target(bencher: Bencher<'_, '_>, metres: f64) {
    bench(bencher, &world(metres, false));
}

#[divan::bench(args = [1.5, 2.0, 3.0])]
fn target_in_a_room(bencher: Bencher<'_, '_>, metres: f64) {
    bench(bencher, &world(metres, true));
}

fn bench(bencher: Bencher<'_, '_>, world: &World) {
    let parameters = KinectParameters { readout_s: 0.03, ..KinectParameters::default() };
    let kinect = KinectModel::new("bench", &Intrinsics::default(), Isometry3::identity(), parameters);
    let kinect = kinect.expect("a camera");
    let mut index = 0;
    bencher.bench_local(|| {
        index += 1;
        kinect.frame(world, RigNs(index as i64 * 33_333_333), index, 1).packed()
    });
}

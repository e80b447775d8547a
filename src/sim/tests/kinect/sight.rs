//! What the rasteriser sees is what a ray hits.

use crate::scenes::SEED;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use std::sync::Arc;
use tumbled_kinect::Intrinsics;
use tumbled_model::RigNs;
use tumbled_sim::kinect::{KinectModel, KinectParameters};
use tumbled_sim::motion::Still;
use tumbled_sim::shape::{Material, Mesh, Triangle};
use tumbled_sim::world::{Body, Ray, Role, World};

/// A tetrahedron: every face has another normal.
fn tetrahedron(size: f64) -> Mesh {
    let corner = |x: f64, y: f64, z: f64| Point3::new(x * size, y * size, z * size);
    Mesh {
        vertices: vec![
            corner(1.0, 1.0, 1.0),
            corner(1.0, -1.0, -1.0),
            corner(-1.0, 1.0, -1.0),
            corner(-1.0, -1.0, 1.0),
        ],
        triangles: [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]
            .map(|corners| Triangle { corners, material: Material::Matt })
            .to_vec(),
    }
}

fn pose() -> impl Strategy<Value = Isometry3<f64>> {
    let turn = prop::array::uniform3(-3.0..3.0);
    (prop::array::uniform3(-0.6..0.6), turn).prop_map(|(at, turn)| {
        Isometry3::from_parts(Translation3::from(Vector3::from(at)), UnitQuaternion::new(Vector3::from(turn)))
    })
}

fn body(role: Role, size: f64, pose: Isometry3<f64>) -> Body {
    Body { role, mesh: Arc::new(tetrahedron(size)), motion: Arc::new(Still(pose)) }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn truth_is_what_a_ray_through_the_pixel_hits(
        near in pose(), far in pose(), around in pose(), camera in pose(), bent in any::<bool>(),
    ) {
        // Two things some 2 m away, and one that the camera stands in: its corners lie behind, beside and before it.
        let t_rig_kinect = camera;
        let forward = |metres: f64| t_rig_kinect * Isometry3::translation(0.0, 0.0, metres);
        let world = World::new(vec![
            body(Role::Target, 0.3, forward(1.8) * near),
            body(Role::Intruder, 0.4, forward(2.4) * far),
            body(Role::Room, 5.0, t_rig_kinect * around),
        ]);
        let intrinsics = match bent {
            false => Intrinsics::default(),
            true => Intrinsics { k1: -0.1, k2: 0.02, p1: 1e-3, p2: -1e-3, ..Intrinsics::default() },
        };
        let kinect = KinectModel::new("sight", &intrinsics, t_rig_kinect, KinectParameters::ideal()).expect("a camera");
        let truth = kinect.with_truth().frame(&world, RigNs(0), 0, SEED).truth.expect("asked for");
        let snapshot = world.at(RigNs(0));
        for (u, v) in (3..480).step_by(17).flat_map(|v| (5..640).step_by(19).map(move |u| (u, v))) {
            let ray = intrinsics.ray(u as f64, v as f64);
            let direction = Vector3::new(ray.x, ray.y, 1.0);
            let length = direction.norm();
            let hit = snapshot.cast(&Ray { origin: t_rig_kinect * Point3::origin(), direction: t_rig_kinect * direction / length }, 0.0);
            let expected = hit.map(|hit| (hit.range_m / length, hit.role));
            let depth = f64::from(truth.depth.at(u, v).expect("in the image"));
            prop_assert_eq!(truth.role.at(u, v).expect("in the image"), expected.map(|(_, role)| role), "{}, {}", u, v);
            let expected = expected.map_or(0.0, |(depth, _)| depth);
            prop_assert!((depth - expected).abs() <= 1e-6 * expected, "{depth}, expected {expected} at {u}, {v}");
        }
    }
}

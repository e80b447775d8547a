use super::*;
use crate::shape::measure::{assert_closed, extents, volume};

#[test]
fn every_part_of_every_target_is_closed_and_turned_outward() {
    for kind in TargetKind::ALL {
        for (n, part) in kind.parts().iter().enumerate() {
            let mut placed = Mesh::default();
            placed.add(&part.solid, &part.placed);
            assert_closed(&placed, &format!("{kind:?}, part {n}"));
            assert!(volume(&placed) > 1e-6, "{kind:?}, part {n}");
        }
    }
}

/// By hand from the parts: where each axis ends.
#[test]
fn targets_have_their_size() {
    // A panel 0.32 × 0.015 turned 72° about y reaches 0.16 sin 72° + 0.0075 cos 72° along z: less than the box.
    let box_bus = ([-0.23, -0.57, -0.335], [0.305, 0.67, 0.475]);
    let hex_bus = ([-0.300_222, -0.26, -0.36], [0.300_222, 0.82, 0.5]);
    let expected = [
        (TargetKind::BoxBus, box_bus),
        (TargetKind::HexBus, hex_bus),
        (TargetKind::RocketBody, ([-0.17, -0.17, -0.6], [0.17, 0.17, 0.6])),
        (TargetKind::Cube, ([-0.25; 3], [0.25; 3])),
        (TargetKind::Board, ([-0.4, -0.3, -0.012], [0.4, 0.3, 0.0])),
        (TargetKind::Sphere, ([-0.15; 3], [0.15; 3])),
    ];
    for (kind, (low, high)) in expected {
        let found = extents(&kind.mesh());
        let off = (found.0 - Vector3::from(low)).amax().max((found.1 - Vector3::from(high)).amax());
        assert!(off < 1e-6, "{kind:?}: {found:?}");
        let longest = (found.1 - found.0).amax();
        assert!(kind == TargetKind::Sphere || (0.5 - 1e-9..=1.3).contains(&longest), "{kind:?}: {longest}");
    }
}

/// The farthest a corner is moved from any corner of the same mesh when the mesh is turned.
fn misfit(mesh: &Mesh, turn: UnitQuaternion<f64>) -> f64 {
    let nearest = |moved: nalgebra::Point3<f64>| {
        mesh.vertices.iter().map(|vertex| (vertex - moved).norm()).fold(f64::INFINITY, f64::min)
    };
    mesh.vertices.iter().map(|vertex| nearest(turn * vertex)).fold(0.0, f64::max)
}

#[test]
fn only_the_ambiguous_targets_look_the_same_turned() {
    let turns = |axis: Vector3<f64>| [90.0, 120.0, 180.0, 240.0, 270.0_f64].map(|d| axis * d.to_radians());
    let turns = || [Vector3::x(), Vector3::y(), Vector3::z()].into_iter().flat_map(turns);
    for kind in [TargetKind::BoxBus, TargetKind::HexBus] {
        let mesh = kind.mesh();
        for turn in turns() {
            let off = misfit(&mesh, UnitQuaternion::from_scaled_axis(turn));
            assert!(off > 0.1, "{kind:?} turned by {turn:?}: {off}");
        }
    }
    let (cube, rocket) = (TargetKind::Cube.mesh(), TargetKind::RocketBody.mesh());
    let quarter = |axis: Vector3<f64>| UnitQuaternion::from_scaled_axis(axis * core::f64::consts::FRAC_PI_2);
    assert!(misfit(&cube, quarter(Vector3::x())) < 1e-12 && misfit(&cube, quarter(Vector3::y())) < 1e-12);
    assert!(misfit(&rocket, quarter(Vector3::z() / 12.0)) < 1e-12);
    assert!(misfit(&rocket, quarter(Vector3::x()) * quarter(Vector3::x())) > 0.05);
}

#[test]
fn the_satellites_show_all_three_materials_and_the_fixtures_one() {
    for kind in TargetKind::ALL {
        let mesh = kind.mesh();
        let has = |material| mesh.triangles.iter().any(|triangle| triangle.material == material);
        let hard = matches!(kind, TargetKind::BoxBus | TargetKind::HexBus | TargetKind::RocketBody);
        assert!(has(Material::Matt));
        assert_eq!((has(Material::Dark), has(Material::Foil)), (hard, hard), "{kind:?}");
    }
}

#[test]
fn the_sphere_is_as_round_as_stated() {
    let mesh = TargetKind::Sphere.mesh();
    for triangle in &mesh.triangles {
        let corners = mesh.corners(triangle).unwrap();
        let inside = SPHERE_RADIUS_M - crate::shape::normal(corners).dot(&corners[0].coords);
        assert!((0.0..0.000_2).contains(&inside), "{inside}");
    }
}

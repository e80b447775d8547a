//! Small worlds to look at, and a sensor to look with.
#![allow(dead_code, reason = "each test crate uses its part")]

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use std::sync::Arc;
use tumbled_model::{RigNs, Span, UnixNs};
use tumbled_sim::clock::SimClock;
use tumbled_sim::lidar::{Gps, Head, LidarConfig, LidarModel, LidarParameters, Surfaces, View, made_calibration};
use tumbled_sim::motion::{BodyState, Motion, Still};
use tumbled_sim::shape::{Material, Mesh, Triangle};
use tumbled_sim::world::{Body, Role, World};
use tumbled_velodyne::hdl64::Generation;
use tumbled_velodyne::stream::{Decoded, Settings, StreamDecoder};
use tumbled_velodyne::{Model, ReturnMode};

/// A box about its own origin.
pub(crate) fn cuboid(size: [f64; 3], material: Material) -> Arc<Mesh> {
    let [x, y, z] = size.map(|edge| 0.5 * edge);
    let vertices = (0..8)
        .map(|k| {
            Point3::new(
                if k & 1 == 0 { -x } else { x },
                if k & 2 == 0 { -y } else { y },
                if k & 4 == 0 { -z } else { z },
            )
        })
        .collect();
    let faces = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let triangles = faces
        .iter()
        .flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]])
        .map(|corners| Triangle { corners, material })
        .collect();
    Arc::new(Mesh { vertices, triangles })
}

/// A turn about the vertical through a point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Turn {
    pub(crate) centre: Vector3<f64>,
    pub(crate) rate_rps: f64,
}

impl Motion for Turn {
    fn state(&self, t: RigNs) -> BodyState {
        let angle = self.rate_rps * t.0 as f64 * 1e-9;
        BodyState {
            t_rig_body: Isometry3::from_parts(
                Translation3::from(self.centre),
                UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle),
            ),
            velocity_mps: Vector3::zeros(),
            angular_velocity_rps: Vector3::z() * self.rate_rps,
        }
    }
}

pub(crate) fn still(mesh: Arc<Mesh>, role: Role, centre: [f64; 3]) -> Body {
    let place = Isometry3::translation(centre[0], centre[1], centre[2]);
    Body { role, mesh, motion: Arc::new(Still(place)) }
}

/// Walls, floor and ceiling: 7 × 5 × 3 m about the sensor, which stands off the middle.
pub(crate) fn room() -> World {
    World::new(vec![still(cuboid([7.0, 5.0, 3.0], Material::Matt), Role::Room, [0.3, -0.2, 0.1])])
}

/// A box of 1 × 0.8 × 0.9 m that turns about the vertical 2.5 m before the sensor's back.
pub(crate) fn target(rate_rps: f64) -> World {
    let motion = Arc::new(Turn { centre: Vector3::new(-2.5, 0.4, 0.05), rate_rps });
    World::new(vec![Body { role: Role::Target, mesh: cuboid([1.0, 0.8, 0.9], Material::Matt), motion }])
}

pub(crate) fn config(head: Head, mode: ReturnMode, rpm: u32) -> LidarConfig {
    LidarConfig {
        id: "front".to_owned(),
        head,
        mode,
        rpm,
        start_azimuth_deg: 12.3,
        view: View::Full,
        vertical_offsets: None,
        t_rig_lidar: Isometry3::identity(),
        clock: SimClock { offset_ns: 77_000_123_456, ..SimClock::default() },
        gps: Gps::None,
        position_every: Span(1_000_000_000),
        unix_at_zero: UnixNs(1_795_321_341_000_000_000),
        parameters: quiet(),
    }
}

/// No noise at all but the counts'.
pub(crate) fn quiet() -> LidarParameters {
    LidarParameters {
        range_sigma_m: 0.0,
        beam_bias_sigma_m: 0.0,
        footprint_mrad: 0.0,
        pulse_m: 0.9,
        encoder_sigma_deg: 0.0,
        intensity_sigma: 0.0,
        surfaces: Surfaces::default(),
    }
}

pub(crate) fn vlp32c() -> LidarConfig {
    config(Head::BuiltIn(Model::Vlp32c), ReturnMode::Strongest, 600)
}

pub(crate) fn hdl64e(generation: Generation) -> Head {
    Head::Hdl64e { generation, calibration: Box::new(made_calibration().expect("plausible")) }
}

pub(crate) fn sensor(config: LidarConfig) -> LidarModel {
    LidarModel::new(config).expect("settings of a real sensor")
}

/// Decodes packets as they come, 100 µs after their last firing; gives the decoder and all points.
pub(crate) fn decode(
    model: &LidarModel,
    world: &World,
    packets: u64,
    seed: u64,
) -> (StreamDecoder, Decoded, Vec<RigNs>) {
    let calibration = match &model.config().head {
        Head::BuiltIn(_) => None,
        Head::Hdl64e { calibration, .. } => Some(calibration.as_ref().clone()),
    };
    let mut decoder = StreamDecoder::new(Settings { hdl64e_calibration: calibration, ..Settings::default() });
    let (mut out, mut times) = (Decoded::default(), Vec::new());
    for index in 0..packets {
        let packet = model.packet(world, index, seed);
        let refused = decoder.push(&packet.bytes, packet.end + Span(100_000), &mut out);
        assert_eq!(refused, None);
        times.push(packet.t);
    }
    decoder.finish(&mut out);
    (decoder, out, times)
}

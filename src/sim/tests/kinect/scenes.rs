//! Worlds before a Kinect at the rig's origin. The rig's frame is taken as the camera's: x right, y down, z forward.

use nalgebra::{Isometry3, Point3, Vector3};
use std::sync::Arc;
use tumbled_kinect::{DepthImage, DepthTable, Intrinsics, RawDisparity, ZeroPlane, decode_metres, decode_raw};
use tumbled_model::{DepthEncoding, PacketMask, RigNs};
use tumbled_sim::kinect::{Frame, KinectModel, KinectParameters};
use tumbled_sim::motion::Still;
use tumbled_sim::shape::{Material, Mesh, Triangle};
use tumbled_sim::world::{Body, Role, World};

pub(crate) const SEED: u64 = 11;

/// A rectangle about the origin, normal −z, of these half sides.
pub(crate) fn plate(half_width: f64, half_height: f64, material: Material) -> Mesh {
    let corner = |x: f64, y: f64| Point3::new(x * half_width, y * half_height, 0.0);
    Mesh {
        vertices: vec![corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)],
        triangles: [[0, 2, 1], [0, 3, 2]].map(|corners| Triangle { corners, material }).to_vec(),
    }
}

/// A mesh at `place`, turned about y and then about x, degrees.
pub(crate) fn placed(mesh: Mesh, place: [f64; 3], turn_x_deg: f64, turn_y_deg: f64, role: Role) -> Body {
    let turn = |axis: Vector3<f64>, deg: f64| nalgebra::UnitQuaternion::new(axis * deg.to_radians());
    let rotation = turn(Vector3::x(), turn_x_deg) * turn(Vector3::y(), turn_y_deg);
    let at = Isometry3::from_parts(Vector3::from(place).into(), rotation);
    Body { role, mesh: Arc::new(mesh), motion: Arc::new(Still(at)) }
}

/// One large plate that fills the image.
pub(crate) fn wall(z: f64, turn_x_deg: f64, turn_y_deg: f64) -> World {
    World::new(vec![placed(plate(30.0, 30.0, Material::Matt), [0.0, 0.0, z], turn_x_deg, turn_y_deg, Role::Room)])
}

pub(crate) fn kinect(parameters: KinectParameters) -> KinectModel {
    KinectModel::new("test", &Intrinsics::default(), Isometry3::identity(), parameters).expect("a camera")
}

pub(crate) fn frame(parameters: KinectParameters, world: &World) -> Frame {
    received(kinect(parameters).frame(world, RigNs(0), 0, SEED))
}

/// A frame as a host has it: its codes are what the decoder makes of the bytes on the wire.
pub(crate) fn received(mut frame: Frame) -> Frame {
    let bytes = frame.packed().expect("eleven bits");
    decode_raw(DepthEncoding::Packed11, &bytes, &PacketMask::NONE, &mut frame.raw).expect("a whole frame");
    frame
}

/// Depth by pixel, m, as the decoder tells it; 0 = no data.
pub(crate) fn metres(frame: &Frame) -> DepthImage {
    let bytes = frame.packed().expect("eleven bits");
    let mut metres = DepthImage::new();
    let table = DepthTable::from_law(&ZeroPlane::default());
    decode_metres(DepthEncoding::Packed11, &bytes, &PacketMask::NONE, &table, &mut metres).expect("a whole frame");
    metres
}

/// A pixel's code; `None`: no data.
pub(crate) fn code(frame: &Frame, u: usize, v: usize) -> Option<u16> {
    let code = frame.raw.at(u, v).expect("in the image");
    (code != RawDisparity::NO_DATA).then_some(code.0)
}

//! Targets made from a few solids, at rig scale: half a metre to 1.3 m, with what makes a satellite hard for the
//! sensors — thin panels, a dish, foil, black cells — and two whose pose cannot be told in full, on purpose.
//!
//! A body frame's origin is where the text says, not the centre of mass. Parts are closed solids that overlap a little
//! where they meet. A target that someone brings is a [`Mesh`] like any other.

mod bus;

use crate::shape::solid::{cuboid, revolve, sphere};
use crate::shape::{Material, Mesh};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The targets that come with the simulator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TargetKind {
    /// A box bus with two unequal canted panels, dish, nozzle, antenna, payload box and star tracker: 0.54 m, 1.24 m
    /// and 0.81 m along x, y and z. Origin: the middle of the box. Nothing about it is symmetric.
    BoxBus,
    /// A six-sided bus with one panel, nozzle, payload box and antenna, 1.08 m along y. Origin: the middle of the
    /// bus.
    HexBus,
    /// A rocket's upper stage, 1.2 m long, the same from every side about z: its roll cannot be seen. Origin: half
    /// way along its axis.
    RocketBody,
    /// A cube of 0.5 m: 24 poses look the same. Origin: its middle.
    Cube,
    /// A calibration board, 0.8 m along x, 0.6 m along y, 12 mm thick. Origin: the middle of its front, which looks
    /// along +z.
    Board,
    /// A calibration sphere, radius 0.15 m to within 0.2 mm. Origin: its middle.
    Sphere,
}

/// The radius of [`TargetKind::Sphere`], m.
pub const SPHERE_RADIUS_M: f64 = 0.15;
/// Width, height and thickness of [`TargetKind::Board`], m.
pub const BOARD_SIZE_M: [f64; 3] = [0.8, 0.6, 0.012];
/// The edge of [`TargetKind::Cube`], m.
pub const CUBE_EDGE_M: f64 = 0.5;

/// A closed solid in a target's frame.
struct Part {
    solid: Mesh,
    placed: Isometry3<f64>,
}

impl TargetKind {
    /// Every one.
    pub const ALL: [Self; 6] = [Self::BoxBus, Self::HexBus, Self::RocketBody, Self::Cube, Self::Board, Self::Sphere];

    /// Its surface in its own frame.
    pub fn mesh(self) -> Mesh {
        let mut mesh = Mesh::default();
        for part in self.parts() {
            mesh.add(&part.solid, &part.placed);
        }
        mesh
    }

    fn parts(self) -> Vec<Part> {
        match self {
            Self::BoxBus => bus::box_bus(),
            Self::HexBus => bus::hex_bus(),
            Self::RocketBody => vec![at(0.0, 0.0, 0.0, rocket())],
            Self::Cube => vec![at(0.0, 0.0, 0.0, cuboid(Vector3::repeat(CUBE_EDGE_M), 1, |_, _| Material::Matt))],
            Self::Board => {
                let [width, height, thickness] = BOARD_SIZE_M;
                let solid = cuboid(Vector3::new(width, height, thickness), 1, |_, _| Material::Matt);
                vec![at(0.0, 0.0, -thickness / 2.0, solid)]
            }
            Self::Sphere => vec![at(0.0, 0.0, 0.0, sphere(SPHERE_RADIUS_M, 96, Material::Matt))],
        }
    }
}

fn at(x: f64, y: f64, z: f64, solid: Mesh) -> Part {
    Part { solid, placed: Isometry3::translation(x, y, z) }
}

fn turned_at(x: f64, y: f64, z: f64, axis: Vector3<f64>, degrees: f64, solid: Mesh) -> Part {
    let turn = UnitQuaternion::from_scaled_axis(axis * degrees.to_radians());
    Part { solid, placed: Isometry3::from_parts(Translation3::new(x, y, z), turn) }
}

/// An upper stage: engine bell, tank with a dark band, cone and adapter ring of foil.
fn rocket() -> Mesh {
    const PROFILE: [(f64, f64); 12] = [
        (0.0, -0.47),
        (0.02, -0.47),
        (0.09, -0.6),
        (0.1, -0.6),
        (0.035, -0.46),
        (0.17, -0.43),
        (0.17, -0.05),
        (0.17, 0.05),
        (0.17, 0.45),
        (0.12, 0.56),
        (0.12, 0.6),
        (0.0, 0.6),
    ];
    revolve(&PROFILE, 48, |band| match band {
        0..=3 | 6 => Material::Dark,
        8 | 9 => Material::Foil,
        _ => Material::Matt,
    })
}

#[cfg(test)]
mod tests;

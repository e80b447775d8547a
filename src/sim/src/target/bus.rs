//! The two satellites.

use super::{Part, at, turned_at};
use crate::shape::solid::{bell, cuboid, cylinder, dish};
use crate::shape::{Material, Mesh};
use nalgebra::{Point3, Vector3};

fn plain(x: f64, y: f64, z: f64) -> Mesh {
    cuboid(Vector3::new(x, y, z), 1, |_, _| Material::Matt)
}

/// A panel in the xy plane: cells on its +z side, a plain back.
fn panel(x: f64, y: f64, cells: Material) -> Mesh {
    const THICKNESS_M: f64 = 0.015;
    cuboid(Vector3::new(x, y, THICKNESS_M), 1, |out, _| if out.z > 0.0 { cells } else { Material::Matt })
}

/// A box of 0.36 × 0.40 × 0.45 m and what is mounted on it. The panels look along x, to be seen
/// when the target turns about z, and differ in size, cant (18° up, 22° down) and surface, so that no half turn maps the
/// target onto itself.
pub(super) fn box_bus() -> Vec<Part> {
    let (y, x) = (Vector3::y(), Vector3::x());
    let dish_surface = |band: usize| if band > 6 { Material::Foil } else { Material::Matt };
    vec![
        at(0.0, 0.0, 0.0, cuboid(Vector3::new(0.36, 0.4, 0.45), 4, box_surface)),
        turned_at(0.0, 0.47, 0.0, y, 72.0, panel(0.32, 0.4, Material::Matt)),
        turned_at(0.0, -0.42, 0.02, y, 112.0, panel(0.27, 0.3, Material::Dark)),
        at(0.0, 0.235, 0.0, plain(0.03, 0.09, 0.03)),
        at(0.0, -0.235, 0.01, plain(0.03, 0.09, 0.03)),
        turned_at(0.17, 0.06, 0.09, y, 90.0, cylinder(0.02, 0.065, 12, Material::Matt)),
        turned_at(0.225, 0.06, 0.09, y, 90.0, dish(0.125, 0.06, 0.005, 32, dish_surface)),
        turned_at(0.225, 0.06, 0.09, y, 90.0, cylinder(0.008, 0.08, 8, Material::Matt)),
        turned_at(0.045, 0.0, -0.215, x, 180.0, bell(0.025, 0.075, 0.12, 0.005, 24, Material::Dark)),
        at(-0.09, 0.11, 0.265, plain(0.11, 0.09, 0.1)),
        at(0.11, -0.11, 0.215, cylinder(0.011, 0.26, 12, Material::Matt)),
        at(-0.2, -0.09, -0.11, plain(0.06, 0.13, 0.09)),
    ]
}

/// Foil over the upper half of the −x side and one cell in four of the ±y sides, a dark −z side.
fn box_surface(out: Vector3<f64>, at: Point3<f64>) -> Material {
    if out.x < 0.0 && at.z > 0.0 || out.y != 0.0 && at.x > 0.0 && at.z > 0.0 {
        Material::Foil
    } else if out.z < 0.0 {
        Material::Dark
    } else {
        Material::Matt
    }
}

/// A six-sided prism, 0.52 m across its flats and 0.5 m high, with one panel at +y that looks along x and 20° up.
pub(super) fn hex_bus() -> Vec<Part> {
    /// Half of 0.52 m over cos 30°.
    const CORNER_M: f64 = 0.300_222;
    let (y, x) = (Vector3::y(), Vector3::x());
    vec![
        at(0.0, 0.0, -0.25, cylinder(CORNER_M, 0.5, 6, Material::Matt)),
        at(0.0, 0.295, 0.1, plain(0.03, 0.09, 0.03)),
        turned_at(0.0, 0.57, 0.1, y, 70.0, panel(0.36, 0.5, Material::Matt)),
        turned_at(0.0, 0.0, -0.24, x, 180.0, bell(0.03, 0.1, 0.12, 0.005, 24, Material::Dark)),
        at(0.14, -0.06, 0.29, cuboid(Vector3::new(0.14, 0.1, 0.1), 1, |_, _| Material::Foil)),
        at(-0.12, 0.1, 0.24, cylinder(0.011, 0.26, 12, Material::Matt)),
    ]
}

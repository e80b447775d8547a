//! Closed solids that targets and rooms are put together from: outward sides, every edge shared by two triangles.

use super::{Material, Mesh, Triangle};
use nalgebra::{Point3, Vector3};
use std::collections::BTreeMap;

/// A box about the origin, its edges along the axes, each side cut into `cells` × `cells` squares (at least one) that
/// `paint` may give different materials. It is told the side's outward normal and the square's middle, from −1 to 1
/// along each axis of the box.
pub fn cuboid(size: Vector3<f64>, cells: u32, paint: impl Fn(Vector3<f64>, Point3<f64>) -> Material) -> Mesh {
    let cells = cells.clamp(1, 1_000) as i32;
    let mut mesh = Mesh::default();
    // Corners by their place on a lattice of 2·cells steps per edge, so that sides share them along the edges.
    let mut known = BTreeMap::new();
    let mut corner = |at: Vector3<i32>| {
        *known.entry([at.x, at.y, at.z]).or_insert_with(|| {
            let place = at.map(f64::from) / f64::from(cells);
            mesh.vertices.push(Point3::from(place.component_mul(&size) / 2.0));
            mesh.vertices.len() as u32 - 1
        })
    };
    let (x, y, z) = (Vector3::new(1, 0, 0), Vector3::new(0, 1, 0), Vector3::new(0, 0, 1));
    for (out, across, up) in
        [(x, y, z), (y, z, x), (z, x, y)].into_iter().flat_map(|(out, a, b)| [(out, a, b), (-out, b, a)])
    {
        for (row, column) in (0..cells).flat_map(|row| (0..cells).map(move |column| (row, column))) {
            let at = |right: i32, above: i32| {
                out * cells + across * (2 * (column + right) - cells) + up * (2 * (row + above) - cells)
            };
            let [a, b, c, d] = [at(0, 0), at(1, 0), at(1, 1), at(0, 1)].map(&mut corner);
            let middle = (at(0, 0) + at(1, 1)).map(f64::from) / f64::from(2 * cells);
            let material = paint(out.map(f64::from), Point3::from(middle));
            mesh.triangles.extend([[a, b, c], [a, c, d]].map(|corners| Triangle { corners, material }));
        }
    }
    mesh
}

/// A solid of revolution about z with flat facets, `segments` of them around (at least three), one corner of each ring
/// in the direction of +x. `profile` lists (radius, height) from the axis, out around the solid counter-clockwise
/// (radius to the right, height up), back to the axis; a height or radius may repeat, only the ends are on the axis.
/// `paint` gives the material of the band that begins at the n-th point.
pub fn revolve(profile: &[(f64, f64)], segments: u32, paint: impl Fn(usize) -> Material) -> Mesh {
    let segments = segments.max(3);
    let mut mesh = Mesh::default();
    let mut below: Option<Ring> = None;
    for (n, &(radius, height)) in profile.iter().enumerate() {
        let ring = Ring { first: mesh.vertices.len() as u32, on_axis: radius == 0.0, segments };
        mesh.vertices.extend((0..ring.corners()).map(|k| {
            let (sin, cos) = libm::sincos(core::f64::consts::TAU * f64::from(k) / f64::from(segments));
            Point3::new(radius * cos, radius * sin, height)
        }));
        if let Some(below) = below.replace(ring) {
            let material = paint(n - 1);
            for k in 0..segments {
                let [a, b, c, d] = [below.corner(k), below.corner(k + 1), ring.corner(k + 1), ring.corner(k)];
                let quad = [(!below.on_axis, [a, b, c]), (!ring.on_axis, [a, c, d])];
                let seen = quad.into_iter().filter(|(has_area, _)| *has_area);
                mesh.triangles.extend(seen.map(|(_, corners)| Triangle { corners, material }));
            }
        }
    }
    mesh
}

/// The corners of one point of a profile: a circle, or one corner on the axis.
#[derive(Clone, Copy)]
struct Ring {
    first: u32,
    on_axis: bool,
    segments: u32,
}

impl Ring {
    fn corners(self) -> u32 {
        if self.on_axis { 1 } else { self.segments }
    }

    fn corner(self, k: u32) -> u32 {
        self.first + k % self.corners()
    }
}

/// A cylinder on the z axis from height 0 up.
pub fn cylinder(radius: f64, height: f64, segments: u32, material: Material) -> Mesh {
    revolve(&[(0.0, 0.0), (radius, 0.0), (radius, height), (0.0, height)], segments, |_| material)
}

/// A sphere about the origin, its corners at `radius`; its facets lie up to radius · (π / segments)² inside.
pub fn sphere(radius: f64, segments: u32, material: Material) -> Mesh {
    let bands = segments.max(4) / 2;
    let profile: Vec<(f64, f64)> = (0..=bands)
        .map(|n| match n {
            0 => (0.0, -radius),
            n if n == bands => (0.0, radius),
            n => {
                let (sin, cos) = libm::sincos(core::f64::consts::PI * f64::from(n) / f64::from(bands));
                (radius * sin, -radius * cos)
            }
        })
        .collect();
    revolve(&profile, segments, |_| material)
}

/// A bowl that opens toward +z, its apex at the origin: a paraboloid of this radius and depth, with a wall.
pub fn dish(radius: f64, depth: f64, wall: f64, segments: u32, paint: impl Fn(usize) -> Material) -> Mesh {
    const STEPS: u32 = 6;
    let outside = (0..=STEPS).map(|n| {
        let part = f64::from(n) / f64::from(STEPS);
        (radius * part, depth * part * part)
    });
    let inside = outside.clone().rev().map(|(r, z)| (r, z + wall));
    let profile: Vec<(f64, f64)> = outside.chain(inside).collect();
    revolve(&profile, segments, paint)
}

/// A bell that opens toward +z, its closed end of radius `throat` at the origin, with a wall.
pub fn bell(throat: f64, mouth: f64, length: f64, wall: f64, segments: u32, material: Material) -> Mesh {
    let outside = [(0.0, 0.0), (throat, 0.0), (mouth, length)];
    let inside = [(mouth - wall, length), (throat - wall, wall), (0.0, wall)];
    revolve(&[outside, inside].concat(), segments, |_| material)
}

#[cfg(test)]
#[path = "solid_tests.rs"]
mod tests;

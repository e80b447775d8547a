//! The world's triangles as the camera sees them.

use crate::kinect::optics::Optics;
use crate::shape::Material;
use crate::world::{Role, World};
use core::ops::Range;
use nalgebra::{Isometry3, Vector3};
use tumbled_kinect::{HEIGHT, WIDTH};
use tumbled_model::RigNs;

/// A triangle in the camera's frame while the frame is read out.
#[derive(Clone, Debug)]
pub(super) struct Facet {
    /// Its corners when the first row is seen.
    start: [Vector3<f64>; 3],
    /// Its corners half a readout after the middle, where they are elsewhere. Between the two it is taken to move straight:
    /// at 20°/s and 33 ms that is 11 µm off at 0.65 m from the axis.
    end: Option<[Vector3<f64>; 3]>,
    /// Its cone, where it stays.
    still: Cone,
    pub(super) rows: Range<usize>,
    pub(super) columns: Range<usize>,
    pub(super) material: Material,
    pub(super) role: Role,
}

/// The rays that meet a triangle. With r = (x, y, 1) and p = z·r the point, p = Σ λᵢ·cornerᵢ gives λᵢ = z·eᵢ·r and, as
/// Σ λᵢ = 1, 1/z = (Σ eᵢ)·r (Olano and Greer, "Triangle scan conversion using 2D homogeneous coordinates", 1997): inside and
/// in front where no eᵢ·r is negative, and nothing has to be cut at the camera's plane.
#[derive(Clone, Copy, Debug)]
pub(super) struct Cone {
    /// e₀, e₁, e₂.
    pub(super) sides: [Vector3<f64>; 3],
    /// Their sum: 1/z = inverse_depth · (x, y, 1). Its length is 1 over the plane's distance from the camera.
    pub(super) inverse_depth: Vector3<f64>,
}

impl Cone {
    /// `None`: the camera lies in the triangle's plane, or it has no area.
    fn of([a, b, c]: &[Vector3<f64>; 3]) -> Option<Self> {
        let (bc, ca, ab) = (b.cross(c), c.cross(a), a.cross(b));
        let volume = a.dot(&bc);
        let sides = [bc / volume, ca / volume, ab / volume];
        let inverse_depth = sides.iter().sum();
        sides.iter().flatten().all(|x| x.is_finite()).then_some(Self { sides, inverse_depth })
    }

    /// 1/z of the plane in the direction (x, y, 1).
    pub(super) fn inverse_depth_at(&self, [x, y]: [f64; 2]) -> f64 {
        let w = &self.inverse_depth;
        w.x * x + w.y * y + w.z
    }
}

impl Facet {
    /// What it is to row `v`; `None`: it is seen edge-on.
    pub(super) fn cone(&self, v: usize) -> Option<Cone> {
        let Some(end) = &self.end else { return Some(self.still) };
        let share = v as f64 / HEIGHT as f64;
        let ([a, b, c], [d, e, f]) = (&self.start, end);
        Cone::of(&[a + share * (d - a), b + share * (e - b), c + share * (f - c)])
    }

    /// The square of 1 over the distance of its plane from the camera, as row `v` sees it.
    pub(super) fn inverse_distance_squared(&self, v: usize) -> f64 {
        self.cone(v).map_or(0.0, |cone| cone.inverse_depth.norm_squared())
    }
}

/// The triangles that the image can show, in the order of the bodies and their meshes.
pub(super) fn facets(
    world: &World,
    t_rig_kinect: &Isometry3<f64>,
    optics: &Optics,
    [first, last]: [RigNs; 2],
) -> Vec<Facet> {
    let t_kinect_rig = t_rig_kinect.inverse();
    let mut facets = Vec::new();
    let (mut starts, mut ends) = (Vec::new(), Vec::new());
    for body in world.bodies() {
        let place = |t| t_kinect_rig * body.motion.state(t).t_rig_body;
        let (start, end) = (place(first), place(last));
        let moves = start != end;
        starts.clear();
        starts.extend(body.mesh.vertices.iter().map(|vertex| (start * vertex).coords));
        ends.clear();
        if moves {
            ends.extend(body.mesh.vertices.iter().map(|vertex| (end * vertex).coords));
        }
        for triangle in &body.mesh.triangles {
            let of = |vertices: &[Vector3<f64>]| {
                let [a, b, c] = triangle.corners.map(|corner| vertices.get(corner as usize).copied());
                Some([a?, b?, c?])
            };
            let Some(start) = of(&starts) else { continue };
            let end = if moves { of(&ends) } else { None };
            let Some((columns, rows)) = window(&start, end.as_ref(), optics) else { continue };
            let still = Cone::of(&start);
            if still.is_none() && !moves {
                continue;
            }
            // A moving triangle that is edge-on in the first row gets its cones row by row.
            let none = Cone { sides: [Vector3::zeros(); 3], inverse_depth: Vector3::zeros() };
            let (material, role) = (triangle.material, body.role);
            facets.push(Facet { start, end, still: still.unwrap_or(none), rows, columns, material, role });
        }
    }
    facets
}

/// The columns and rows a triangle may cover; `None`: it is out of sight.
fn window(
    start: &[Vector3<f64>; 3],
    end: Option<&[Vector3<f64>; 3]>,
    optics: &Optics,
) -> Option<(Range<usize>, Range<usize>)> {
    /// Corners nearer to the camera's plane are not projected, m.
    const NEAR: f64 = 0.01;
    let corners = || start.iter().chain(end.into_iter().flatten());
    let [[left, top], [right, bottom]] = optics.bounds;
    // Half spaces through the camera: all corners beyond one of them, and nothing of the triangle is in the image.
    let out = corners().all(|p| p.x < left * p.z)
        || corners().all(|p| p.x > right * p.z)
        || corners().all(|p| p.y < top * p.z)
        || corners().all(|p| p.y > bottom * p.z)
        || corners().all(|p| p.z < NEAR);
    if out {
        return None;
    }
    if corners().any(|p| p.z < NEAR) {
        return Some((0..WIDTH, 0..HEIGHT));
    }
    let range = |of: &dyn Fn(&Vector3<f64>) -> f64, size: usize| {
        let (low, high) = corners().map(of).fold((f64::MAX, f64::MIN), |(low, high), at| (low.min(at), high.max(at)));
        // A billionth of a pixel, so that a corner on a pixel's centre is on it whatever the rounding.
        let margin = optics.margin_px + 1e-9;
        let (low, high) = ((low - margin).ceil().max(0.0), (high + margin).floor().min(size as f64 - 1.0));
        if low <= high { low as usize..high as usize + 1 } else { 0..0 }
    };
    let columns = range(&|p| optics.fx * p.x / p.z + optics.cx, WIDTH);
    let rows = range(&|p| optics.fy * p.y / p.z + optics.cy, HEIGHT);
    (!columns.is_empty() && !rows.is_empty()).then_some((columns, rows))
}

//! Surfaces that people bring: `.obj`, `.stl` and `.ply` files as meshes of a scene's target.
//!
//! The libraries read the formats; here the faces become triangles, what no surface has is refused, and what no sensor can
//! see (triangles without area, vertices of no triangle) is left out. The side a triangle looks to does not matter: a
//! sensor sees both. Texture, colour, normals and materials in the file are not used.

mod obj;
pub(crate) mod ply;
mod stl;

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::Point3;
use tumbled_sim::shape::{Material, Mesh, Triangle};

use crate::geometry_file::{GeometryError, Wrong, bytes, extension};

/// The largest file, bytes: a million triangles as text.
const LARGEST: u64 = 256 << 20;
/// The most triangles: what a ray caster holds in a few hundred megabytes.
const MOST_TRIANGLES: usize = 1_000_000;

/// A mesh that was read.
#[derive(Clone, Debug, PartialEq)]
pub struct Brought {
    /// The surface, in the file's unit.
    pub mesh: Mesh,
    /// Triangles that were left out because they have no area.
    pub without_area: usize,
}

/// Vertices, and faces of three or more of them, as a file has them.
#[derive(Debug, Default)]
struct Polygons {
    vertices: Vec<[f64; 3]>,
    faces: Vec<Vec<u32>>,
}

/// Reads a mesh; the name's extension says which format.
///
/// # Errors
/// [`GeometryError`]: a file that cannot be read, is too large, or holds no surface.
pub fn read(path: &Path) -> Result<Brought, GeometryError> {
    let failed = |wrong: Wrong| wrong.in_file(path);
    let parse = match extension(path).as_deref() {
        Some("obj") => obj::parse,
        Some("stl") => stl::parse,
        Some("ply") => ply::parse,
        _ => return Err(failed(Wrong::new("the name of a mesh ends in .obj, .stl or .ply"))),
    };
    let bytes = bytes(path, LARGEST, "reduce the mesh's detail")?;
    parse(&bytes).and_then(surface).map_err(failed)
}

/// The faces as triangles.
fn surface(polygons: Polygons) -> Result<Brought, Wrong> {
    let Polygons { vertices, faces } = polygons;
    if let Some((n, vertex)) =
        vertices.iter().zip(1..).find_map(|(v, n)| v.iter().any(|x| !x.is_finite()).then_some((n, v)))
    {
        return Err(Wrong::new(format!("vertex {n} is {vertex:?}, three finite numbers expected")));
    }
    let triangles: usize = faces.iter().map(|face| face.len().saturating_sub(2)).sum();
    if triangles > MOST_TRIANGLES {
        let problem = format!("{triangles} triangles, at most {MOST_TRIANGLES} expected: reduce the mesh's detail");
        return Err(Wrong::new(problem));
    }
    let mut mesh = Mesh::default();
    let mut without_area = 0;
    // A vertex's place among those that a triangle uses.
    let mut used: BTreeMap<u32, u32> = BTreeMap::new();
    for (face, n) in faces.iter().zip(1..) {
        let place = |corner: &u32| vertices.get(*corner as usize).map(|vertex| Point3::from(*vertex));
        let Some(corners) = face.iter().map(place).collect::<Option<Vec<_>>>() else {
            let problem = format!("face {n} names a vertex that is not there: there are {}", vertices.len());
            return Err(Wrong::new(problem));
        };
        for [a, b, c] in fan(&corners) {
            let (Some(p), Some(q), Some(r)) = (corners.get(a), corners.get(b), corners.get(c)) else { continue };
            if !has_area([p, q, r]) {
                without_area += 1;
                continue;
            }
            let mut corner = |k: usize| {
                let vertex = face.get(k).copied().unwrap_or_default();
                *used.entry(vertex).or_insert_with(|| {
                    mesh.vertices.extend(corners.get(k).copied());
                    mesh.vertices.len() as u32 - 1
                })
            };
            let corners = [corner(a), corner(b), corner(c)];
            mesh.triangles.push(Triangle { corners, material: Material::Matt });
        }
    }
    if mesh.triangles.is_empty() {
        let problem = match (faces.len(), without_area) {
            (0, _) => format!("no faces, {} vertices: a surface expected, not a cloud of points", vertices.len()),
            (faces, n) => format!("none of {faces} faces has an area ({n} triangles without)"),
        };
        return Err(Wrong::new(problem));
    }
    Ok(Brought { mesh, without_area })
}

/// A polygon as triangles that share the corner from which all of them look the same way, which a polygon with one dent
/// has; the first corner if there is none. Three corners are one triangle, fewer none.
fn fan(corners: &[Point3<f64>]) -> Vec<[usize; 3]> {
    let n = corners.len();
    let from = |first: usize| (1..n.saturating_sub(1)).map(move |k| [first, (first + k) % n, (first + k + 1) % n]);
    let normal = |[a, b, c]: [usize; 3]| match (corners.get(a), corners.get(b), corners.get(c)) {
        (Some(a), Some(b), Some(c)) => (b - a).cross(&(c - a)),
        _ => nalgebra::Vector3::zeros(),
    };
    // Twice the polygon's area, along its normal.
    let whole: nalgebra::Vector3<f64> = from(0).map(normal).sum();
    // Long polygons are not searched: a square of their length would be.
    let candidates = if n > 64 { 0..1 } else { 0..n };
    let first = candidates.into_iter().find(|first| from(*first).all(|triangle| normal(triangle).dot(&whole) >= 0.0));
    from(first.unwrap_or(0)).collect()
}

/// Whether a triangle is wider than rounding: a billionth of its longest side.
fn has_area([a, b, c]: [&Point3<f64>; 3]) -> bool {
    let (ab, ac, bc) = (b - a, c - a, c - b);
    let longest = ab.norm_squared().max(ac.norm_squared()).max(bc.norm_squared());
    let doubled = ab.cross(&ac).norm();
    doubled.is_finite() && doubled > 1e-9 * longest
}

/// Which line, from 1, the first bytes of a text end in.
fn line_after(text: &[u8], consumed: usize) -> usize {
    let read = text.get(..consumed).unwrap_or(text);
    read.iter().filter(|byte| **byte == b'\n').count().max(1)
}

#[cfg(test)]
mod tests;

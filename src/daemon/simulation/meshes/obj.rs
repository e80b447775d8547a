//! Wavefront `.obj`, by `tobj`.

use super::{Polygons, line_after};
use crate::geometry_file::Wrong;

/// Vertices and faces of an OBJ.
pub(super) fn parse(bytes: &[u8]) -> Result<Polygons, Wrong> {
    let text = geometry(&String::from_utf8_lossy(bytes));
    let options = tobj::LoadOptions { ignore_points: true, ignore_lines: true, ..tobj::LoadOptions::default() };
    let mut left = text.as_bytes();
    // No line of the geometry names a file of materials.
    let no_file = |_: &std::path::Path| Err(tobj::LoadError::OpenFileFailed);
    let loaded = tobj::load_obj_buf(&mut left, &options, no_file);
    let (models, _materials) = loaded.map_err(|error| {
        // Places in the lists are looked up after the last line.
        let in_a_line = !matches!(error, tobj::LoadError::FaceVertexOutOfBounds);
        let line = in_a_line.then(|| line_after(text.as_bytes(), text.len() - left.len()));
        Wrong { line, problem: problem(error) }
    })?;
    let mut polygons = Polygons::default();
    for tobj::Model { mesh, .. } in models {
        let first = polygons.vertices.len() as u32;
        polygons.vertices.extend(mesh.positions.as_chunks::<3>().0);
        let mut corners = mesh.indices.iter().map(|corner| corner + first);
        if mesh.face_arities.is_empty() {
            // Nothing but triangles.
            polygons
                .faces
                .extend(mesh.indices.chunks(3).map(|face| corners.by_ref().take(face.len()).collect::<Vec<_>>()));
        } else {
            polygons
                .faces
                .extend(mesh.face_arities.iter().map(|n| corners.by_ref().take(*n as usize).collect::<Vec<_>>()));
        }
    }
    Ok(polygons)
}

/// The lines of vertices and faces, each with what is used of it, in their places: coordinates, and of `v/vt/vn` the `v`.
/// The library reads more, and refuses files for what is not needed here.
fn geometry(text: &str) -> String {
    // A line may go on after a backslash.
    let text = text.replace("\\\r\n", " ").replace("\\\n", " ");
    let mut kept = String::with_capacity(text.len());
    for line in text.lines() {
        let line = line.split('#').next().unwrap_or_default();
        let mut words = line.split_whitespace();
        match words.next() {
            Some("v") => {
                kept.push('v');
                words.take(3).for_each(|word| kept.extend([" ", word]));
            }
            Some("f" | "fo") => {
                kept.push('f');
                words.for_each(|word| kept.extend([" ", word.split('/').next().unwrap_or_default()]));
            }
            _ => {}
        }
        kept.push('\n');
    }
    kept
}

fn problem(error: tobj::LoadError) -> String {
    match error {
        tobj::LoadError::PositionParseError => "`v` and three numbers expected".to_owned(),
        tobj::LoadError::FaceParseError | tobj::LoadError::InvalidPolygon => {
            "`f` and the numbers of three or more vertices expected".to_owned()
        }
        tobj::LoadError::FaceVertexOutOfBounds => {
            "a face names a vertex that is not there: vertices count from 1, or back from -1".to_owned()
        }
        other => other.to_string(),
    }
}

//! A model's files.

use std::io::Write;

use tumbled_core::recon::{Edge, EdgeKind, Reconstruction};

use super::Made;
use super::report::{ContourFile, EdgeLine, PlaneLine, PlanesFile};
use crate::cli::Failure;

/// model.ply: points with normals, σ, plane and counts.
pub fn ply(model: &Reconstruction) -> Vec<u8> {
    let mut bytes = format!(
        "ply\nformat binary_little_endian 1.0\ncomment target's frame, m; plane -1: none\nelement vertex {}\n\
        property float x\nproperty float y\nproperty float z\nproperty float nx\nproperty float ny\nproperty float nz\n\
        property float sigma\nproperty int plane\nproperty uint kinect\nproperty uint lidar\nend_header\n",
        model.points.len()
    )
    .into_bytes();
    for (point, plane) in model.points.iter().zip(&model.plane_of) {
        let numbers = point.place.iter().chain(point.normal.iter()).chain([&point.sigma_m]);
        numbers.for_each(|number| bytes.extend((*number as f32).to_le_bytes()));
        bytes.extend(plane.map_or(-1, |plane| plane as i32).to_le_bytes());
        bytes.extend(point.kinect.to_le_bytes());
        bytes.extend(point.lidar.to_le_bytes());
    }
    bytes
}

/// motion.csv: where the target was at each frame, rig frame, m; in the order of the times, cameras first.
pub fn motion(made: &Made) -> Vec<u8> {
    let mut text = "t_ns,x_m,y_m,z_m,qx,qy,qz,qw\n".to_owned();
    let poses = made.motion.iter().flat_map(|motion| &motion.t_rig_target);
    let mut rows: Vec<_> = made.laid.iter().zip(poses).collect();
    rows.sort_by_key(|(laid, _)| (laid.t, laid.sensor));
    for (laid, pose) in rows {
        let (at, q) = (&pose.translation.vector, &pose.rotation.coords);
        let numbers = [at.x, at.y, at.z, q.x, q.y, q.z, q.w].map(|number| format!("{number:.9}")).join(",");
        text.push_str(&format!("{},{numbers}\n", laid.t.0));
    }
    text.into_bytes()
}

/// planes.json.
///
/// # Errors
/// None that a number could cause.
pub fn planes(model: &Reconstruction) -> Result<Vec<u8>, Failure> {
    let planes = model.planes.iter().zip(0..).map(|(plane, number)| PlaneLine::new(plane, number)).collect();
    json(&PlanesFile { planes })
}

/// contour.json.
///
/// # Errors
/// As [`planes`].
pub fn contour(model: &Reconstruction) -> Result<Vec<u8>, Failure> {
    json(&ContourFile { edges: model.edges.iter().map(EdgeLine::new).collect() })
}

fn json(value: &impl serde::Serialize) -> Result<Vec<u8>, Failure> {
    let mut bytes = serde_json::to_vec_pretty(value).map_err(Failure::failed)?;
    bytes.push(b'\n');
    Ok(bytes)
}

/// contour.obj: a group of lines for each kind of edge; those that may be occlusions are no part of the contour, and left out.
///
/// # Errors
/// None: it is written to memory.
pub fn obj(model: &Reconstruction) -> Result<Vec<u8>, Failure> {
    let mut bytes = b"# contour in the target's frame, m\n".to_vec();
    let mut vertices = 0;
    for (name, kind) in [("crease", EdgeKind::Crease), ("boundary", EdgeKind::Boundary)] {
        writeln!(bytes, "g {name}").map_err(Failure::Output)?;
        for Edge { ends, .. } in model.edges.iter().filter(|edge| edge.kind == kind) {
            for end in ends {
                writeln!(bytes, "v {:.6} {:.6} {:.6}", end.x, end.y, end.z).map_err(Failure::Output)?;
            }
            writeln!(bytes, "l {} {}", vertices + 1, vertices + 2).map_err(Failure::Output)?;
            vertices += 2;
        }
    }
    Ok(bytes)
}

//! Do the captures show that a beam leaves the sensor at the height −f·tan(elevation)? The evidence behind
//! `vertical_offsets = "auto"`; method and verdict are in `docs/velodyne.md`.
//!
//! ```text
//! cargo run --release -p tumbled-velodyne --example vertical_offsets -- ../shared/data/velodyne
//! ```
//!
//! ```text
//!   capture ─ decoder, offsets off ─▶ returns ─ cells ─▶ trimmed plane ─ gls ─▶ scale of the offsets ─ report
//! ```
//!
//! No random numbers: the same captures give the same tables.
#![forbid(unsafe_code)]

mod capture;
mod cells;
mod gls;
mod report;
mod surfaces;

use cells::Plane;
use gls::{GlsError, Problem};
use nalgebra::Vector3;
use report::Line;
use std::error::Error;
use std::path::{Path, PathBuf};
use surfaces::{OTHERS, Scene, VLP32C_FLOOR};

/// Parts of the floor, first and last ring: without the farthest rings, the nearest, or both.
const PARTS: [(u8, u8); 5] = [(0, 10), (0, 7), (1, 14), (1, 10), (2, 14)];

fn main() -> Result<(), Box<dyn Error>> {
    let Some(folder) = std::env::args_os().nth(1).map(PathBuf::from) else {
        return Err("give the folder of the Velodyne captures".into());
    };
    let mut lines = Vec::new();
    if let Some([floor]) = planes(&folder, &VLP32C_FLOOR)?.as_deref() {
        let whole = std::slice::from_ref(floor);
        report::print_rings(floor, &Line::fit(VLP32C_FLOOR.name, Problem::new(whole, false))?);
        lines.extend(fits(&VLP32C_FLOOR, whole)?);
        for (first, last) in PARTS {
            let part = floor.of_rings(first, last);
            lines.push(Line::fit(format!("… rings {first}–{last}"), Problem::new(&[part], false))?);
        }
    }
    for scene in &OTHERS {
        if let Some(planes) = planes(&folder, scene)? {
            lines.extend(fits(scene, &planes)?);
        }
    }
    if !lines.is_empty() {
        report::print_hypotheses(&lines);
        report::print_scales(&lines);
    }
    Ok(())
}

/// The fits of a scene's surfaces: flat, and curved where that is asked for.
fn fits(scene: &Scene, planes: &[Plane]) -> Result<Vec<Line>, GlsError> {
    let mut lines = vec![Line::fit(scene.name, Problem::new(planes, false))?];
    if scene.also_curved {
        lines.push(Line::fit("… as a curved surface", Problem::new(planes, true))?);
    }
    Ok(lines)
}

/// The planes of a scene's surfaces; `None` where the capture is not there.
fn planes(folder: &Path, scene: &Scene) -> Result<Option<Vec<Plane>>, capture::CaptureError> {
    let Some(samples) = capture::samples(folder, scene)? else { return Ok(None) };
    let plane =
        |surface: &surfaces::Surface| Plane::fit(&cells::gather(&samples, surface), &Vector3::from(surface.normal));
    Ok(Some(scene.surfaces.iter().map(plane).collect()))
}

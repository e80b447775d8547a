//! Clouds of points in files: `.ply` (text or binary, float or double, extra properties passed over) and `.pts` as
//! `tumbled export` writes them.

mod ply;
mod pts;

use std::path::Path;

use nalgebra::Point3;

use crate::geometry_file::{GeometryError, Wrong, bytes, extension};

/// The largest file, bytes.
const LARGEST: u64 = 512 << 20;
/// The most points: a Kinect's frame has 307 200, a LiDAR's turn up to 110 000.
const MOST_POINTS: usize = 2_000_000;

/// A cloud that was read.
#[derive(Clone, Debug, PartialEq)]
pub struct ReadCloud {
    /// The finite points, in the file's unit and order.
    pub points: Vec<Point3<f32>>,
    /// Points left out because a coordinate is not finite.
    pub not_finite: usize,
}

/// Reads a cloud; the name's extension says which format.
///
/// # Errors
/// [`GeometryError`]: a file that cannot be read, is too large, or holds no points.
pub fn read(path: &Path) -> Result<ReadCloud, GeometryError> {
    let failed = |wrong: Wrong| wrong.in_file(path);
    let parse = match extension(path).as_deref() {
        Some("ply") => ply::parse,
        Some("pts") => pts::parse,
        _ => return Err(failed(Wrong::new("the name of a cloud ends in .ply or .pts"))),
    };
    let all = parse(&bytes(path, LARGEST, "thin the cloud out")?).map_err(failed)?;
    if all.len() > MOST_POINTS {
        let problem = format!("{} points, at most {MOST_POINTS} expected: thin the cloud out", all.len());
        return Err(failed(Wrong::new(problem)));
    }
    let count = all.len();
    let points: Vec<Point3<f32>> =
        all.into_iter().filter(|point| point.iter().all(|number| number.is_finite())).map(Point3::from).collect();
    let not_finite = count - points.len();
    Ok(ReadCloud { points, not_finite })
}

#[cfg(test)]
mod tests;

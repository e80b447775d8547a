//! Clouds of points in files: `.ply` (text or binary, float or double, extra properties passed over) and `.pts` as
//! `tumbled export` writes them.

mod ply;
mod pts;

use std::fs;
use std::path::{Path, PathBuf};

use nalgebra::Point3;
use thiserror::Error;

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

/// A file that holds no cloud.
#[derive(Debug, Error)]
#[error("{}{}: {problem}", path.display(), line.map(|line| format!(":{line}")).unwrap_or_default())]
pub struct CloudError {
    /// The file.
    pub path: PathBuf,
    /// The line, from 1, where the file has lines and one is at fault.
    pub line: Option<usize>,
    /// What was found and what was expected.
    pub problem: String,
}

/// What is wrong with a file's content.
#[derive(Debug)]
struct Wrong {
    line: Option<usize>,
    problem: String,
}

impl Wrong {
    fn new(problem: impl Into<String>) -> Self {
        Self { line: None, problem: problem.into() }
    }
}

/// Reads a cloud; the name's extension says which format.
///
/// # Errors
/// [`CloudError`]: a file that cannot be read, is too large, or holds no points.
pub fn read(path: &Path) -> Result<ReadCloud, CloudError> {
    let failed = |wrong: Wrong| CloudError { path: path.to_owned(), line: wrong.line, problem: wrong.problem };
    let extension = path.extension().and_then(|extension| extension.to_str()).map(str::to_ascii_lowercase);
    let parse = match extension.as_deref() {
        Some("ply") => ply::parse,
        Some("pts") => pts::parse,
        _ => return Err(failed(Wrong::new("the name of a cloud ends in .ply or .pts"))),
    };
    let unreadable = |error: std::io::Error| failed(Wrong::new(format!("cannot be read: {error}")));
    let length = fs::metadata(path).map_err(unreadable)?.len();
    if length > LARGEST {
        return Err(failed(Wrong::new(format!("{length} bytes, at most {LARGEST} expected: thin the cloud out"))));
    }
    let bytes = fs::read(path).map_err(unreadable)?;
    let all = parse(&bytes).map_err(failed)?;
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

//! The file of a saved target.

use std::fmt::Write;

use nalgebra::{Point3, Vector3};
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};
use thiserror::Error;
use tumbled_core::track::{MODEL_REACH_M, Surfel, Surfels};

use crate::simulation::meshes::ply::fits;

/// Surfels at most: a recording takes along no larger file. 13 mm apart they cover 10 m².
pub const LARGEST: usize = 60_000;
/// Surfels at least: fewer are no body.
const LEAST: usize = 100;
/// What the first comment says.
const MARK: &str = "tumbled target 1";
/// How far from 1 a normal's length may be.
const UNIT: f64 = 1e-3;
/// σ at least, m: less is not told apart.
const FINEST_M: f64 = 1e-5;
/// σ at most, m: what is known less well is no surface.
const COARSEST_M: f64 = 0.5;

/// A target's model as it was saved: where its points lie is its frame.
#[derive(Clone, Debug, PartialEq)]
pub struct SavedTarget {
    /// What it is called.
    pub name: String,
    /// What it was made of: a line for people.
    pub source: String,
    /// BLAKE3 of the points as they stand in the file, 64 hexadecimal digits.
    pub digest: String,
    /// The points.
    pub surfels: Surfels,
}

/// Why a file is no saved target.
#[derive(Debug, Error)]
pub enum TargetFileError {
    /// Not a PLY that `target save` wrote.
    #[error("{problem}; `tumbled target save` writes such files")]
    Foreign {
        /// What was found.
        problem: String,
    },
    /// Another content than was written.
    #[error(
        "its points have been changed since it was saved (BLAKE3 {found}, and {stated} in its header): save it anew"
    )]
    Changed {
        /// Of the points that are there.
        found: String,
        /// In the header.
        stated: String,
    },
    /// A point that is none.
    #[error("point {number}: {problem}")]
    Point {
        /// From 1.
        number: usize,
        /// What is wrong.
        problem: &'static str,
    },
    /// Too few or too many points.
    #[error("{found} points, {LEAST} to {LARGEST} expected: {}", if *found < LEAST { "save it from a longer recording" } else { "leave out what is not the target" })]
    Count {
        /// Points.
        found: usize,
    },
}

fn foreign(problem: impl Into<String>) -> TargetFileError {
    TargetFileError::Foreign { problem: problem.into() }
}

impl SavedTarget {
    /// A model to save: rounded to what is written, micrometres, so that what is read again is the same.
    ///
    /// # Errors
    /// [`TargetFileError::Count`].
    pub fn new(name: &str, source: &str, surfels: &Surfels) -> Result<Self, TargetFileError> {
        counted(surfels.len())?;
        let body = body(surfels);
        let one_line = |text: &str| text.split_whitespace().collect::<Vec<_>>().join(" ");
        let saved = Self {
            name: one_line(name),
            source: one_line(source),
            digest: blake3::hash(body.as_bytes()).to_hex().to_string(),
            surfels: surfels.clone(),
        };
        Self::read(saved.text().as_bytes())
    }

    /// As a file has it.
    pub fn text(&self) -> String {
        let Self { name, source, digest, surfels } = self;
        format!(
            "ply\nformat ascii 1.0\ncomment {MARK}\ncomment name {name}\ncomment source {source}\ncomment digest {digest}\n\
             comment metres, target frame; sigma along the normal\nelement vertex {}\nproperty double x\nproperty double y\n\
             property double z\nproperty double nx\nproperty double ny\nproperty double nz\nproperty double sigma\nend_header\n{}",
            surfels.len(),
            body(surfels)
        )
    }

    /// Reads a file's content.
    ///
    /// # Errors
    /// [`TargetFileError`]
    pub fn read(bytes: &[u8]) -> Result<Self, TargetFileError> {
        let not_ply = |error: ParseError| foreign(format!("it is no PLY: {error}"));
        let mut reader = Reader::new(bytes);
        let header = Parser::<Row>::new().read_header(&mut reader).map_err(not_ply)?;
        let said = |key: &str| header.comments.iter().find_map(|comment| comment.trim().strip_prefix(key));
        if said(MARK).is_none() {
            return Err(foreign(format!("its header has no line `comment {MARK}`")));
        }
        let word = |key: &str| {
            said(key).map(|text| text.trim().to_owned()).ok_or_else(|| foreign(format!("its header has no `{key}`")))
        };
        let (name, source, stated) = (word("name ")?, said("source ").unwrap_or_default().trim(), word("digest ")?);
        let vertex = header.elements.get("vertex").ok_or_else(|| foreign("it has no element `vertex`"))?;
        fits("vertex", vertex, bytes.len()).map_err(|wrong| foreign(wrong.problem))?;
        counted(vertex.count)?;
        if let Some(missing) = PROPERTIES.into_iter().find(|name| !vertex.properties.contains_key(*name)) {
            return Err(foreign(format!("its points have no property `{missing}`")));
        }
        let rows: Vec<Row> = Parser::new().read_payload_for_element(&mut reader, vertex, &header).map_err(not_ply)?;
        for (number, row) in (1..).zip(&rows) {
            row.check().map_err(|problem| TargetFileError::Point { number, problem })?;
        }
        let surfels = Surfels::of(rows.iter().map(Row::surfel));
        let found = blake3::hash(body(&surfels).as_bytes()).to_hex().to_string();
        if found != stated {
            return Err(TargetFileError::Changed { found, stated });
        }
        Ok(Self { name, source: source.to_owned(), digest: found, surfels })
    }

    /// The first digits of the digest: what people compare.
    pub fn short_digest(&self) -> &str {
        self.digest.get(..12).unwrap_or(&self.digest)
    }
}

fn counted(found: usize) -> Result<(), TargetFileError> {
    if (LEAST..=LARGEST).contains(&found) { Ok(()) } else { Err(TargetFileError::Count { found }) }
}

/// The points' lines: micrometres, normals and σ to six places.
fn body(surfels: &Surfels) -> String {
    let mut text = String::new();
    for Surfel { position: p, normal: n, weight } in surfels.rows() {
        let sigma = (1.0 / weight).sqrt().max(FINEST_M);
        writeln!(text, "{:.6} {:.6} {:.6} {:.6} {:.6} {:.6} {sigma:.6}", p.x, p.y, p.z, n.x, n.y, n.z)
            .expect("a string takes everything");
    }
    // A zero has no sign.
    text.replace("-0.000000", "0.000000")
}

const PROPERTIES: [&str; 7] = ["x", "y", "z", "nx", "ny", "nz", "sigma"];

/// A point: place, normal, σ.
struct Row([f64; 7]);

impl Row {
    fn surfel(&self) -> Surfel {
        let [x, y, z, nx, ny, nz, sigma] = self.0;
        Surfel { position: Point3::new(x, y, z), normal: Vector3::new(nx, ny, nz), weight: 1.0 / (sigma * sigma) }
    }

    fn check(&self) -> Result<(), &'static str> {
        let Surfel { position, normal, .. } = self.surfel();
        let [.., sigma] = self.0;
        if self.0.iter().any(|number| !number.is_finite()) {
            Err("a number is not finite")
        } else if position.coords.norm() > MODEL_REACH_M {
            Err("it lies more than 4.5 m from the origin")
        } else if (normal.norm() - 1.0).abs() > UNIT {
            Err("its normal is not of length 1")
        } else if !(FINEST_M..=COARSEST_M).contains(&sigma) {
            Err("its sigma is not between 0.00001 and 0.5 m")
        } else {
            Ok(())
        }
    }
}

impl PropertyAccess for Row {
    fn new() -> Self {
        Self([0.0; 7])
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let Some(number) = PROPERTIES.iter().position(|known| *known == name).and_then(|at| self.0.get_mut(at)) else {
            return PropertyAccessResult::Ignored;
        };
        *number = match property {
            Property::Double(value) => value,
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

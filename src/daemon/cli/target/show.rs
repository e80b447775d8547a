//! `tumbled target show`.

use std::fmt::Write;
use std::path::PathBuf;

use clap::Args as ClapArgs;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::super::{Failure, Outcome, output};
use crate::target::{SavedTarget, Sizes};

/// What `target show` is asked for.
#[derive(Debug, ClapArgs)]
#[command(
    after_help = "Examples:\n  tumbled target show mock-up.target.ply\n  tumbled target show mock-up.target.ply --json"
)]
pub struct Args {
    /// The saved target.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
}

/// A saved target, told.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TargetReport {
    /// What it is called.
    pub name: String,
    /// What it was made of.
    pub source: String,
    /// BLAKE3 of its points: the same digest is the same frame.
    pub digest: String,
    /// Surface elements.
    pub surfels: usize,
    /// How large it is, and how much of it is known.
    pub sizes: Sizes,
}

impl TargetReport {
    /// Of a saved target.
    pub fn of(saved: &SavedTarget) -> Self {
        Self {
            name: saved.name.clone(),
            source: saved.source.clone(),
            digest: saved.digest.clone(),
            surfels: saved.surfels.len(),
            sizes: Sizes::of(&saved.surfels),
        }
    }

    /// In words.
    pub fn text(&self) -> String {
        let Sizes { least_m, most_m, radius_m, closed, sigma_m } = &self.sizes;
        let mut text = String::new();
        let mut line = |key: &str, value: String| {
            writeln!(text, "{key:<10}{value}").expect("a string takes everything");
        };
        line("target", self.name.clone());
        line("frame", format!("{} (BLAKE3 of the points)", self.digest));
        line("made of", self.source.clone());
        let extents: Vec<String> =
            least_m.iter().zip(most_m).map(|(from, to)| format!("{from:+.3}..{to:+.3}")).collect();
        line("extent", format!("x, y, z {} m; {radius_m:.3} m from the origin at most", extents.join(", ")));
        line("surface", format!("{} elements, sigma {:.1} mm (median)", self.surfels, sigma_m * 1e3));
        line("closed", format!("{:.0} %: 100 is a body that is known from all sides", closed * 100.0));
        text
    }
}

/// Shows one.
///
/// # Errors
/// Exit code 2: a file that is no saved target.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let report = TargetReport::of(&super::read(&args.file)?);
    output::report(&report, args.json, || report.text())?;
    Ok(Outcome::Fine)
}

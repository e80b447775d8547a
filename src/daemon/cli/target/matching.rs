//! `tumbled target match`.

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::Args as ClapArgs;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::estimate::{Mode, StateReason};

use super::super::{Failure, InputArgs, Outcome, output, signals};
use crate::decoding::Inputs;
use crate::session::play::{Listener, play};
use crate::session::{Engine, Pace, Speed, Step};

/// What `target match` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  tumbled target match mock-up.target.ply friday.mcap\n  \
    tumbled target match mock-up.target.ply sim:demo --json\n\n\
    The same search as in a session with target.saved set. Exit code 3: what was seen is not recognised as the saved \
    target, or nothing was seen.")]
pub struct Args {
    /// The saved target.
    #[arg(value_name = "FILE")]
    file: PathBuf,
    #[command(flatten)]
    input: InputArgs,
    /// Threads of the core; 0 = one for each processor. Changes no result.
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
}

/// Whether a saved target was seen.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct MatchReport {
    /// What it is called.
    pub name: String,
    /// BLAKE3 of its points.
    pub digest: String,
    /// Whether it was recognised.
    pub recognised: bool,
    /// When it was first tracked, s of the session; null: never.
    pub tracked_from_s: Option<f64>,
    /// Epochs in which it was tracked.
    pub tracked: u64,
    /// Epochs in all.
    pub epochs: u64,
    /// Where it was at last: translation, m, rig frame.
    pub position_m: Option<[f64; 3]>,
    /// And its attitude, as a quaternion x, y, z, w: saved frame to rig.
    pub rotation_xyzw: Option<[f64; 4]>,
    /// Why it was not tracked, with the epochs of each reason.
    pub reasons: BTreeMap<String, u64>,
}

impl Listener for MatchReport {
    fn step(&mut self, step: &Step<'_>) -> Result<(), Failure> {
        for state in &step.outputs.states {
            self.epochs += 1;
            if state.mode != Mode::Tracking {
                for reason in &state.reasons {
                    *self.reasons.entry(reason.name().to_owned()).or_default() += 1;
                }
                continue;
            }
            self.tracked += 1;
            self.tracked_from_s.get_or_insert(state.t.0 as f64 * 1e-9);
            if let Some(motion) = &state.motion {
                let pose = &motion.t_rig_target;
                self.position_m = Some(pose.translation.vector.into());
                self.rotation_xyzw = Some(pose.rotation.coords.into());
            }
        }
        Ok(())
    }
}

/// Matches.
///
/// # Errors
/// Exit code 2: a file that is no saved target, inputs or a config that cannot be used.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let saved = super::read(&args.file)?;
    let mut input = args.input.clone();
    input.config.settings.push(format!("target.saved={}", args.file.display()));
    let loaded = input.load()?;
    let mut engine = Engine::of_config(&loaded, false, args.threads)?;
    let mut inputs = Inputs::open_ledger(&input.inputs, &loaded.config, args.threads)?;
    let mut pace = Pace::new(Speed::Max, signals::stop_token()?);
    let mut report = MatchReport { name: saved.name.clone(), digest: saved.digest.clone(), ..MatchReport::default() };
    play(&mut inputs, &mut engine, &mut report, &mut pace)?;
    report.recognised = report.tracked > 0;
    output::report(&report, args.json, || text(&report, saved.short_digest()))?;
    Ok(if report.recognised { Outcome::Fine } else { Outcome::Incomplete })
}

fn text(report: &MatchReport, digest: &str) -> String {
    let MatchReport { name, tracked, epochs, .. } = report;
    if let (Some(from), Some([x, y, z]), Some([qx, qy, qz, qw])) =
        (report.tracked_from_s, report.position_m, report.rotation_xyzw)
    {
        return format!(
            "{name} ({digest}) is seen: tracked from {from:.2} s on, in {tracked} of {epochs} epochs\n\
             at last at {x:.3}, {y:.3}, {z:.3} m, rotation xyzw {qx:.4}, {qy:.4}, {qz:.4}, {qw:.4} (saved frame to rig)\n"
        );
    }
    let count = |reason: StateReason| report.reasons.get(reason.name()).copied().unwrap_or(0);
    let why = if count(StateReason::Unrecognised) > 0 {
        "what is seen is not it, or does not tell it from another pose of it"
    } else {
        "too little was seen to tell"
    };
    format!("{name} ({digest}) is not recognised in {epochs} epochs: {why}\n")
}

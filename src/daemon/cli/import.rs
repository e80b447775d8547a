//! `tumbled import`: foreign captures into one recording, the ledger a live run would have had.
//!
//! The same inputs, config and program make the same bytes: no time of day and no machine is in the file.

use std::path::{Path, PathBuf};

use clap::Args as ClapArgs;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_io::capture::StampOrigin;
use tumbled_io::recording::{
    Origin, Recorder, RecorderOptions, RecordingHeader, RecordingSummary, digest_of, import_session,
};
use tumbled_sim::faults::FaultTruth;

use super::ledger::{self, LedgerReport};
use super::{Failure, FaultArgs, InputArgs, Outcome, VERSION, output};
use crate::config::{Loaded, show};
use crate::decoding::Inputs;
use crate::simulation::{faults, rig};

/// What `import` is asked for.
#[derive(Debug, ClapArgs)]
#[command(after_help = "Examples:\n  tumbled import drive.pcap -o drive.mcap\n  \
    tumbled import drive.pcap dump/ --config rig.toml -o both.mcap\n  \
    tumbled import session.mcap session-0001.mcap -o whole.mcap\n\n\
    Exit code 3: everything readable was imported, but part of an input could not be read.")]
pub struct Args {
    #[command(flatten)]
    input: InputArgs,
    #[command(flatten)]
    faults: FaultArgs,
    /// The recording to write.
    #[arg(short = 'o', long = "output", value_name = "FILE.mcap")]
    output: PathBuf,
    /// Replace the file if it is there.
    #[arg(long)]
    force: bool,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
}

/// What was imported.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled import --json")]
pub struct ImportReport {
    /// The recording.
    pub output: PathBuf,
    /// Its session id: the same for the same inputs and config.
    pub session: String,
    /// Its size.
    pub file_bytes: u64,
    /// Wall time at `t_ns` 0, ns since 1970-01-01 UTC as a decimal string. Null: the inputs have no times of their own.
    pub epoch_unix_ns: Option<String>,
    /// What it holds.
    pub ledger: LedgerReport,
    /// Everything in the inputs that is for a sensor of the config was imported; otherwise the exit code is 3.
    pub whole: bool,
    /// What was injected; null: nothing was asked for.
    pub faults: Option<FaultTruth>,
    /// What a person should know.
    pub warnings: Vec<String>,
}

/// Imports.
///
/// # Errors
/// Exit code 2: an input that cannot be used, an output that is there. 1: an output that cannot be written.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    refuse_input_as_output("-o", &args.output, &args.input.inputs)?;
    // A recording alone is copied with its own config, which need not be understood for that; faults name its sensors.
    let loaded =
        if args.input.is_scene() || args.faults.asked_for() { args.input.load()? } else { args.input.config.load()? };
    let inputs = Inputs::open_ledger(&args.input.inputs, &loaded.config, 0)?;
    let mut inputs = args.faults.inject(inputs, &loaded.config)?;
    let header = header(&inputs, &args.input.inputs, &loaded)?;
    let mut recorder = create(&args.output, header.clone(), args.force)?;
    let recorded = copy(&mut inputs, &mut recorder);
    let summary = recorder.finish();
    if let Err(failure) = recorded.and_then(|()| written(&summary)) {
        // It can be made again; half of it must not be taken for the whole. What cannot be removed stays unfinished.
        std::fs::remove_file(&args.output).unwrap_or_default();
        return Err(failure);
    }
    let mut warnings = inputs.warnings();
    warnings.extend(args.faults.warning(&inputs));
    let report = ImportReport {
        output: args.output.clone(),
        session: header.session,
        file_bytes: summary.file_bytes,
        epoch_unix_ns: (!header.synthetic_times).then(|| header.unix_at_zero.0.to_string()),
        ledger: (&summary.counters).into(),
        whole: !inputs.data_lost(),
        faults: inputs.faults().cloned(),
        warnings,
    };
    report.warnings.iter().for_each(|warning| tracing::warn!("{warning}"));
    output::report(&report, args.json, || text(&report))?;
    Ok(if report.whole { Outcome::Fine } else { Outcome::Incomplete })
}

/// An output that is an input would be emptied before it is read; `option` is what names it.
pub(super) fn refuse_input_as_output<'a>(
    option: &str,
    output: &Path,
    inputs: impl IntoIterator<Item = &'a PathBuf>,
) -> Result<(), Failure> {
    let Ok(output) = output.canonicalize() else { return Ok(()) };
    let inside = |input: &&PathBuf| {
        input.canonicalize().is_ok_and(|input| input == output || output.parent() == Some(input.as_path()))
    };
    match inputs.into_iter().find(inside) {
        Some(input) => Err(Failure::input(format!("{} is an input, it is not written to", input.display()))
            .with_help(format!("give {option} another path"))),
        None => Ok(()),
    }
}

pub(super) fn create(path: &Path, header: RecordingHeader, replace: bool) -> Result<Recorder, Failure> {
    create_with(path, header, RecorderOptions { replace, ..RecorderOptions::default() })
}

/// Begins a recording; what stands in its way is told with the remedy.
pub(crate) fn create_with(path: &Path, header: RecordingHeader, options: RecorderOptions) -> Result<Recorder, Failure> {
    use tumbled_io::recording::RecorderError;
    if path.is_dir() {
        return Err(Failure::input(format!("{} is a folder, a file is written", path.display()))
            .with_help("give -o a file name"));
    }
    Recorder::create(path, header, options).map_err(|error| match error {
        RecorderError::Exists { path } => {
            Failure::input(format!("{} is there already", path.display())).with_help("give -o another path, or --force")
        }
        RecorderError::NoName { .. } | RecorderError::TooLarge { .. } => Failure::input(error),
        _ => Failure::failed(error),
    })
}

/// A recording alone keeps what it says of itself; anything else becomes an import. Faults are told.
pub(super) fn header(inputs: &Inputs, paths: &[PathBuf], loaded: &Loaded) -> Result<RecordingHeader, Failure> {
    let mut header = header_without_faults(inputs, paths, loaded)?;
    inputs.mark_faults(&mut header);
    Ok(header)
}

fn header_without_faults(inputs: &Inputs, paths: &[PathBuf], loaded: &Loaded) -> Result<RecordingHeader, Failure> {
    if let Some(header) = inputs.recording() {
        return Ok(header.clone());
    }
    if let Some(scene) = inputs.scene() {
        return Ok(rig::header(scene, loaded, VERSION));
    }
    let digest = |path: &PathBuf| {
        digest_of(path).map_err(|error| Failure::input(format!("cannot read {}: {error}", path.display())))
    };
    let imported = paths.iter().map(digest).collect::<Result<Vec<_>, _>>()?;
    let (config, files) = (show::text(&loaded.tree, false), loaded.config.attachments());
    let simulated = |origin: Origin| origin == Origin::Simulated;
    let origins = inputs.captures().filter_map(|capture| capture.recording().map(|header| header.origin));
    let origin = if origins.into_iter().any(simulated) { Origin::Simulated } else { Origin::Import };
    let synthetic = |capture: &tumbled_io::capture::Capture| capture.summary().stamp_origin == StampOrigin::Synthetic;
    Ok(RecordingHeader {
        session: import_session(&imported, &config, &files),
        origin,
        program: VERSION.to_owned(),
        unix_at_zero: inputs.epoch().unwrap_or_default(),
        synthetic_times: inputs.captures().any(synthetic),
        config,
        files,
        inputs: imported,
        ..RecordingHeader::default()
    })
}

fn copy(inputs: &mut Inputs, recorder: &mut Recorder) -> Result<(), Failure> {
    while let Some(event) = inputs.next_event()? {
        // What was refused is in the summary; after a stop nothing more will be taken.
        if !recorder.write(&event) && recorder.summary().stopped.is_some() {
            break;
        }
    }
    Ok(())
}

/// The recorder's own troubles.
pub(super) fn written(summary: &RecordingSummary) -> Result<(), Failure> {
    if let Some(reason) = &summary.stopped {
        return Err(Failure::failed(reason.clone()));
    }
    if summary.unrecordable > 0 {
        let count = summary.unrecordable;
        return Err(Failure::failed(format!("{count} events are larger than a recording can hold (16 MiB)")));
    }
    Ok(())
}

fn text(report: &ImportReport) -> String {
    let (events, path) = (report.ledger.events, report.output.display());
    let mut text = format!("{events} events -> {path} ({:.1} MB)\n", report.file_bytes as f64 / 1e6);
    for line in ledger::table(&report.ledger) {
        text.push_str(&format!("  {line}\n"));
    }
    for line in report.faults.iter().flat_map(faults::lines) {
        text.push_str(&format!("  faults at {line}\n"));
    }
    text
}

//! What a session computes: the target's states, its fused points and its model. The inputs are played through the core, as `replay` and
//! `reconstruct` play them.

use std::time::Duration;

use indicatif::ProgressBar;
use tumbled_core::estimate::TargetState;
use tumbled_core::recon::{FusedPoint, ReconSettings};
use tumbled_model::UnixNs;

use super::outfile::OutFile;
use super::protected::Protected;
use super::table::{Column, Kind, TableFile, Value};
use super::{Args, Format, Report, What, names};
use crate::cli::{Failure, signals};
use crate::config::Loaded;
use crate::decoding::Inputs;
use crate::reconstruction::{Frames, make};
use crate::session::play::{Listener, play};
use crate::session::{Engine, Pace, Speed, Step};

/// Points of the target: its frame, metres.
const COLUMNS: &[Column] = &[
    Column { name: "x", kind: Kind::F32 },
    Column { name: "y", kind: Kind::F32 },
    Column { name: "z", kind: Kind::F32 },
    Column { name: "nx", kind: Kind::F32 },
    Column { name: "ny", kind: Kind::F32 },
    Column { name: "nz", kind: Kind::F32 },
    Column { name: "sigma", kind: Kind::F32 },
    Column { name: "plane", kind: Kind::I32 },
    Column { name: "kinect", kind: Kind::U32 },
    Column { name: "lidar", kind: Kind::U32 },
];
/// The heading of states as text.
const HEADING: &str = "epoch,t_ns,unix_ns,sensor,mode,validity,reasons,x_m,y_m,z_m,qx,qy,qz,qw,vx_mps,vy_mps,vz_mps,\
                       wx_rps,wy_rps,wz_rps,sigma_attitude_deg,sigma_position_mm,nis\n";

/// Plays the inputs and writes what was asked for.
pub(super) fn export(
    args: &Args,
    loaded: &Loaded,
    protected: &Protected,
    inputs: &mut Inputs,
) -> Result<Report, Failure> {
    match args.what {
        What::State => states(args, loaded, protected, inputs),
        _ => points(args, loaded, protected, inputs),
    }
}

/// Plays all of it; false: a stop came before the end.
fn played(inputs: &mut Inputs, engine: &mut Engine, listener: &mut impl Listener) -> Result<bool, Failure> {
    let progress = ProgressBar::new_spinner().with_message("playing the session");
    progress.enable_steady_tick(Duration::from_millis(200));
    let finished = play(inputs, engine, listener, &mut Pace::new(Speed::Max, signals::stop_token()?));
    progress.finish_and_clear();
    finished
}

/// Writes states as they come.
struct States<'a> {
    args: &'a Args,
    file: OutFile,
    unix_at_zero: UnixNs,
    /// Epochs so far, and of them those with a pose that were written.
    epochs: u64,
    written: u64,
}

impl Listener for States<'_> {
    fn step(&mut self, step: &Step<'_>) -> Result<(), Failure> {
        for state in &step.outputs.states {
            let number = self.epochs;
            self.epochs += 1;
            let is_wanted = self.args.sensor.as_ref().is_none_or(|sensor| sensor == state.sensor.as_str());
            if !is_wanted || !self.args.frames.contains(number) {
                continue;
            }
            let unix = step.wall.unix_or_from(state.t, self.unix_at_zero);
            let line = if self.args.format == Format::Tum { tum(state, unix) } else { Some(csv(state, unix)) };
            let Some(line) = line else { continue };
            self.written += 1;
            self.file.write(line.as_bytes())?;
        }
        Ok(())
    }
}

fn states(args: &Args, loaded: &Loaded, protected: &Protected, inputs: &mut Inputs) -> Result<Report, Failure> {
    let mut engine = Engine::of_config(loaded, false, 0)?;
    let mut file = OutFile::create(&args.output, false, protected)?;
    if args.format == Format::Csv {
        file.write(HEADING.as_bytes())?;
    }
    let unix_at_zero = inputs.epoch().unwrap_or_default();
    let mut states = States { args, file, unix_at_zero, epochs: 0, written: 0 };
    let finished = played(inputs, &mut engine, &mut states)?;
    if states.written == 0 {
        let why = match (states.epochs, args.format) {
            (0, _) => "the session has no epoch".to_owned(),
            (epochs, Format::Tum) => format!("none of the {epochs} epochs asked for has a pose"),
            (epochs, _) => format!("the session has {epochs} epochs, none of what was asked for"),
        };
        return Err(
            super::nothing_exported(&why, inputs).with_help("`tumbled replay INPUT -o states.jsonl` has every state")
        );
    }
    Ok(Report {
        sensor: args.sensor.clone().unwrap_or_else(|| "target".to_owned()),
        records: states.epochs,
        points: states.written,
        files: names(&[states.file.finish(b"")?]),
        ..blank(args, finished)
    })
}

/// Unix time in seconds, place and quaternion, as trajectories' tools read them. `None`: no pose.
fn tum(state: &TargetState, unix: UnixNs) -> Option<String> {
    let pose = &state.motion.as_ref()?.t_rig_target;
    let (at, q) = (&pose.translation.vector, &pose.rotation.coords);
    let (seconds, ns) = (unix.0.div_euclid(1_000_000_000), unix.0.rem_euclid(1_000_000_000));
    let numbers = [at.x, at.y, at.z, q.x, q.y, q.z, q.w].map(|number| format!("{number:.9}")).join(" ");
    Some(format!("{seconds}.{ns:09} {numbers}\n"))
}

/// A line with every column; what is not known is empty.
fn csv(state: &TargetState, unix: UnixNs) -> String {
    let word = |value: serde_json::Result<serde_json::Value>| {
        value.ok().and_then(|value| value.as_str().map(str::to_owned)).unwrap_or_default()
    };
    let reasons: Vec<String> = state.reasons.iter().map(|reason| word(serde_json::to_value(reason))).collect();
    let motion = state.motion.as_ref().map(|motion| {
        let (at, q) = (&motion.t_rig_target.translation.vector, &motion.t_rig_target.rotation.coords);
        let (v, w) = (&motion.velocity_mps, &motion.angular_velocity_rps);
        // Of the three axes together.
        let sigma = |first: usize| motion.covariance.fixed_view::<3, 3>(first, first).trace().sqrt();
        let (attitude, position) = (sigma(0), sigma(3));
        let all = [at.x, at.y, at.z, q.x, q.y, q.z, q.w, v.x, v.y, v.z, w.x, w.y, w.z];
        let all = all.into_iter().chain([attitude.to_degrees(), 1e3 * position]);
        all.map(|number| format!("{number:.9}")).collect::<Vec<_>>().join(",")
    });
    format!(
        "{},{},{},{},{},{},{},{},{}\n",
        state.epoch,
        state.t.0,
        unix.0,
        state.sensor,
        word(serde_json::to_value(state.mode)),
        word(serde_json::to_value(state.validity)),
        reasons.join(";"),
        motion.unwrap_or_else(|| ",".repeat(14)),
        state.nis.map(|nis| format!("{nis:.4}")).unwrap_or_default(),
    )
}

fn points(args: &Args, loaded: &Loaded, protected: &Protected, inputs: &mut Inputs) -> Result<Report, Failure> {
    if !args.frames.is_all() || args.sensor.is_some() {
        let why = "the target's points are made of the whole session and of all its sensors";
        return Err(Failure::input(why).with_help("leave out --frames and --sensor; export a part of the inputs"));
    }
    let mut engine = Engine::of_config(loaded, false, 0)?;
    engine.keep_frames();
    let mut frames = Frames::default();
    let finished = played(inputs, &mut engine, &mut frames)?;
    let settings = ReconSettings { planes: args.what == What::Model, ..ReconSettings::default() };
    let Some(made) = make::make(&frames.frames, &engine, &settings) else {
        return Err(super::nothing_exported("no frame of the session shows a tracked target", inputs));
    };
    let comments = vec!["target's frame, m; plane -1: none".to_owned()];
    let mut file = TableFile::create(&args.output, args.format, COLUMNS, comments, protected)?;
    let planes = made.model.plane_of.iter().map(|plane| plane.map_or(-1, |plane| plane as i32));
    for (point, plane) in made.model.points.iter().zip(planes) {
        file.row(&row(point, plane))?;
    }
    Ok(Report {
        sensor: "target".to_owned(),
        records: made.frames.len() as u64,
        points: made.model.points.len() as u64,
        files: names(&[file.finish()?]),
        ..blank(args, finished)
    })
}

fn row(point: &FusedPoint, plane: i32) -> [Value; 10] {
    let ([x, y, z], [nx, ny, nz]) = (point.place.coords.into(), point.normal.into());
    let single = |number: f64| Value::F32(number as f32);
    let [x, y, z, nx, ny, nz, sigma] = [x, y, z, nx, ny, nz, point.sigma_m].map(single);
    [x, y, z, nx, ny, nz, sigma, Value::I32(plane), Value::U32(point.kinect), Value::U32(point.lidar)]
}

/// What is the same of all; a session that was stopped is no whole one.
fn blank(args: &Args, finished: bool) -> Report {
    let stopped = (!finished).then(|| "the session was stopped before the inputs' end".to_owned());
    Report {
        what: args.what,
        format: args.format,
        sensor: String::new(),
        files: Vec::new(),
        records: 0,
        points: 0,
        lost: 0,
        not_decoded: 0,
        complete: finished,
        warnings: stopped.into_iter().collect(),
    }
}

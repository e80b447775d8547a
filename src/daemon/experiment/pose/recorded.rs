//! The experiment on a recording: its rests are found, and what is said of the target in them is compared.

use super::figures::{Known, PoseRow, row};
use super::methods::{PoseMethod, Seat};
use super::rests;
use crate::cli::{Failure, InputArgs, signals};
use crate::decoding::Inputs;
use crate::session::play::play;
use crate::session::{Engine, Pace, Speed};
use crate::simulation::rig::Sensors;

/// What was found of a recording.
#[derive(Debug)]
pub struct Found {
    /// A row for each method.
    pub rows: Vec<PoseRow>,
    /// What the rests were found by: `turntable ID`, or `estimate`.
    pub rests_by: String,
    /// What a person should know.
    pub warnings: Vec<String>,
}

/// Plays the inputs once for each method. Rests are those of the turntable's encoder where there is one, else those of the
/// first method's estimate.
///
/// # Errors
/// Exit code 2: inputs or a config that cannot be used, or in which nothing rests twice.
pub fn run(input: &InputArgs, methods: &[PoseMethod], threads: usize, seed: u64) -> Result<Option<Found>, Failure> {
    let (mut seats, mut warnings) = (Vec::new(), Vec::new());
    let stop = signals::stop_token()?;
    for method in methods {
        let mut args = input.clone();
        args.config.settings.extend(method.settings());
        let mut loaded = args.load()?;
        match method.sensors() {
            Sensors::All => {}
            Sensors::Kinect => loaded.config.lidars.clear(),
            Sensors::Lidar => loaded.config.kinects.clear(),
        }
        if loaded.config.lidars.is_empty() && loaded.config.kinects.is_empty() {
            warnings.push(format!("{}: the config has no sensor for it", method.name()));
            continue;
        }
        let t_rig_kinect = loaded.config.kinects.first().map(|kinect| kinect.t_rig_kinect.isometry);
        let mut seat = Seat::new(*method, t_rig_kinect.unwrap_or_default(), seed);
        let mut inputs = Inputs::open_ledger(&args.inputs, &loaded.config, threads)?;
        let mut engine = Engine::of_config(&loaded, false, threads)?;
        let mut pace = Pace::new(Speed::Max, stop.clone());
        if !play(&mut inputs, &mut engine, &mut seat, &mut pace)? {
            return Ok(None);
        }
        for warning in inputs.warnings() {
            if !warnings.contains(&warning) {
                warnings.push(warning);
            }
        }
        seats.push((*method, seat));
    }
    let turntable = seats.first().map(|(_, seat)| seat.turntable.as_slice()).unwrap_or_default();
    let encoder = rests::by_encoder(turntable);
    let angles: Vec<f64> = encoder.iter().map(|(_, angle)| *angle).collect();
    let (rests, known, rests_by) = match turntable.first().filter(|_| encoder.len() > 1) {
        Some(sample) => {
            let rests = encoder.iter().map(|(rest, _)| *rest).collect();
            (rests, Known::Encoder(&angles), format!("turntable {}", sample.sensor))
        }
        None => {
            let by_estimate = |(_, seat): &(PoseMethod, Seat)| {
                rests::by_rate(seat.poses.iter().filter_map(|posed| Some((posed.t, posed.rate_rps?))))
            };
            let found = seats.iter().map(by_estimate).find(|rests| rests.len() > 1).unwrap_or_default();
            (found, Known::Nothing, "estimate".to_owned())
        }
    };
    if rests.len() < 2 {
        return Err(Failure::input(format!(
            "{} rests of the target were found, and two are the least: neither a turntable's encoder nor an estimate stands \
             still for half a second",
            rests.len()
        ))
        .with_help("record a target that is turned in steps; docs/turntable.md tells how its encoder is recorded"));
    }
    let rows = seats.iter().map(|(method, seat)| row("recorded", None, *method, (&rests, &seat.poses), known));
    Ok(Some(Found { rows: rows.collect(), rests_by, warnings }))
}

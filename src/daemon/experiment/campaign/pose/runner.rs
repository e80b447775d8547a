//! All trials of a campaign, several sessions at a time.

use std::io::Write;
use std::sync::Mutex;

use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;
use tumbled_io::live::StopToken;
use tumbled_model::RigNs;

use super::file::{ConfigEntry, PoseCampaignFile, SceneEntry};
use super::trial::{Names, PoseTrial};
use super::watch::Watch;
use crate::cli::Failure;
use crate::experiment::lanes::{self, Lane};
use crate::simulation::scenes;

/// One simulated session: a scene with a seed.
struct Session<'a> {
    entry: &'a SceneEntry,
    seed: u64,
}

/// The trials of a campaign in the order of its scenes, seeds, configs and intervals, whatever the number of threads (0: one
/// for each processor). Each session's lines go to `log` when it is over. `None`: a stop came before the end.
///
/// # Errors
/// Exit code 2: a scene or config that cannot be used. 1: a log that cannot be written.
pub fn run(
    file: &PoseCampaignFile,
    seeds: Option<u64>,
    threads: usize,
    log: impl Write + Send,
    stop: &StopToken,
) -> Result<Option<Vec<PoseTrial>>, Failure> {
    let pool = scenes::pool(threads)?;
    let sessions: Vec<Session<'_>> = file
        .scene
        .iter()
        .flat_map(|entry| (0..seeds.unwrap_or(entry.seeds)).map(move |n| Session { entry, seed: file.seed + n }))
        .collect();
    let progress = progress(sessions.iter().map(|session| session.entry.duration_s).sum());
    let log = Mutex::new(log);
    let one = |session: &Session<'_>| -> Result<Option<Vec<PoseTrial>>, Failure> {
        progress.set_message(session.entry.id.clone());
        let Some(trials) = session.run(file, stop)? else { return Ok(None) };
        progress.inc(session.entry.duration_s as u64);
        let mut lines = Vec::new();
        for trial in &trials {
            serde_json::to_writer(&mut lines, trial).map_err(Failure::failed)?;
            lines.push(b'\n');
        }
        let mut log = log.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        log.write_all(&lines).and_then(|()| log.flush()).map_err(Failure::failed)?;
        Ok(Some(trials))
    };
    let found: Result<Vec<_>, Failure> = pool.install(|| sessions.par_iter().map(one).collect());
    progress.finish_and_clear();
    let found: Option<Vec<Vec<PoseTrial>>> = found?.into_iter().collect();
    Ok(found.map(|trials| trials.into_iter().flatten().collect()))
}

fn progress(seconds: f64) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len} s simulated  {eta} left  {msg}");
    ProgressBar::new(seconds as u64).with_style(style.unwrap_or_else(|_error| ProgressStyle::default_bar()))
}

impl Session<'_> {
    fn run(&self, file: &PoseCampaignFile, stop: &StopToken) -> Result<Option<Vec<PoseTrial>>, Failure> {
        let scene = self.entry.build(self.seed)?;
        let truth = lanes::truth(&scene)?;
        let configs: Vec<&ConfigEntry> = self.entry.configs.iter().filter_map(|id| file.config_of(id)).collect();
        let lane = |config: &&ConfigEntry| {
            let name = format!("{}/{}", self.entry.id, config.id);
            Lane::new(&scene, (config.view, config.sensors), &config.set, &name, Watch::default())
        };
        let mut lanes = configs.iter().map(lane).collect::<Result<Vec<_>, _>>()?;
        if !lanes::play(&scene, &mut lanes, stop)? {
            return Ok(None);
        }
        let returns = self.entry.returns_s.map(|seconds| RigNs((seconds * 1e9) as i64));
        let mut trials = Vec::new();
        for (config, lane) in configs.iter().zip(&lanes) {
            let digest = lane.digest();
            for (name, interval) in &self.entry.interval {
                let names = Names { scene: &self.entry.id, config: &config.id, interval: name };
                let seen = (&lane.listener, digest.as_str());
                trials.push(PoseTrial::of(names, (&scene, config.view, &truth), seen, interval, returns)?);
            }
        }
        Ok(Some(trials))
    }
}

//! The registration experiment: sets of pairs, and every method from every start on the same pairs.

use std::collections::BTreeMap;
use std::sync::Arc;

use indicatif::{ProgressBar, ProgressStyle};
use rayon::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::register::{Method, MethodOptions};
use tumbled_sim::target::TargetKind;

use super::figures::Figures;
use super::machine::Machine;
use super::pairs::{Attitudes, Pair, PairError, PairSpec, PointCounts, Stand, VIEWS};
use super::sweep::SweepPoint;
use super::trial::{self, Start, Trial};
use crate::cli::Failure;
use crate::simulation::scenes;

/// The published densities, and the densest of its text.
pub const DENSITIES: [PointCounts; 4] = [
    PointCounts { kinect: 1239, lidar: 126 },
    PointCounts { kinect: 2653, lidar: 358 },
    PointCounts { kinect: 8105, lidar: 828 },
    PointCounts { kinect: 8105, lidar: 951 },
];

/// Pairs of a set unless asked otherwise: every view once.
pub const PAIRS: u64 = VIEWS;

/// Pairs of one kind, and what is done with them.
#[derive(Clone, Debug, PartialEq)]
pub struct Set {
    /// Its name.
    pub name: String,
    /// What pairs.
    pub spec: PairSpec,
    /// How many.
    pub pairs: u64,
    /// Their seed.
    pub seed: u64,
    /// Methods, each with its start.
    pub runs: Vec<(Method, Start)>,
}

/// One line of the experiment's table: a method from a start on a set.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Row {
    /// The set's name.
    pub set: String,
    /// The Kinect's points; of a recording at most.
    pub kinect_points: u64,
    /// The LiDAR's points; of a recording at most.
    pub lidar_points: u64,
    /// Least and greatest angle between the sights, degrees; null: whatever a recording has.
    pub sights_deg: Option<[f64; 2]>,
    /// Whether the images with their misses were there beside the points.
    pub organised: bool,
    /// The method's name.
    pub method: String,
    /// What it began with.
    pub start: Start,
    /// What came of it.
    pub figures: Figures,
}

/// What `tumbled experiment registration` measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled experiment registration --json")]
pub struct ExperimentReport {
    /// The program's version and commit.
    pub program: String,
    /// Where it ran.
    pub machine: Machine,
    /// `simulated`, or the inputs' names.
    pub source: Vec<String>,
    /// What the pairs were held against: `simulated`, `scene`, `calibration` (the config's transforms) or `none`.
    pub truth: String,
    /// The seed.
    pub seed: u64,
    /// Registrations at a time: with more than one, times are those of a shared machine.
    pub threads: u64,
    /// A line for each method, start and set.
    pub rows: Vec<Row>,
    /// The published method's figures against its parameters; empty: not asked for.
    pub sweep: Vec<SweepPoint>,
    /// What a person should know.
    pub warnings: Vec<String>,
}

/// The sets of the published experiment: every density, sensors side by side and far apart.
pub fn sets(densities: &[PointCounts], methods: &[Method], pairs: u64, seed: u64) -> Vec<Set> {
    let kinds = [("views", [3.0, 10.0]), ("low-overlap", [40.0, 80.0])];
    let set = |(name, sights_deg): (&str, [f64; 2]), points: PointCounts| Set {
        name: name.to_owned(),
        spec: PairSpec {
            target: TargetKind::BoxBus,
            points,
            sights_deg,
            overlap: [0.0, 1.0],
            attitudes: Attitudes::Views,
            organised: false,
        },
        pairs,
        seed,
        runs: runs(methods),
    };
    kinds.into_iter().flat_map(|kind| densities.iter().map(move |points| set(kind, *points))).collect()
}

/// Every method without a prior, and with one those that take one.
pub fn runs(methods: &[Method]) -> Vec<(Method, Start)> {
    let global = methods.iter().map(|method| (*method, Start::Global));
    let prior = methods.iter().filter(|method| method.takes_prior()).map(|method| (*method, Start::PRIOR));
    global.chain(prior).collect()
}

/// Makes pairs on all processors, and registers them one after the other, so that times are those of one thread with the
/// machine to itself; or several at a time.
pub struct Runner {
    makers: Arc<rayon::ThreadPool>,
    registering: Option<Arc<rayon::ThreadPool>>,
    stands: BTreeMap<TargetKind, Stand>,
    options: MethodOptions,
    progress: ProgressBar,
}

impl Runner {
    /// A runner of so many registrations at a time (0: as many as there are processors), for so many in all.
    ///
    /// # Errors
    /// A machine that gives no threads: exit code 1.
    pub fn new(threads: usize, trials: u64) -> Result<Self, Failure> {
        let registering = if threads == 1 { None } else { Some(scenes::pool(threads)?) };
        let style = ProgressStyle::with_template("{bar:40} {pos}/{len}  {eta} left  {msg}");
        let progress = ProgressBar::new(trials).with_style(style.unwrap_or_else(|_error| ProgressStyle::default_bar()));
        Ok(Self {
            makers: scenes::pool(0)?,
            registering,
            stands: BTreeMap::new(),
            options: MethodOptions::default(),
            progress,
        })
    }

    /// The same with other settings of the methods.
    pub fn set_options(&mut self, options: MethodOptions) {
        self.options = options;
    }

    /// The trials of a set, run by run.
    ///
    /// # Errors
    /// Pairs that cannot be made as asked for: exit code 2.
    pub fn run(&mut self, set: &Set) -> Result<Vec<Vec<Trial>>, Failure> {
        let mut trials = vec![Vec::new(); set.runs.len()];
        // So many are held at a time.
        let chunk = 4 * self.makers.current_num_threads() as u64;
        for first in (0..set.pairs).step_by(chunk as usize) {
            self.progress.set_message(format!("{} {}", set.name, set.spec.points));
            let pairs = self.make(set, first..set.pairs.min(first + chunk))?;
            for (run, trials) in set.runs.iter().zip(&mut trials) {
                trials.extend(self.register(&pairs, *run, set.seed));
            }
        }
        Ok(trials)
    }

    /// Pairs of a set, in their order whatever thread made them.
    ///
    /// # Errors
    /// Pairs that cannot be made as asked for: exit code 2.
    pub fn make(&mut self, set: &Set, numbers: std::ops::Range<u64>) -> Result<Vec<Pair>, Failure> {
        let kind = set.spec.target;
        if let std::collections::btree_map::Entry::Vacant(vacant) = self.stands.entry(kind) {
            vacant.insert(Stand::new(kind).map_err(failure)?);
        }
        let Some(stand) = self.stands.get(&kind) else { return Ok(Vec::new()) };
        let numbers: Vec<u64> = numbers.collect();
        let made: Result<Vec<Pair>, PairError> =
            self.makers.install(|| numbers.par_iter().map(|number| stand.pair(&set.spec, set.seed, *number)).collect());
        made.map_err(failure)
    }

    /// The trials of some pairs by a method from a start.
    pub fn register(&self, pairs: &[Pair], (method, start): (Method, Start), seed: u64) -> Vec<Trial> {
        let one = |pair: &Pair| {
            let trial = trial::run(pair, method, &start, seed, &self.options);
            self.progress.inc(1);
            trial
        };
        match &self.registering {
            None => pairs.iter().map(one).collect(),
            Some(pool) => pool.install(|| pairs.par_iter().map(one).collect()),
        }
    }

    /// Takes the progress bar away.
    pub fn finish(&self) {
        self.progress.finish_and_clear();
    }
}

impl Set {
    /// How many registrations it is.
    pub fn trials(&self) -> u64 {
        self.pairs * self.runs.len() as u64
    }

    /// Its lines of the table.
    pub fn rows(&self, trials: &[Vec<Trial>]) -> Vec<Row> {
        let placed = |row| Row { sights_deg: Some(self.spec.sights_deg), organised: self.spec.organised, ..row };
        rows(&self.name, self.spec.points, &self.runs, trials).into_iter().map(placed).collect()
    }
}

/// Lines of the table for pairs that were recorded, with at most so many points.
pub fn rows(set: &str, points: PointCounts, runs: &[(Method, Start)], trials: &[Vec<Trial>]) -> Vec<Row> {
    let row = |((method, start), trials): (&(Method, Start), &Vec<Trial>)| Row {
        set: set.to_owned(),
        kinect_points: points.kinect as u64,
        lidar_points: points.lidar as u64,
        sights_deg: None,
        organised: false,
        method: method.name().to_owned(),
        start: *start,
        figures: Figures::of(trials),
    };
    runs.iter().zip(trials).map(row).collect()
}

/// What was asked for cannot be had, or the simulator is at fault.
fn failure(error: PairError) -> Failure {
    match error {
        PairError::Sensor(_) => Failure::failed(error),
        PairError::NotFound { .. } => Failure::input(error),
    }
}

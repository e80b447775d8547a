//! Pairs of a recording: LiDAR crossings, each with the Kinect frame nearest in time.

use nalgebra::{Isometry3, Point3};
use tumbled_core::register::{Cloud, SensorKind, View};
use tumbled_core::{Epoch, Scan};
use tumbled_model::{RigNs, SensorId, Span};
use tumbled_sim::noise::Noise;
use tumbled_sim::scene::Scene;

use super::pairs::{Pair, PointCounts};
use super::thin;
use crate::cli::{Failure, InputArgs};
use crate::config::{Config, ConfigSource, show};
use crate::decoding::Inputs;
use crate::session::chain::rig_digest;
use crate::session::{Engine, engine, setup};

/// A frame and a crossing farther apart are no pair: at 20°/s a target turns by 0.7° in that time.
const APART: Span = Span(35_000_000);
/// Clouds with fewer points of the target are left aside: it is not in sight.
const LEAST_POINTS: usize = 30;

/// What is wanted of a recording.
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
    /// Points at most.
    pub points: PointCounts,
    /// Pairs at most.
    pub pairs: u64,
    /// From one pair to the next, at least.
    pub every: Span,
    /// What thinning begins with.
    pub seed: u64,
    /// Threads of the core.
    pub threads: usize,
}

/// Where the truth comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Truth {
    /// The scene of a simulated input.
    Scene,
    /// The config's transforms: as good as the calibration.
    Calibration,
    /// Nobody knows.
    None,
}

impl Truth {
    /// In reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Scene => "scene",
            Self::Calibration => "calibration",
            Self::None => "none",
        }
    }
}

/// The pairs of a recording.
#[derive(Debug)]
pub struct RecordedPairs {
    /// In the order of time.
    pub pairs: Vec<Pair>,
    /// What they can be held against.
    pub truth: Truth,
    /// What a person should know.
    pub warnings: Vec<String>,
}

/// Reads inputs as `replay` does and pairs the first LiDAR's crossings with the first Kinect's frames, cut to the region of
/// interest.
///
/// # Errors
/// Exit code 2: inputs that cannot be read, or without both sensors.
pub fn pairs(args: &InputArgs, wanted: &Wanted) -> Result<RecordedPairs, Failure> {
    let loaded = args.load()?;
    let config = &loaded.config;
    let (Some(lidar), Some(kinect)) = (config.lidars.first(), config.kinects.first()) else {
        return Err(Failure::input("the config has no LiDAR and Kinect to register with each other")
            .with_help("give one of each in the config: [[lidar]] and [[kinect]]"));
    };
    let mut inputs = Inputs::open_ledger(&args.inputs, config, wanted.threads)?;
    let rig = rig_digest(&show::text(&loaded.tree, false), &config.attachments());
    let core = setup::core_config(config)?;
    let mut engine = Engine::new(core, rig, engine::workers(wanted.threads)?, engine::interpreter(config, false));
    let mut matching = Matching::new(lidar.id.clone(), kinect.id.clone(), *wanted);
    while !matching.is_full() {
        let Some(event) = inputs.next_event()? else { break };
        matching.take(&engine.step(&event).outputs.epochs);
    }
    matching.take(&engine.finish().outputs.epochs);
    if matching.found.is_empty() {
        let (lidar, kinect) = (matching.crossings, matching.frames);
        let error = format!(
            "no pair: {lidar} crossings of the LiDAR and {kinect} frames of the Kinect with {LEAST_POINTS} points or more in the \
            region of interest, none within {} ms of each other",
            APART.0 / 1_000_000
        );
        let help =
            "`tumbled info` tells what the inputs hold; [target] roi_center_m and roi_radius_m say where the target is";
        return Err(Failure::input(error).with_help(help));
    }
    let truth = match (inputs.scene(), &loaded.source) {
        (Some(_), _) => Truth::Scene,
        (None, ConfigSource::Default) => Truth::None,
        (None, _) => Truth::Calibration,
    };
    let t_lidar_kinect = config_transform(config);
    let pairs = matching.found.into_iter().zip(0..).map(|(found, index)| {
        let truth = match truth {
            Truth::Scene => inputs.scene().and_then(|scene| scene_transform(scene, &found)),
            Truth::Calibration => t_lidar_kinect,
            Truth::None => None,
        };
        found.pair(index, truth)
    });
    let pairs = pairs.collect();
    Ok(RecordedPairs { pairs, truth, warnings: inputs.warnings() })
}

/// Kinect to LiDAR as the config has it.
fn config_transform(config: &Config) -> Option<Isometry3<f64>> {
    let (lidar, kinect) = (config.lidars.first()?, config.kinects.first()?);
    Some(lidar.t_rig_lidar.isometry.inverse() * kinect.t_rig_kinect.isometry)
}

/// Kinect to LiDAR as the target was at the two times: it goes on between them.
fn scene_transform(scene: &Scene, found: &Found) -> Option<Isometry3<f64>> {
    let (lidar, kinect) = (scene.config.lidar.first()?, scene.config.kinect.first()?);
    let body = |t| scene.world.target(t).map(|state| state.t_rig_body);
    let at_lidar = lidar.t_rig_lidar.isometry().inverse() * body(found.crossing.t)?;
    Some(at_lidar * body(found.frame.t)?.inverse() * kinect.t_rig_kinect.isometry())
}

/// One sensor's points of the target.
#[derive(Clone, Debug)]
struct Seen {
    t: RigNs,
    points: Vec<Point3<f32>>,
}

/// A crossing and its frame.
#[derive(Debug)]
struct Found {
    crossing: Seen,
    frame: Seen,
}

impl Found {
    fn pair(self, index: u64, truth: Option<Isometry3<f64>>) -> Pair {
        let cloud = |sensor, points| Cloud { sensor, points, viewpoint: Some(Point3::origin()), view: View::Bare };
        Pair {
            index,
            moving: cloud(SensorKind::Kinect, self.frame.points),
            reference: cloud(SensorKind::Lidar, self.crossing.points),
            truth,
            body: None,
            overlap: None,
            sights_deg: None,
        }
    }
}

/// Epochs in their order to pairs.
struct Matching {
    lidar: SensorId,
    kinect: SensorId,
    wanted: Wanted,
    /// The last frame, and the crossing that waits for the first frame after it.
    frame: Option<Seen>,
    waiting: Option<Seen>,
    next: Option<RigNs>,
    crossings: u64,
    frames: u64,
    found: Vec<Found>,
}

impl Matching {
    fn new(lidar: SensorId, kinect: SensorId, wanted: Wanted) -> Self {
        let (frame, waiting, next, found) = (None, None, None, Vec::new());
        Self { lidar, kinect, wanted, frame, waiting, next, crossings: 0, frames: 0, found }
    }

    fn is_full(&self) -> bool {
        self.found.len() as u64 >= self.wanted.pairs
    }

    fn take(&mut self, epochs: &[Epoch]) {
        for epoch in epochs {
            let Some(points) = seen(epoch) else { continue };
            let seen = Seen { t: epoch.t, points };
            if epoch.sensor == self.lidar {
                self.crossings += 1;
                if self.next.is_none_or(|next| seen.t >= next) {
                    self.waiting = Some(seen);
                }
            } else if epoch.sensor == self.kinect {
                self.frames += 1;
                self.frame_came(seen);
            }
        }
    }

    fn frame_came(&mut self, frame: Seen) {
        let before = self.frame.replace(frame.clone());
        // A frame that came before the crossing's time may not be the last of its kind.
        let Some(crossing) = self.waiting.take_if(|crossing| frame.t >= crossing.t) else { return };
        let apart = |frame: &Seen| (frame.t.0 - crossing.t.0).abs();
        let nearest = match before {
            Some(before) if apart(&before) < apart(&frame) => before,
            _ => frame,
        };
        if apart(&nearest) > APART.0 || self.is_full() {
            return;
        }
        self.next = Some(crossing.t + self.wanted.every);
        let mut noise = Noise::new(self.wanted.seed, "recorded.thin", self.found.len() as u64);
        let PointCounts { kinect, lidar } = self.wanted.points;
        self.found.push(Found {
            crossing: Seen { t: crossing.t, points: thin::picked(&crossing.points, lidar, &mut noise) },
            frame: Seen { t: nearest.t, points: thin::voxelised(&nearest.points, kinect, &mut noise) },
        });
    }
}

/// An epoch's points in the region of interest, in the sensor's frame; `None`: too few.
pub fn seen(epoch: &Epoch) -> Option<Vec<Point3<f32>>> {
    let inside = |n: usize| epoch.rig.in_roi.get(n).is_some_and(|inside| *inside);
    let point = |[x, y, z]: [&[f32]; 3], n: usize| Some(Point3::new(*x.get(n)?, *y.get(n)?, *z.get(n)?));
    let points: Vec<Point3<f32>> = match &epoch.scan {
        Scan::Kinect(scan) => {
            let columns = [scan.points.x(), scan.points.y(), scan.points.z()];
            (0..scan.points.len()).filter(|n| inside(*n)).filter_map(|n| point(columns, n)).collect()
        }
        Scan::Lidar(scan) => {
            let columns = [scan.points.x.as_slice(), &scan.points.y, &scan.points.z];
            scan.crossing.clone().filter(|n| inside(*n)).filter_map(|n| point(columns, n)).collect()
        }
    };
    (points.len() >= LEAST_POINTS).then_some(points)
}

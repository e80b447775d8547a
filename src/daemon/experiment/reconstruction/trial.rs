//! One target and seed: its models, and how far they are from the truth.

use nalgebra::{Isometry3, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::estimate::KeptFrame;
use tumbled_core::neighbours::KdTree;
use tumbled_core::recon::score::precision_recall;
use tumbled_core::recon::{FusedPoint, ReconSettings};
use tumbled_core::register::SensorKind;
use tumbled_io::live::StopToken;
use tumbled_model::RigNs;
use tumbled_sim::scene::{Scene, SceneTarget};
use tumbled_sim::target::TargetKind;

use super::truth::SeenTruth;
use crate::cli::Failure;
use crate::experiment::lanes::{self, Lane};
use crate::reconstruction::make::Laid;
use crate::reconstruction::{Frames, Made, make};
use crate::simulation::rig::{Sensors, View};
use crate::simulation::scenes;

/// The scene: a box bus, or what is put in its place, at 20 °/s, 2.2 m away.
const SCENE: &str = "turntable-20dps";
/// Its rate, degrees a second, and so a turn, s.
const TURN_S: f64 = 18.0;
/// Before the turn the target is acquired and the filter settles, s; after it a pose is compared with one a turn before.
const AROUND_S: f64 = 5.0;
/// A place of the surface is in the model within this, m.
const WITHIN_M: f32 = 0.010;
/// Points a model is laid on the mesh by, and scored by.
const POINTS: usize = 3_000;

/// Whose data a model is of.
pub const LANES: [(&str, Sensors); 3] =
    [("fused", Sensors::All), ("kinect", Sensors::Kinect), ("lidar", Sensors::Lidar)];
/// The targets.
pub const TARGETS: [(&str, TargetKind); 2] = [("box", TargetKind::BoxBus), ("hex", TargetKind::HexBus)];

/// What a trial is of.
#[derive(Clone, Copy, Debug)]
pub struct Trial {
    /// The target.
    pub target: (&'static str, TargetKind),
    /// Everything random follows from it.
    pub seed: u64,
    /// Whose view of the rig.
    pub view: View,
}

/// A model's figures; null: there is nothing to say it of.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Row {
    /// `box` or `hex`.
    pub target: String,
    /// The seed.
    pub seed: u64,
    /// `fused`, `kinect` or `lidar`.
    pub sensors: String,
    /// Whether points were put on planes.
    pub planes: bool,
    /// Points of the model.
    pub points: u64,
    /// Root mean square distance of the LiDARs' points on planes from the true surface, mm: as measured.
    pub lidar_before_mm: Option<f64>,
    /// The same once they are put on the planes.
    pub lidar_after_mm: Option<f64>,
    /// The one over the other.
    pub lidar_ratio: Option<f64>,
    /// Mean distance of the model's points from the true surface, mm.
    pub to_mesh_mm: Option<f64>,
    /// Share of the seen surface within 1 cm of a point of the model.
    pub complete: Option<f64>,
    /// Share of the contour, by length, on a true edge within 1.5 cm and 1°.
    pub precision: Option<f64>,
    /// Share of the seen true edges of 5 cm and more on the contour.
    pub recall: Option<f64>,
    /// How far the frames' poses a turn apart differ from the truth's, degrees: root mean square.
    pub loop_deg: Option<f64>,
    /// How far the turn's mean axis is off, degrees.
    pub axis_deg: Option<f64>,
    /// How far its rate is off, °/s.
    pub rate_dps: Option<f64>,
}

impl Trial {
    fn scene(&self) -> Result<Scene, Failure> {
        scenes::load_changed(SCENE, |config| {
            config.seed = self.seed;
            config.duration_s = TURN_S + AROUND_S;
            config.target = SceneTarget::of(self.target.1);
        })
    }

    /// The rows of all lanes, with and without planes; `None`: a stop came before the end.
    ///
    /// # Errors
    /// A machine that gives no threads.
    pub fn run(&self, stop: &StopToken) -> Result<Option<Vec<Row>>, Failure> {
        let scene = self.scene()?;
        let lane = |(name, sensors): &(&str, Sensors)| {
            let mut lane = Lane::new(&scene, (self.view, *sensors), &[], name, Frames::default())?;
            lane.keep_frames();
            Ok::<_, Failure>(lane)
        };
        let mut lanes = LANES.iter().map(lane).collect::<Result<Vec<_>, _>>()?;
        if !lanes::play(&scene, &mut lanes, stop)? {
            return Ok(None);
        }
        let truth = SeenTruth::of(&scene);
        let mut rows = Vec::new();
        for ((name, _), lane) in LANES.iter().zip(&lanes) {
            let frames = &lane.listener.frames;
            let row = |planes: bool, made: Option<&Made>| {
                let blank = Row {
                    target: self.target.0.to_owned(),
                    seed: self.seed,
                    sensors: (*name).to_owned(),
                    planes,
                    ..Row::default()
                };
                made.map_or(blank.clone(), |made| score(blank, &scene, &truth, frames, made))
            };
            let made = make::make(frames, lane.engine(), &ReconSettings::default());
            rows.push(row(true, made.as_ref()));
            rows.push(row(false, made.map(Made::without_planes).as_ref()));
        }
        Ok(Some(rows))
    }
}

/// The model's frame in the mesh's: by the poses of a frame in the middle and the truth, then by the surface itself.
fn gauge(scene: &Scene, truth: &SeenTruth, frames: &[KeptFrame], points: &[Point3<f64>]) -> Option<Isometry3<f64>> {
    let middle = frames.get(frames.len() / 2)?;
    let t_rig_body = scene.world.target(middle.frame.shot().t)?.t_rig_body;
    Some(truth.surface.aligned(points, &(t_rig_body.inverse() * middle.t_rig_target)))
}

fn score(row: Row, scene: &Scene, truth: &SeenTruth, frames: &[KeptFrame], made: &Made) -> Row {
    let thin = |points: &[FusedPoint]| -> Vec<Point3<f64>> {
        points.iter().step_by(points.len() / POINTS + 1).map(|point| point.place).collect()
    };
    let points = thin(&made.model.points);
    let Some(pose) = gauge(scene, truth, frames, &points) else { return row };
    let off: f64 = points.iter().map(|point| truth.surface.distance_m(&(pose * point))).sum();
    let lidar = lidar_points(truth, &pose, made);
    let tree = KdTree::build(&made.model.points.iter().map(|point| (pose * point.place).cast()).collect::<Vec<_>>());
    let near = truth.area.iter().filter(|place| tree.nearest(&place.cast(), WITHIN_M * WITHIN_M).is_some()).count();
    let spin = made.motion.as_ref().and_then(|motion| spin_error(scene, made, &motion.spin.rate_rps));
    let (precision, recall) = precision_recall(&made.model.edges, &pose, &truth.edges, &truth.seen_edges);
    Row {
        points: made.model.points.len() as u64,
        lidar_before_mm: lidar.map(|(before, _)| 1e3 * before),
        lidar_after_mm: lidar.map(|(_, after)| 1e3 * after),
        lidar_ratio: lidar.map(|(before, after)| before / after),
        to_mesh_mm: (!points.is_empty()).then(|| 1e3 * off / points.len() as f64),
        complete: (!truth.area.is_empty()).then(|| near as f64 / truth.area.len() as f64),
        precision: precision.filter(|_| row.planes),
        recall: recall.filter(|_| row.planes),
        loop_deg: loop_error_deg(scene, made, &pose),
        axis_deg: spin.map(|(axis, _)| axis.to_degrees()),
        rate_dps: spin.map(|(_, rate)| rate.to_degrees()),
        ..row
    }
}

/// Root mean square distances of LiDAR points on planes from the true surface, m: as measured, and on their planes.
fn lidar_points(truth: &SeenTruth, pose: &Isometry3<f64>, made: &Made) -> Option<(f64, f64)> {
    let frames = made.frames.iter().filter(|frame| frame.kind == SensorKind::Lidar);
    let all: Vec<_> = frames.flat_map(|frame| &frame.points).collect();
    let (mut before, mut after, mut count) = (0.0, 0.0, 0.0);
    for point in all.iter().step_by(all.len() / POINTS + 1) {
        let flat = made.model.flatten(&point.place, &point.normal, point.sigma_m, &made.settings);
        let Some((_, place)) = flat else { continue };
        let [measured, put] = [point.place, place].map(|place| truth.surface.distance_m(&(pose * place)));
        before += measured * measured;
        after += put * put;
        count += 1.0;
    }
    (count > 0.0).then(|| ((before / count).sqrt(), (after / count).sqrt()))
}

/// How far an angular velocity is off that of the truth in the middle of the frames: its direction, rad, and length, rad/s.
fn spin_error(scene: &Scene, made: &Made, rate_rps: &Vector3<f64>) -> Option<(f64, f64)> {
    let truth = scene.world.target(made.laid.get(made.laid.len() / 2)?.t)?.angular_velocity_rps;
    Some((truth.angle(rate_rps), (rate_rps.norm() - truth.norm()).abs()))
}

/// How far the turn between frames of one sensor, a turn of the target apart, is off.
fn loop_error_deg(scene: &Scene, made: &Made, pose: &Isometry3<f64>) -> Option<f64> {
    let (mut squares, mut count) = (0.0, 0.0);
    for first in &made.laid {
        let later = RigNs(first.t.0 + (TURN_S * 1e9) as i64);
        let same = made.laid.iter().filter(|laid| laid.sensor == first.sensor);
        let Some(last) = same.min_by_key(|laid| (laid.t - later).0.abs()) else { continue };
        // A frame is kept every 3°: half a second and a half of a turn in the slowest case.
        if (last.t - later).0.abs() > 200_000_000 {
            continue;
        }
        let truth = |laid: &Laid| Some(scene.world.target(laid.t)?.t_rig_body);
        let (Some(a), Some(b)) = (truth(first), truth(last)) else { continue };
        // In the mesh's frame, which the estimate's is laid on.
        let [from, to] = [first, last].map(|laid| laid.t_rig_target * pose.inverse());
        let off = (a.inverse() * b).inverse() * (from.inverse() * to);
        let angle = off.rotation.angle().to_degrees();
        squares += angle * angle;
        count += 1.0;
    }
    (count > 0.0).then(|| (squares / count).sqrt())
}

//! What `calibrate kinect` found: as JSON, and as entries of the calibration file.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_calib::Status;
use tumbled_calib::depth_camera::{DepthCalibration, Found, MAP, Map, SURFACE_TERMS};

use super::camera::KinectCamera;
use super::extrinsic::{COVARIANCE_OF, Placed, TransformJson, enter_place, placed};
use super::gather::Pair;
use super::provenance::Provenance;
use super::standstill::Still;
use crate::config::RawDepthWarp;
use crate::config::calibration::{CalibratedIntrinsics, RawCalibration};

/// Where among the unknowns the surface and the lens begin.
const SURFACE: usize = 7;
const LENS: usize = SURFACE + SURFACE_TERMS;

/// What `tumbled calibrate kinect` found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled calibrate kinect --json")]
pub struct KinectReport {
    /// The verdict, the gates, the covariance of place and scale, and what it was made from.
    pub provenance: Provenance,
    /// What was shown: `board 0.80 x 0.60 m`.
    pub target: String,
    /// The LiDAR's id.
    pub lidar: String,
    /// The Kinect's id.
    pub kinect: String,
    /// The result; null: there is none, and the gates say why.
    pub result: Option<KinectResult>,
    /// The config's place of the Kinect in the LiDAR's frame, from which it began.
    pub start_t_lidar_kinect: TransformJson,
    /// The models that were compared.
    pub models: Vec<ModelLine>,
    /// The poses in the order of time.
    pub poses: Vec<ShownLine>,
    /// The file that was written; null: none, because the result failed.
    pub written: Option<String>,
    /// Where what was there before is kept; null: nothing was.
    pub kept: Option<String>,
    /// What a person should know.
    pub warnings: Vec<String>,
}

/// The result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct KinectResult {
    /// The model that the data bear, in words.
    pub model: String,
    /// Where the Kinect is; its depth scale is true depth over the depth law's.
    pub place: Placed,
    /// What is added to the scaled depths; null: the data do not bear a surface.
    pub depth_warp: Option<RawDepthWarp>,
    /// One standard deviation of its factors; null: not solved for.
    pub sigma_depth_warp: Vec<Option<f64>>,
    /// The lens: fx, fy, cx, cy (px), k1, k2. What was not solved for is the config's.
    pub lens: [f64; 6],
    /// One standard deviation of each; null: not solved for, the data do not bear it.
    pub sigma_lens: [Option<f64>; 6],
    /// How far beyond the board's last pixel its edge lies, along rows and along columns, px.
    pub edge_px: [f64; 2],
    /// Noise of the depth over the usual 1.5e-3 z², of patches of 16 x 16 pixels.
    pub depth_noise: f64,
    /// Noise of the board's edges, px.
    pub edge_noise_px: f64,
    /// Depths beyond the LiDAR's planes over the picture, of boards held back in turn.
    pub held_out: HeldOutMap,
    /// How the depths move in time; null: too few poses tell it.
    pub drift: Option<DriftJson>,
}

/// Depths beyond the LiDAR's planes over the picture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HeldOutMap {
    /// Cells across the picture.
    pub columns: usize,
    /// Cells down the picture.
    pub rows: usize,
    /// With a depth scale alone, mm, row by row; null: fewer than two boards were seen there.
    pub scale_alone_mm: Vec<Option<f64>>,
    /// With the model, mm.
    pub model_mm: Vec<Option<f64>>,
    /// Root mean square over the cells with a scale alone, mm.
    pub scale_alone_rms_mm: Option<f64>,
    /// Root mean square over the cells with the model, mm.
    pub model_rms_mm: Option<f64>,
    /// The share of the cells that boards were seen in.
    pub seen_share: f64,
}

/// How the depths move while the camera runs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DriftJson {
    /// mm of depth a minute.
    pub mm_per_minute: f64,
    /// One standard deviation.
    pub sigma: f64,
    /// From the first pose to the last, s.
    pub seconds: f64,
}

/// A model that was compared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ModelLine {
    /// What it solves for besides the place.
    pub name: String,
    /// Sum of the residuals' squares in their noise.
    pub cost: f64,
    /// Bayesian information criterion; a richer model is taken if it is less by 6.
    pub criterion: f64,
    /// Whether it was taken.
    pub taken: bool,
}

/// A pose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ShownLine {
    /// Counts from 0.
    pub number: usize,
    /// Session time of its beginning, s.
    pub from_s: f64,
    /// Session time of its end, s.
    pub until_s: f64,
    /// Frames it is the mean of.
    pub frames: usize,
    /// Why it is not used; null: it is.
    pub left_aside: Option<String>,
}

fn held_out((before, after): &(Map, Map)) -> HeldOutMap {
    let [columns, rows] = MAP;
    HeldOutMap {
        columns,
        rows,
        scale_alone_mm: before.cells_mm.clone(),
        model_mm: after.cells_mm.clone(),
        scale_alone_rms_mm: before.rms_mm(),
        model_rms_mm: after.rms_mm(),
        seen_share: after.share(),
    }
}

fn result(found: &Found, pair: &Pair<'_>) -> (KinectResult, Vec<Vec<f64>>) {
    let state = &found.state;
    let (place, rows) = placed(&state.t_lidar_camera, &found.covariance, Some(state.depth_scale), pair);
    let sigma = |n: usize| found.sigma.get(n).copied().flatten();
    let lens = state.lens;
    let warp = RawDepthWarp { power: state.power, factors: state.surface };
    let result = KinectResult {
        model: found.model.name(),
        place,
        depth_warp: (found.model.order > 0).then_some(warp),
        sigma_depth_warp: (SURFACE..LENS).map(sigma).collect(),
        lens: [lens.fx, lens.fy, lens.cx, lens.cy, lens.k1, lens.k2],
        sigma_lens: [0, 1, 2, 3, 4, 5].map(|n| sigma(LENS + n)),
        edge_px: state.edge_px,
        depth_noise: found.noise.0,
        edge_noise_px: found.noise.1,
        held_out: held_out(&found.maps),
        drift: found.drift.map(|drift| DriftJson {
            mm_per_minute: drift.mm_per_minute,
            sigma: drift.sigma,
            seconds: drift.seconds,
        }),
    };
    (result, rows)
}

/// The report of a result; nothing is written yet.
pub fn report(
    done: &DepthCalibration,
    stills: &[Still],
    pair: &Pair<'_>,
    target: String,
    mut provenance: Provenance,
) -> KinectReport {
    let found = done.found.as_ref().map(|found| result(found, pair));
    if let Some((_, rows)) = &found {
        provenance.covariance_of = COVARIANCE_OF.map(str::to_owned).to_vec();
        provenance.covariance.clone_from(rows);
    }
    if let Some(serial) = &pair.kinect.serial {
        provenance.serials.insert(pair.kinect.id.to_string(), serial.clone());
    }
    let taken = done.found.as_ref().map(|found| found.model);
    let seconds = |t: tumbled_model::RigNs| t.0 as f64 * 1e-9;
    KinectReport {
        provenance,
        target,
        lidar: pair.lidar.id.to_string(),
        kinect: pair.kinect.id.to_string(),
        result: found.map(|(result, _)| result),
        start_t_lidar_kinect: (&done.start).into(),
        models: done
            .tried
            .iter()
            .map(|tried| ModelLine {
                name: tried.model.name(),
                cost: tried.cost,
                criterion: tried.criterion,
                taken: Some(tried.model) == taken,
            })
            .collect(),
        poses: done
            .poses
            .iter()
            .zip(stills)
            .map(|(pose, still)| ShownLine {
                number: pose.number,
                from_s: seconds(still.from),
                until_s: seconds(still.until),
                frames: still.frames,
                left_aside: pose.left_aside.clone(),
            })
            .collect(),
        written: None,
        kept: None,
        warnings: Vec::new(),
    }
}

/// Puts the result into a calibration file's content; one that failed is not put there. Scale, surface, lens and place were found
/// together and replace what was there together.
pub fn enter(file: &mut RawCalibration, report: &KinectReport, pair: &Pair<'_>) -> bool {
    let Some(result) = &report.result else { return false };
    if report.provenance.status == Status::Fail {
        return false;
    }
    // Depths were measured with the law alone.
    enter_place(file, &result.place, pair, 1.0);
    let kinect = file.kinect.entry(report.kinect.clone()).or_default();
    // None stands for a flat surface: a config that has another one would else keep it.
    let flat = RawDepthWarp { power: 0, factors: [0.0; SURFACE_TERMS] };
    kinect.depth_warp = Some(result.depth_warp.unwrap_or(flat));
    let [fx, fy, cx, cy, k1, k2] = result.lens;
    let said = KinectCamera::of(pair.kinect).said();
    kinect.intrinsics = Some(CalibratedIntrinsics { fx, fy, cx, cy, k1, k2, p1: said.p1, p2: said.p2, k3: said.k3 });
    true
}

//! What a model is like, for machines and for people.

use nalgebra::{Isometry3, Point3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::recon::{Edge, EdgeKind, FoundPlane};
use tumbled_core::register::SensorKind;
use tumbled_core::smooth::Smoothed;

use super::make::{Made, Thickness, middle};
use crate::stream::StreamOrigin;

/// What `tumbled reconstruct` made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled reconstruct --json")]
pub struct ReconstructReport {
    /// The program's version and commit.
    pub program: String,
    /// The inputs.
    pub inputs: Vec<String>,
    /// `replay` or `simulated`.
    pub origin: StreamOrigin,
    /// One hash over everything that came out of the session, as `tumbled replay --digest` prints it.
    pub digest: String,
    /// Frames of Kinects and crossings of LiDARs the model is made of.
    pub kinect_frames: u64,
    /// See `kinect_frames`.
    pub lidar_frames: u64,
    /// Points of the model.
    pub points: u64,
    /// Points left out, because fewer than three frames saw them.
    pub rare: u64,
    /// The spacing of the points, m.
    pub spacing_m: f64,
    /// Planes.
    pub planes: u64,
    /// Share of the points that are on planes.
    pub on_planes: f64,
    /// Creases, confirmed boundaries, and edges that may be where something in front ended.
    pub creases: u64,
    /// See `creases`.
    pub boundaries: u64,
    /// See `creases`.
    pub occlusions: u64,
    /// How thick the Kinects' points lie about the planes; null: they have none there.
    pub kinect: Option<Thickness>,
    /// How thick the LiDARs' points do.
    pub lidar: Option<Thickness>,
    /// How the target turned, by all frames at once; null: too few frames, or the session ended with another target.
    pub spin: Option<SpinReport>,
    /// The files, in the output folder.
    pub files: Vec<String>,
    /// Nothing of the inputs was missing and nothing stopped the replay. Otherwise the exit code is 3.
    pub complete: bool,
    /// What a person should know.
    pub warnings: Vec<String>,
}

/// How the target turned over the frames of the model: every frame takes part (a fixed-interval smoother).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SpinReport {
    /// Mean axis, rig frame, of length 1; the target turns about it by the right hand.
    pub axis: [f64; 3],
    /// One standard deviation of its direction, degrees, for one axis across it; how well the sensors' directions are known
    /// is in it.
    pub axis_sigma_deg: f64,
    /// Mean rate, °/s.
    pub rate_dps: f64,
    /// One standard deviation, °/s.
    pub rate_sigma_dps: f64,
    /// How far the axis wandered from its mean, degrees, root mean square: near 0 for a fixed axis.
    pub wander_deg: f64,
    /// How freely the rate was let wander, °/s^1.5: the likeliest of six.
    pub liberty_dps: f64,
    /// How each sensor's cloud is displaced on the target, by sensors' order in the config (cameras first): rotation,
    /// degrees.
    pub displaced_deg: Vec<f64>,
    /// See `displaced_deg`: at the target, mm.
    pub displaced_mm: Vec<f64>,
}

impl SpinReport {
    /// Of a motion; what is displaced is told where the target was on the whole.
    pub fn new(motion: &Smoothed) -> Self {
        let spin = &motion.spin;
        let place = Point3::from(middle(motion.t_rig_target.iter()));
        let displaced = |of: &dyn Fn(&Isometry3<f64>) -> f64| motion.displacements.iter().map(of).collect();
        Self {
            axis: spin.rate_rps.try_normalize(f64::MIN_POSITIVE).unwrap_or_default().into(),
            axis_sigma_deg: spin.sigma_axis_rad.to_degrees(),
            rate_dps: spin.rate_rps.norm().to_degrees(),
            rate_sigma_dps: spin.sigma_rate_rps.to_degrees(),
            wander_deg: spin.wander_rad.to_degrees(),
            liberty_dps: motion.liberty.to_degrees(),
            displaced_deg: displaced(&|motion| motion.rotation.angle().to_degrees()),
            displaced_mm: displaced(&|motion| 1e3 * (motion * place - place).norm()),
        }
    }
}

/// A plane of planes.json; target's frame, metres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlaneLine {
    /// Its number, as in model.ply and contour.json.
    pub plane: u64,
    /// Unit normal, out of the body.
    pub normal: [f64; 3],
    /// n·x of its points.
    pub height_m: f64,
    /// The middle of its points.
    pub centroid_m: [f64; 3],
    /// Two unit directions in it, along which the tilt's σ is told.
    pub tangents: [[f64; 3]; 2],
    /// One standard deviation of the height at the centroid.
    pub height_sigma_m: f64,
    /// Of the slope along each tangent, degrees.
    pub tilt_sigma_deg: [f64; 2],
    /// Root mean square distance of its points before they were laid on it.
    pub rms_m: f64,
    /// What its points cover.
    pub area_m2: f64,
    /// Points.
    pub points: u64,
}

/// What an edge is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum EdgeTag {
    /// Two planes meet.
    Crease,
    /// A plane ends, seen from directions 20° or more apart.
    Boundary,
    /// A plane's points end, from one direction only.
    Occlusion,
}

/// An edge of contour.json; target's frame, metres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EdgeLine {
    /// What it is.
    pub tag: EdgeTag,
    /// Where it begins and ends.
    pub ends_m: [[f64; 3]; 2],
    /// Its planes' numbers.
    pub planes: Vec<u64>,
    /// Of a crease: between the planes' normals, degrees; null otherwise.
    pub angle_deg: Option<f64>,
    /// One standard deviation across it.
    pub sigma_m: f64,
    /// Of its direction, degrees.
    pub direction_sigma_deg: f64,
}

/// planes.json.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "planes.json of tumbled reconstruct")]
pub struct PlanesFile {
    /// The planes, the one with the most points first.
    pub planes: Vec<PlaneLine>,
}

/// contour.json.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "contour.json of tumbled reconstruct")]
pub struct ContourFile {
    /// The edges: creases first, then the longest.
    pub edges: Vec<EdgeLine>,
}

impl PlaneLine {
    /// Of a plane.
    pub fn new(plane: &FoundPlane, number: u64) -> Self {
        Self {
            plane: number,
            normal: plane.normal.into(),
            height_m: plane.height_m,
            centroid_m: plane.centroid.coords.into(),
            tangents: plane.tangents.map(Into::into),
            height_sigma_m: plane.height_sigma_m,
            tilt_sigma_deg: plane.tilt_sigma_rad.map(f64::to_degrees),
            rms_m: plane.rms_m,
            area_m2: plane.area_m2,
            points: plane.members.len() as u64,
        }
    }
}

impl EdgeLine {
    /// Of an edge.
    pub fn new(edge: &Edge) -> Self {
        Self {
            tag: match edge.kind {
                EdgeKind::Crease => EdgeTag::Crease,
                EdgeKind::Boundary => EdgeTag::Boundary,
                EdgeKind::Occlusion => EdgeTag::Occlusion,
            },
            ends_m: edge.ends.map(|end| end.coords.into()),
            planes: edge.planes.iter().map(|plane| u64::from(*plane)).collect(),
            angle_deg: edge.angle_rad.map(f64::to_degrees),
            sigma_m: edge.sigma_m,
            direction_sigma_deg: edge.direction_sigma_rad.to_degrees(),
        }
    }
}

/// Counts and thicknesses of a model; what of the session it does not know is left empty.
pub fn of_model(made: &Made) -> ReconstructReport {
    let frames = |kind| made.frames.iter().filter(|frame| frame.kind == kind).count() as u64;
    let edges = |kind| made.model.edges.iter().filter(|edge| edge.kind == kind).count() as u64;
    let on_planes = made.model.plane_of.iter().flatten().count() as f64;
    ReconstructReport {
        program: String::new(),
        inputs: Vec::new(),
        origin: StreamOrigin::Replay,
        digest: String::new(),
        kinect_frames: frames(SensorKind::Kinect),
        lidar_frames: frames(SensorKind::Lidar),
        points: made.model.points.len() as u64,
        rare: made.fused.rare as u64,
        spacing_m: made.model.spacing_m,
        planes: made.model.planes.len() as u64,
        on_planes: on_planes / made.model.points.len().max(1) as f64,
        creases: edges(EdgeKind::Crease),
        boundaries: edges(EdgeKind::Boundary),
        occlusions: edges(EdgeKind::Occlusion),
        kinect: made.thickness(SensorKind::Kinect),
        lidar: made.thickness(SensorKind::Lidar),
        spin: made.motion.as_ref().map(SpinReport::new),
        files: Vec::new(),
        complete: false,
        warnings: Vec::new(),
    }
}

impl ReconstructReport {
    /// For a terminal.
    pub fn text(&self) -> String {
        let mut text = format!(
            "{} points from {} Kinect frames and {} LiDAR crossings, {:.1} mm apart; {} seen too rarely left out\n\
            {} planes with {:.0} % of the points; {} creases, {} boundaries, {} edges of what hid something\n",
            self.points,
            self.kinect_frames,
            self.lidar_frames,
            1e3 * self.spacing_m,
            self.rare,
            self.planes,
            100.0 * self.on_planes,
            self.creases,
            self.boundaries,
            self.occlusions
        );
        for (name, thickness) in [("Kinect", &self.kinect), ("LiDAR", &self.lidar)] {
            if let Some(Thickness { points, before_mm, after_mm }) = thickness {
                text.push_str(&format!(
                    "thickness of {name} points on planes: {before_mm:.2} mm before, {after_mm:.2} mm after ({points} points)\n"
                ));
            }
        }
        if let Some(spin) = &self.spin {
            let [x, y, z] = spin.axis;
            text.push_str(&format!(
                "turned at {:.4} ± {:.4} °/s about ({x:.4}, {y:.4}, {z:.4}) ± {:.3}°, wandering {:.2}° (all frames at once)\n",
                spin.rate_dps, spin.rate_sigma_dps, spin.axis_sigma_deg, spin.wander_deg
            ));
        }
        text
    }
}

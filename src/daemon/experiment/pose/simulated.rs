//! The experiment on simulated sensors.

use tumbled_io::live::StopToken;
use tumbled_sim::scene::{Scene, SceneMotion, SceneProfile, Transform};

use super::figures::{Known, PoseRow, row};
use super::methods::{PoseMethod, Seat};
use super::rests;
use crate::cli::Failure;
use crate::evaluation::score::Truth;
use crate::experiment::lanes::{self, Lane};
use crate::simulation::rig::View;
use crate::simulation::{scenes, truth};

/// The published sensor sets, by the scenes that have them: a VLP-32C on a rig in a room, an HDL-64E in the simulation.
pub const SETS: [(&str, &str); 2] = [("vlp-32c", "paper-rig"), ("hdl-64e", "paper-simulation")];
/// The axes turned about, rig axes.
pub const AXES: [(&str, [f64; 3]); 3] = [("x", [1.0, 0.0, 0.0]), ("y", [0.0, 1.0, 0.0]), ("z", [0.0, 0.0, 1.0])];
/// Where the target is, m: the second of the published distances.
const PLACE_M: [f64; 3] = [1.9, 0.0, 0.0];
/// What is searched about it, m: the whole target at any attitude, and nothing of the room.
const ROI_RADIUS_M: f64 = 0.9;
/// Rests: the published number of frames.
pub const RESTS: u32 = 16;
/// From rest to rest, degrees.
const STEP_DEG: f64 = 22.5;
/// A rest, s.
const REST_S: f64 = 1.0;
/// Of a move: speeding up and slowing down, s; between it turns at 22.5° / (4.6 s − 0.1 s) = 5 °/s.
const RAMP_S: f64 = 0.1;
/// A move, s.
const MOVE_S: f64 = 4.6;

/// One session: a set, an axis, and a number of rests.
#[derive(Clone, Copy, Debug)]
pub struct Session<'a> {
    /// The set's name and its scene.
    pub set: (&'a str, &'a str),
    /// The axis' name and its direction.
    pub axis: (&'a str, [f64; 3]),
    /// Rests, 2 at least.
    pub rests: u32,
    /// Everything random follows from it.
    pub seed: u64,
}

impl Session<'_> {
    fn scene(&self) -> Result<Scene, Failure> {
        let moves = self.rests - 1;
        scenes::load_changed(self.set.1, |config| {
            config.seed = self.seed;
            config.duration_s = f64::from(self.rests) * REST_S + f64::from(moves) * MOVE_S;
            (config.roi_center_m, config.roi_radius_m) = (PLACE_M, ROI_RADIUS_M);
            let profile = SceneProfile::Steps {
                step_deg: STEP_DEG,
                rest_s: REST_S,
                move_s: MOVE_S,
                ramp_s: RAMP_S,
                count: moves,
            };
            let (axis, mount) = (self.axis.1, Transform::default());
            config.motion = SceneMotion::Turntable { axis, center_m: PLACE_M, mount, profile };
        })
    }

    /// The rows of the methods; `None`: a stop came before the end.
    ///
    /// # Errors
    /// A machine that gives no threads.
    pub fn run(&self, methods: &[PoseMethod], stop: &StopToken) -> Result<Option<Vec<PoseRow>>, Failure> {
        let scene = self.scene()?;
        let t_rig_kinect = scene
            .config
            .kinect
            .first()
            .map(|kinect| scene.operators_mounting(&kinect.id, &kinect.t_rig_kinect).isometry());
        let lane = |method: &PoseMethod| {
            let seat = Seat::new(*method, t_rig_kinect.unwrap_or_default(), self.seed);
            Lane::new(&scene, (View::Operator, method.sensors()), &method.settings(), method.name(), seat)
        };
        let mut lanes = methods.iter().map(lane).collect::<Result<Vec<_>, _>>()?;
        if !lanes::play(&scene, &mut lanes, stop)? {
            return Ok(None);
        }
        let Truth::Poses(trajectory, _) = lanes::truth(&scene)? else {
            return Err(Failure::failed("a scene without poses"));
        };
        let rests = rests::by_rate(truth::samples(&scene).map(|sample| (sample.t, sample.angular_velocity_rps.norm())));
        let attitudes: Vec<_> =
            rests.iter().filter_map(|rest| Some(scene.world.target(rest.until)?.t_rig_body.rotation)).collect();
        let known = Known::Truth(&trajectory, &attitudes);
        let rows = methods
            .iter()
            .zip(&lanes)
            .map(|(method, lane)| row(self.set.0, Some(self.axis.0), *method, (&rests, &lane.listener.poses), known));
        Ok(Some(rows.collect()))
    }
}

//! The methods, and what is listened to of each.

use nalgebra::Isometry3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::TurntableSample;
use tumbled_core::estimate::{Mode, Validity};
use tumbled_model::RigNs;

use super::chain::Chain;
use crate::cli::Failure;
use crate::session::Step;
use crate::session::play::Listener;
use crate::simulation::rig::Sensors;

/// How the target is followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PoseMethod {
    /// This program's, both sensors.
    Fused,
    /// This program's, Kinects alone.
    Kinect,
    /// This program's, LiDARs alone.
    Lidar,
    /// The publication's Algorithm 1 in place of the filter, both sensors.
    PaperFilter,
    /// GICP of each Kinect frame onto the one before, nothing else.
    GicpChain,
}

impl PoseMethod {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Fused, Self::Kinect, Self::Lidar, Self::PaperFilter, Self::GicpChain];

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fused => "fused",
            Self::Kinect => "kinect",
            Self::Lidar => "lidar",
            Self::PaperFilter => "paper-filter",
            Self::GicpChain => "gicp-chain",
        }
    }

    /// The method of a name.
    ///
    /// # Errors
    /// A name that is none, in words.
    pub fn of_name(name: &str) -> Result<Self, String> {
        let names = || Self::ALL.map(Self::name).join(", ");
        Self::ALL.into_iter().find(|method| method.name() == name).ok_or_else(|| format!("expected one of {}", names()))
    }

    /// Whose data it takes.
    pub const fn sensors(self) -> Sensors {
        match self {
            Self::Fused | Self::PaperFilter => Sensors::All,
            Self::Kinect | Self::GicpChain => Sensors::Kinect,
            Self::Lidar => Sensors::Lidar,
        }
    }

    /// What it sets in the config.
    pub fn settings(self) -> Vec<String> {
        if self == Self::PaperFilter { vec!["filter.method=paper".to_owned()] } else { Vec::new() }
    }
}

/// A pose at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Posed {
    /// When.
    pub t: RigNs,
    /// Target to rig.
    pub t_rig_target: Isometry3<f64>,
    /// Rate of its turning, rad/s; of a chain nobody knows it.
    pub rate_rps: Option<f64>,
}

/// Listens to a lane: what it says of the target, state by state.
#[derive(Debug, Default)]
pub struct Seat {
    /// Poses of states of mode `tracking` that are not `invalid`; of a chain those of its frames.
    pub poses: Vec<Posed>,
    /// Where turntables were.
    pub turntable: Vec<TurntableSample>,
    chain: Option<Chain>,
}

impl Seat {
    /// Of a method; a chain goes from frame to frame of a Kinect with this mounting.
    pub fn new(method: PoseMethod, t_rig_kinect: Isometry3<f64>, seed: u64) -> Self {
        let chain = (method == PoseMethod::GicpChain).then(|| Chain::new(t_rig_kinect, seed));
        Self { chain, ..Self::default() }
    }
}

impl Listener for Seat {
    fn step(&mut self, step: &Step<'_>) -> Result<(), Failure> {
        self.turntable.extend(step.outputs.turntable.iter().cloned());
        if let Some(chain) = &mut self.chain {
            self.poses.extend(step.outputs.epochs.iter().filter_map(|epoch| chain.take(epoch)));
            return Ok(());
        }
        for state in &step.outputs.states {
            let is_tracked = state.mode == Mode::Tracking && state.validity != Validity::Invalid;
            let Some(motion) = state.motion.as_ref().filter(|_| is_tracked) else { continue };
            let rate_rps = Some(motion.angular_velocity_rps.norm());
            self.poses.push(Posed { t: state.t, t_rig_target: motion.t_rig_target, rate_rps });
        }
        Ok(())
    }
}

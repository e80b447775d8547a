//! What the estimation has to know of the rig and its sensors.

use super::points::NamedPoint;
use crate::track::Surfels;
use crate::ukf::FilterMethod;
use std::sync::Arc;
use tumbled_model::{SensorId, Span};

/// How the target's motion is estimated.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct EstimateSettings {
    /// What is taken for the target.
    pub search: TargetSearch,
    /// Which filter.
    pub method: FilterMethod,
    /// How the target may turn.
    pub motion: TargetMotionKind,
    /// Mean motion of the orbit that is imitated, rad/s; 0: nothing falls.
    pub mean_motion_rps: f64,
    /// The orbit's point of reference, rig frame, m; `None`: where the target was acquired.
    pub orbit_center_m: Option<[f64; 3]>,
    /// For how long from the first epoch on the room is empty and learned as background; `None`: it is not.
    pub background: Option<Span>,
    /// The target's model of another session, whose frame this session's states are told in; `None`: the target is unknown, and
    /// its frame is fixed when it is acquired.
    pub known: Option<Arc<Surfels>>,
    /// Points of the target whose motion is told.
    pub points: Vec<NamedPoint>,
    /// How well sensors are known; of those that are not here, [`Trust::default`] is believed.
    pub trust: Vec<(SensorId, Trust)>,
}

impl EstimateSettings {
    /// How well a sensor is known.
    pub fn trust(&self, sensor: &SensorId) -> Trust {
        self.trust.iter().find(|(id, _)| id == sensor).map_or_else(Trust::default, |(_, trust)| *trust)
    }
}

/// What is taken for the target.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TargetSearch {
    /// The cluster in the region of interest.
    #[default]
    Region,
    /// The nearest isolated cluster.
    Nearest,
    /// All that is seen.
    Everything,
}

/// How a target may turn.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TargetMotionKind {
    /// Found out while it is tracked: about a fixed axis, until the axis does not stay.
    #[default]
    Auto,
    /// About an axis that stays.
    FixedAxis,
    /// Free, with an unknown inertia.
    Tumble,
}

/// How well a sensor's place, time and scale are known: one standard deviation each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trust {
    /// Of the mounting's rotation, the whole angle, rad.
    pub rotation_rad: f64,
    /// Of its translation, the whole length, m.
    pub translation_m: f64,
    /// Of the time offset, s.
    pub time_s: f64,
    /// Of the depth scale, a share of it; 0 for a LiDAR.
    pub depth_scale: f64,
}

impl Default for Trust {
    /// What an operator reaches with a tape measure and the calibration of this rig (method.md §8.6): 0.2°, 4 mm, 2 ms,
    /// 0.3 %.
    fn default() -> Self {
        Self {
            rotation_rad: 0.2 / 180.0 * core::f64::consts::PI,
            translation_m: 0.004,
            time_s: 0.002,
            depth_scale: 0.003,
        }
    }
}

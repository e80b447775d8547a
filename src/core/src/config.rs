//! What the core has to know of the rig, typed and checked: the shell makes it from the config and its files.

use crate::clock::ClockMode;
use crate::estimate::EstimateSettings;
use nalgebra::Vector3;
use tumbled_kinect::{BackProjector, DepthTable};
use tumbled_model::{Iso, Kinect, Lidar, Point, Rig, SensorId, Span};
use tumbled_velodyne::stream::Settings;

/// A rig as the core sees it. Sensor ids are unique over all sensors.
#[derive(Clone, Debug)]
pub struct CoreConfig {
    /// The LiDARs.
    pub lidars: Vec<LidarSetup>,
    /// The Kinects.
    pub kinects: Vec<KinectSetup>,
    /// The turntables.
    pub turntables: Vec<TurntableSetup>,
    /// The first turntable's axis where it was calibrated: rig axes, any length above 0, the target turns about it
    /// counter-clockwise where the encoder's angle grows. Errors are told against it; nothing is estimated with it.
    pub turntable_axis: Option<Vector3<f64>>,
    /// Where the target is looked for.
    pub roi: RegionOfInterest,
    /// How sensors are put on one timeline.
    pub timing: Timing,
    /// How the target's motion is estimated.
    pub estimate: EstimateSettings,
    /// Whether scans shed by a live session are used all the same: for the best result offline.
    pub ignore_skips: bool,
}

/// One LiDAR.
#[derive(Clone, Debug)]
pub struct LidarSetup {
    /// Its name.
    pub id: SensorId,
    /// How its packets are read.
    pub decoder: Settings,
    /// Mounting.
    pub t_rig_lidar: Iso<Rig, Lidar>,
    /// How late its stamps are: measurement time = mapped stamp − offset.
    pub time_offset: Span,
}

/// One Kinect.
#[derive(Clone, Debug)]
pub struct KinectSetup {
    /// Its name.
    pub id: SensorId,
    /// Its depth law.
    pub table: DepthTable,
    /// Its rays and noise.
    pub projector: BackProjector,
    /// Mounting.
    pub t_rig_kinect: Iso<Rig, Kinect>,
    /// How late its stamps are: measurement time = mapped stamp − offset.
    pub time_offset: Span,
}

/// One turntable.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TurntableSetup {
    /// Its name.
    pub id: SensorId,
    /// What is spoken on its line.
    pub protocol: TurntableProtocol,
    /// The line's rate: how long a reply's first byte was under way.
    pub baud: u32,
    /// Counts of a full turn of the table, where they are not those that the stage says, because of a gear; not 0.
    pub counts_per_turn: Option<u32>,
}

/// What a turntable's line speaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TurntableProtocol {
    /// Zaber ASCII: asked and answered.
    Zaber,
    /// This project's stream of encoder readings.
    Line,
}

/// A sphere in which the target is looked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RegionOfInterest {
    /// Its centre.
    pub center: Point<Rig>,
    /// Its radius, m, above 0.
    pub radius_m: f64,
}

/// How sensors are put on one timeline.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timing {
    /// How device stamps become times.
    pub clock: ClockMode,
    /// How long an epoch waits for an earlier one of another sensor. It goes out when every event of before is surely in:
    /// 0.2 s later, and at the next tick.
    pub hold: Span,
    /// A sensor without data for longer is not waited for. Above 0.5 s: by then its last turn is complete.
    pub silent_after: Span,
}

impl Default for Timing {
    /// The hull clock; 150 ms, above the delay of any sensor here; 2 s.
    fn default() -> Self {
        Self { clock: ClockMode::Hull, hold: Span(150_000_000), silent_after: Span(2_000_000_000) }
    }
}

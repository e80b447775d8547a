//! A measurement epoch: one Kinect frame, or one turn of a LiDAR with its crossing of the region of interest.

use crate::clock::ClockState;
use core::ops::Range;
use tumbled_kinect::FrameLoss;
use tumbled_model::{RigNs, SensorId, Span};

/// What a sensor saw at one time. Each of its points is in this epoch and in no other.
#[derive(Clone, Debug)]
pub struct Epoch {
    /// Counts the session's epochs in their order, from 0.
    pub number: u64,
    /// Whose.
    pub sensor: SensorId,
    /// Its time: the Kinect frame's, or the instant the LiDAR's head passed the middle of the region of interest.
    pub t: RigNs,
    /// The first and the last measurement in it.
    pub span: (RigNs, RigNs),
    /// One standard deviation of `t`, the unknown least delay of the transport excluded.
    pub sigma: Span,
    /// Where `t` comes from.
    pub basis: TimeBasis,
    /// When the host had the last of it.
    pub arrived: RigNs,
    /// The points.
    pub scan: Scan,
    /// The same points in the rig's frame, in the same order.
    pub rig: RigCloud,
}

/// Where an epoch's time comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum TimeBasis {
    /// The sensor's own clock, mapped to the session's timeline.
    Device(ClockState),
    /// The arrival at the host: the sensor gives no stamps.
    Arrival,
}

/// The points of an epoch in the sensor's own frame.
#[derive(Clone, Debug)]
pub enum Scan {
    /// A depth frame.
    Kinect(KinectScan),
    /// A turn of the head.
    Lidar(Box<LidarScan>),
}

impl Scan {
    /// How many points.
    pub fn len(&self) -> usize {
        match self {
            Self::Kinect(scan) => scan.points.len(),
            Self::Lidar(scan) => scan.points.len(),
        }
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// `lidar` or `kinect`.
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::Kinect(_) => "kinect",
            Self::Lidar(_) => "lidar",
        }
    }
}

/// A depth frame's points.
#[derive(Clone, Debug, Default)]
pub struct KinectScan {
    /// The points, in the Kinect's frame.
    pub points: tumbled_kinect::Points,
    /// What of the frame never arrived.
    pub loss: FrameLoss,
}

/// The points of one turn of a LiDAR's head, from the end of one crossing of the region to the end of the next.
#[derive(Clone, Debug, Default)]
pub struct LidarScan {
    /// Emission time of the first firing.
    pub stamp: RigNs,
    /// The points in firing order, in the LiDAR's frame; `dt_ns` counts from `stamp`.
    pub points: tumbled_velodyne::Points,
    /// The points fired while a beam could reach the region of interest.
    pub crossing: Range<usize>,
    /// How much of the region the head was seen to sweep, 0..=1: less where packets are missing or the sensor is blind.
    pub coverage: f64,
    /// Packets that the points are from, shared ones included.
    pub packets: u32,
}

/// Points in the rig's frame, a column per axis, metres.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RigCloud {
    /// x, m.
    pub x: Vec<f32>,
    /// y, m.
    pub y: Vec<f32>,
    /// z, m.
    pub z: Vec<f32>,
    /// Whether the point lies in the region of interest.
    pub in_roi: Vec<bool>,
}

impl RigCloud {
    /// How many points.
    pub fn len(&self) -> usize {
        self.x.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.x.is_empty()
    }

    /// Where a point is, m.
    pub fn place(&self, number: u32) -> Option<[f32; 3]> {
        let number = number as usize;
        Some([*self.x.get(number)?, *self.y.get(number)?, *self.z.get(number)?])
    }

    /// How many points lie in the region of interest.
    pub fn points_in_roi(&self) -> usize {
        self.in_roi.iter().filter(|inside| **inside).count()
    }
}

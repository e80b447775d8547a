//! Inputs to poses: both sensors decoded by the config, and cut where nothing moves.

use tumbled_model::{Body, Event};
use tumbled_velodyne::stream::{Decoded, StreamDecoder};

use super::standstill::{MOST_POSES, Standstill, Still};
use crate::cli::Failure;
use crate::config::{Config, KinectConfig, LidarConfig};
use crate::decoding::kinect::Frame;
use crate::decoding::{Inputs, KinectDecoder, lidar};

/// The LiDAR and the Kinect that are calibrated.
#[derive(Clone, Copy, Debug)]
pub struct Pair<'a> {
    /// The LiDAR.
    pub lidar: &'a LidarConfig,
    /// The Kinect.
    pub kinect: &'a KinectConfig,
}

impl<'a> Pair<'a> {
    /// By their ids; without one, the first.
    ///
    /// # Errors
    /// Exit code 2: the config has no such sensor.
    pub fn of(config: &'a Config, lidar: Option<&str>, kinect: Option<&str>) -> Result<Self, Failure> {
        let missing = |what: &str, id: Option<&str>| {
            let id = id.map(|id| format!(" `{id}`")).unwrap_or_default();
            Failure::input(format!("the config has no {what}{id}")).with_help("`tumbled config show` tells what it has")
        };
        let named = |found: &str, id: Option<&str>| id.is_none_or(|id| id == found);
        Ok(Self {
            lidar: config
                .lidars
                .iter()
                .find(|sensor| named(sensor.id.as_str(), lidar))
                .ok_or_else(|| missing("[[lidar]]", lidar))?,
            kinect: config
                .kinects
                .iter()
                .find(|sensor| named(sensor.id.as_str(), kinect))
                .ok_or_else(|| missing("[[kinect]]", kinect))?,
        })
    }

    /// The config's place of the camera in the LiDAR's frame.
    pub fn t_lidar_kinect(&self) -> nalgebra::Isometry3<f64> {
        self.lidar.t_rig_lidar.isometry.inverse() * self.kinect.t_rig_kinect.isometry
    }
}

/// The poses in which nothing moved, and what a person should know.
#[derive(Debug, Default)]
pub struct Gathered {
    /// In the order of time.
    pub poses: Vec<Still>,
    /// What a person should know.
    pub warnings: Vec<String>,
}

/// Reads inputs to their end.
///
/// # Errors
/// Inputs that cannot be read, or that one of the two sensors is missing from: exit code 2.
pub fn gather(inputs: &mut Inputs, pair: &Pair<'_>) -> Result<Gathered, Failure> {
    let mut decoder = StreamDecoder::new(lidar::settings(pair.lidar)?);
    let mut decoded = Decoded::default();
    let mut kinect = KinectDecoder::new(pair.kinect)?;
    let mut standstill = Standstill::new(&pair.t_lidar_kinect());
    let (mut packets, mut frames, mut damaged) = (0_u64, 0_u64, 0_u64);
    while let Some(Event { arrived, body, .. }) = inputs.next_event()? {
        match &body {
            Body::LidarPacket { sensor, bytes } if *sensor == pair.lidar.id => {
                packets += 1;
                decoder.push(bytes, arrived, &mut decoded);
                standstill.returns(arrived, &decoded.points);
                decoded.clear();
            }
            Body::DepthFrame { sensor, ticks, encoding, lost_packets, bytes } if *sensor == pair.kinect.id => {
                let frame = Frame { ticks: *ticks, encoding: *encoding, lost: lost_packets, bytes };
                match kinect.points(frame) {
                    Ok(points) => {
                        frames += 1;
                        standstill.frame(arrived, points);
                    }
                    Err(_) => damaged += 1,
                }
            }
            _ => {}
        }
    }
    for (what, id, count) in
        [("packets of the LiDAR", &pair.lidar.id, packets), ("frames of the Kinect", &pair.kinect.id, frames)]
    {
        if count == 0 {
            return Err(Failure::input(format!("the inputs hold no {what} `{id}`"))
                .with_help("both sensors are needed at once; `tumbled info INPUT` lists what is in it"));
        }
    }
    let (poses, left_out) = standstill.finish();
    let mut warnings = inputs.warnings();
    if damaged > 0 {
        warnings.push(format!("{damaged} frames of the Kinect could not be decoded"));
    }
    if left_out > 0 {
        warnings.push(format!("{left_out} poses beyond the first {MOST_POSES} are not used"));
    }
    Ok(Gathered { poses, warnings })
}

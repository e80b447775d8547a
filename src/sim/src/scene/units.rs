//! The sensors of a scene: devices, clocks and lines from their keys.

use super::bodies::span;
use super::config::{SceneConfig, SceneKinect, SceneLidar};
use super::error::SceneError;
use crate::clock::SimClock;
use crate::kinect::KinectModel;
use crate::lidar::{Head, LidarConfig, LidarModel, made_calibration_of};
use crate::transport::Transport;
use std::sync::Arc;
use tumbled_kinect::Intrinsics;
use tumbled_model::{SensorId, Span, UnixNs};
use tumbled_velodyne::hdl64::Generation;
use tumbled_velodyne::hdl64::calibration::Calibration;
use tumbled_velodyne::{Model, ReturnMode};

/// A Kinect of a scene.
#[derive(Clone, Debug)]
pub struct KinectUnit {
    /// Its name.
    pub id: SensorId,
    /// The device.
    pub model: KinectModel,
    /// Its clock.
    pub clock: SimClock,
    /// From a frame's middle to the instant it leaves.
    pub latency: Span,
    /// Its way to the host.
    pub line: Transport,
}

impl KinectUnit {
    /// What a frame's mapped stamp is later than its middle: its own latency, and the least delay of its line.
    pub fn late(&self) -> Span {
        self.latency + self.line.least()
    }
}

/// A LiDAR of a scene.
#[derive(Clone, Debug)]
pub struct LidarUnit {
    /// Its name.
    pub id: SensorId,
    /// The device.
    pub model: LidarModel,
    /// An HDL-64E's factory calibration, as Velodyne's `db.xml`; the others have none.
    pub db_xml: Option<Arc<str>>,
    /// Its way to the host.
    pub line: Transport,
}

impl LidarUnit {
    /// What a packet's mapped stamp is later than its first firing: the packet is sent when it is full, and its line has a
    /// least delay.
    pub fn late(&self) -> Span {
        self.model.packet_span() + self.line.least()
    }
}

pub(super) fn lidar_unit(lidar: &SceneLidar, scene: &SceneConfig) -> Result<LidarUnit, SceneError> {
    let failed = |error| SceneError::Lidar { id: lidar.id.clone(), error };
    let word = |key: &str, found: &str, expected| SceneError::Word {
        key: format!("lidar.{}.{key}", lidar.id),
        found: found.to_owned(),
        expected,
    };
    let mode = match lidar.returns.as_str() {
        "strongest" => ReturnMode::Strongest,
        "last" => ReturnMode::Last,
        "dual" => ReturnMode::Dual,
        other => return Err(word("returns", other, "strongest, last, dual")),
    };
    let mut db_xml = None;
    let head = match lidar.model.as_str() {
        "vlp-32c" => Head::BuiltIn(Model::Vlp32c),
        "vlp-16" => Head::BuiltIn(Model::Vlp16),
        "hdl-64e" => {
            let calibration_of = |error| SceneError::Calibration { id: lidar.id.clone(), error };
            let made = made_calibration_of(&lidar.id, scene.seed).map_err(calibration_of)?;
            let text = made.to_db_xml();
            // What the file says is what the head has, to the last bit.
            let calibration = Box::new(Calibration::parse(&text).map_err(calibration_of)?);
            db_xml = Some(Arc::from(text));
            // An S2 has no dual return.
            let generation = if mode == ReturnMode::Dual { Generation::S3 } else { Generation::S2 };
            Head::Hdl64e { generation, calibration }
        }
        other => return Err(word("model", other, "vlp-32c, vlp-16, hdl-64e")),
    };
    let config = LidarConfig {
        id: lidar.id.clone(),
        head,
        mode,
        rpm: lidar.rpm,
        start_azimuth_deg: 0.0,
        view: lidar.view,
        vertical_offsets: None,
        t_rig_lidar: lidar.t_rig_lidar.isometry(),
        clock: lidar.clock.clone(),
        gps: lidar.gps,
        // A hundred a second would be as real and tell nothing more.
        position_every: Span(100_000_000),
        unix_at_zero: UnixNs(scene.unix_ns_at_zero),
        parameters: lidar.parameters,
    };
    let model = LidarModel::new(config).map_err(failed)?;
    Ok(LidarUnit { id: SensorId::from(lidar.id.as_str()), model, db_xml, line: Transport::UDP })
}

pub(super) fn kinect_unit(kinect: &SceneKinect) -> Result<KinectUnit, SceneError> {
    let mounting = kinect.t_rig_kinect.isometry();
    let model = KinectModel::new(&kinect.id, &Intrinsics::default(), mounting, kinect.parameters)
        .map_err(|error| SceneError::Kinect { id: kinect.id.clone(), error })?;
    let id = SensorId::from(kinect.id.as_str());
    let (clock, latency) = (kinect.clock.clone(), span(kinect.latency_s));
    Ok(KinectUnit { id, model, clock, latency, line: Transport::KINECT })
}

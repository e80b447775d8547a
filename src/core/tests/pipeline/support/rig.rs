//! The rig that the sessions are of: a LiDAR `front`, a Kinect `near`, a serial device `table`.

use std::sync::OnceLock;
use tumbled_core::{CoreConfig, KinectSetup, LidarSetup, RegionOfInterest, Timing, TurntableProtocol, TurntableSetup};
use tumbled_kinect::{BackProjector, DepthTable, Intrinsics, NoiseModel, ZeroPlane};
use tumbled_model::{Iso, Point, SensorId, Span};
use tumbled_velodyne::stream::Settings;

pub(crate) const LIDAR: &str = "front";
pub(crate) const KINECT: &str = "near";
pub(crate) const TABLE: &str = "table";

/// A LiDAR alone, its region of interest 2 m ahead: seen from 323.13° to 36.87°, cut at 46.87°.
pub(crate) fn lidar_only() -> CoreConfig {
    CoreConfig {
        lidars: vec![LidarSetup {
            id: SensorId::from(LIDAR),
            decoder: Settings::default(),
            t_rig_lidar: Iso::identity(),
            time_offset: Span(0),
        }],
        kinects: Vec::new(),
        turntables: Vec::new(),
        turntable_axis: None,
        roi: RegionOfInterest { center: Point::new(2.0, 0.0, 0.0), radius_m: 1.2 },
        timing: Timing::default(),
        estimate: Default::default(),
        ignore_skips: false,
    }
}

/// A Kinect alone, looking along the rig's x.
pub(crate) fn kinect_only() -> CoreConfig {
    static PROJECTOR: OnceLock<BackProjector> = OnceLock::new();
    let projector = PROJECTOR.get_or_init(|| {
        BackProjector::new(&Intrinsics::default(), &NoiseModel::default()).expect("the factory's camera")
    });
    CoreConfig {
        lidars: Vec::new(),
        kinects: vec![KinectSetup {
            id: SensorId::from(KINECT),
            table: DepthTable::from_law(&ZeroPlane::default()),
            projector: projector.clone(),
            t_rig_kinect: Iso::from_parts([0.0, 0.3, 0.0], [-0.5, 0.5, -0.5, 0.5]).expect("a rotation"),
            time_offset: Span(0),
        }],
        ..lidar_only()
    }
}

/// A turntable alone, without a line: what it says is there at once.
pub(crate) fn turntable_only() -> CoreConfig {
    let setup = TurntableSetup {
        id: SensorId::from(TABLE),
        protocol: TurntableProtocol::Zaber,
        baud: 0,
        counts_per_turn: None,
    };
    CoreConfig { lidars: Vec::new(), turntables: vec![setup], ..lidar_only() }
}

/// All three.
pub(crate) fn whole() -> CoreConfig {
    CoreConfig { lidars: lidar_only().lidars, turntables: turntable_only().turntables, ..kinect_only() }
}

//! One Kinect's frames to depth and points, with the config's table and intrinsics.

use bytes::Bytes;
use tumbled_kinect::{
    BackProjector, DecodeCounts, DecodeError, DepthImage, DepthTable, Freshness, FrozenDetector, Intrinsics, MmImage,
    NoiseModel, Points, ZeroPlane, decode_metres, decode_mm,
};
use tumbled_model::{DepthEncoding, KinectTicks, PacketMask, SensorId};

use crate::cli::Failure;
use crate::config::KinectConfig;

/// A Kinect's decoder with its buffers.
pub struct KinectDecoder {
    /// Its name.
    pub id: SensorId,
    table: DepthTable,
    projector: BackProjector,
    frozen: FrozenDetector,
    counts: DecodeCounts,
    repeated: u64,
    depth: DepthImage,
    mm: MmImage,
    points: Points,
}

/// The config's depth law, scaled.
///
/// # Errors
/// A table that cannot be used: exit code 2.
pub fn depth_table(kinect: &KinectConfig) -> Result<DepthTable, Failure> {
    Ok(depth_law(kinect)?.scaled(kinect.depth_scale))
}

fn depth_law(kinect: &KinectConfig) -> Result<DepthTable, Failure> {
    let Some(file) = &kinect.depth_table else { return Ok(DepthTable::from_law(&ZeroPlane::default())) };
    let problem = |error: String| Failure::input(format!("the depth table {}: {error}", file.place));
    let text = file.text().map_err(|error| problem(error.to_string()))?;
    text.parse().map_err(|error: tumbled_kinect::TableCsvError| problem(error.to_string()))
}

/// The config's lens.
pub fn intrinsics(kinect: &KinectConfig) -> Intrinsics {
    let i = &kinect.intrinsics;
    Intrinsics { fx: i.fx, fy: i.fy, cx: i.cx, cy: i.cy, k1: i.k1, k2: i.k2, p1: i.p1, p2: i.p2, k3: i.k3 }
}

/// The config's camera: rays, noise and the depth's warp.
///
/// # Errors
/// Intrinsics that describe no camera: exit code 2.
pub fn projector(kinect: &KinectConfig) -> Result<BackProjector, Failure> {
    let projector = BackProjector::new(&intrinsics(kinect), &NoiseModel::default())
        .map_err(|error| Failure::input(format!("kinect {}: intrinsics: {error}", kinect.id)))?;
    Ok(match &kinect.depth_warp {
        Some(warp) => projector.warped(&warp.into()),
        None => projector,
    })
}

/// One frame as the ledger has it.
#[derive(Clone, Copy)]
pub struct Frame<'a> {
    /// The device's stamp.
    pub ticks: Option<KinectTicks>,
    /// How the bytes are to be read.
    pub encoding: DepthEncoding,
    /// What never arrived.
    pub lost: &'a PacketMask,
    /// The payload.
    pub bytes: &'a Bytes,
}

impl KinectDecoder {
    /// A decoder as the config wants it.
    ///
    /// # Errors
    /// A table or intrinsics that cannot be used: exit code 2.
    pub fn new(kinect: &KinectConfig) -> Result<Self, Failure> {
        let (table, projector) = (depth_table(kinect)?, projector(kinect)?);
        Ok(Self {
            id: kinect.id.clone(),
            table,
            projector,
            frozen: FrozenDetector::default(),
            counts: DecodeCounts::default(),
            repeated: 0,
            depth: DepthImage::new(),
            mm: MmImage::new(),
            points: Points::new(),
        })
    }

    /// Depth in metres, 0 = no data.
    ///
    /// # Errors
    /// A frame that is none; counted.
    pub fn metres(&mut self, frame: Frame<'_>) -> Result<&DepthImage, DecodeError> {
        self.watch(frame);
        let outcome = decode_metres(frame.encoding, frame.bytes, frame.lost, &self.table, &mut self.depth);
        self.counts.add(&outcome);
        outcome.map(|_| &self.depth)
    }

    /// Depth in millimetres, 0 = no data.
    ///
    /// # Errors
    /// A frame that is none; counted.
    pub fn millimetres(&mut self, frame: Frame<'_>) -> Result<&MmImage, DecodeError> {
        self.watch(frame);
        let outcome = decode_mm(frame.encoding, frame.bytes, frame.lost, &self.table, &mut self.mm);
        self.counts.add(&outcome);
        outcome.map(|_| &self.mm)
    }

    /// Points in the camera's frame ([`tumbled_model::Kinect`]) with their noise.
    ///
    /// # Errors
    /// A frame that is none; counted.
    pub fn points(&mut self, frame: Frame<'_>) -> Result<&Points, DecodeError> {
        self.metres(frame)?;
        self.projector.points(&self.depth, &mut self.points);
        Ok(&self.points)
    }

    /// What was decoded and what went wrong.
    pub fn counts(&self) -> &DecodeCounts {
        &self.counts
    }

    /// Frames that repeat the one before them: the device was frozen, or the capture holds them twice.
    pub fn repeated(&self) -> u64 {
        self.repeated
    }

    fn watch(&mut self, frame: Frame<'_>) {
        let freshness = self.frozen.observe(frame.ticks, frame.encoding, frame.bytes);
        self.repeated += u64::from(matches!(freshness, Freshness::Repeated { .. } | Freshness::Frozen { .. }));
    }
}

//! Foreign captures as records of raw sensor bytes.
//!
//! | input | recognised by | host stamp |
//! |---|---|---|
//! | `.pcap`, `.pcapng` | magic number | the capture's stamp of each packet |
//! | ROS 2 bag: `.mcap`, `.db3`, or a folder of such parts | magic number; part names | packet stamp inside a `VelodyneScan`; header stamp of an image |
//! | recording of this program, one part or several, or a folder of them | MCAP profile `tumbled` | as recorded |
//! | fakenect folder | `INDEX.txt` in it | seconds in the file name |
//! | folder of depth PNGs | `.png` in it | `times.txt`, else synthetic 30 Hz |
//! | one depth `.png` or `.pgm` | magic number | the name's (fakenect), else synthetic 0 |
//!
//! [`open`] looks at the content, not at the extension. A [`Capture`] yields its records in file order
//! and counts what it left out in a [`CaptureSummary`]; [`merge`] joins several into ledger events.
//! Memory stays bounded whatever the file's size: one record (at most [`MAX_RECORD_BYTES`]) is held at a time.

mod cdr;
mod datagram;
mod depth_png;
mod error;
mod fakenect;
mod files;
mod heartbeat;
mod mcap_records;
mod merge;
mod packets;
mod pcap;
mod pcapng;
mod recording;
mod rosbag;
mod rosbag_db3;
mod rosbag_mcap;
mod routing;
mod seconds;
mod summary;
#[cfg(test)]
mod tests;

pub use cdr::MessageFault;
pub use depth_png::PngForm;
pub use error::{CaptureError, TopicFound};
pub use heartbeat::{Heartbeat, LONGEST_SILENCE, TICK};
pub use merge::{Merged, merge};
pub use routing::{KinectRoute, LidarRoute, Routing};
pub use summary::{
    BrokenOff, CaptureKind, CaptureSummary, DamagedFile, Hint, Place, PortTraffic, SensorTraffic, StampOrigin,
    TopicTraffic,
};

pub(crate) use mcap_records::{ChunkHead, Fields, record_head};
pub(crate) use packets::ReadUpTo;

use crate::recording::{Reader, RecordingHeader};
use core::fmt;
use files::Sniffed;
use std::path::{Path, PathBuf};
use tumbled_model::{Body, RigNs, UnixNs};

/// The largest single record (packet, message, block) that is read; a claim beyond it is damage.
///
/// A Kinect image message is 0.6 MB and a Velodyne scan 0.3 MB; pcap tools stop at 0.25 MB.
pub const MAX_RECORD_BYTES: usize = 64 << 20;

/// One thing a capture holds: raw bytes, or what is known to be missing, and when the host had it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CaptureRecord {
    /// When the capturing host first had it; what it is worth says [`CaptureSummary::stamp_origin`]. Never negative.
    pub host: UnixNs,
    /// The bytes or the gap.
    pub body: Body,
    /// Where it stood in the ledger, when the capture is a recording of one.
    pub ledger: Option<LedgerPlace>,
}

/// A place in a recorded ledger.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LedgerPlace {
    /// Its number.
    pub seq: u64,
    /// When it arrived, on the recorded session's timeline.
    pub arrived: RigNs,
}

impl CaptureRecord {
    /// A record of a foreign capture.
    pub(crate) fn foreign(host: UnixNs, body: Body) -> Self {
        Self { host, body, ledger: None }
    }
}

/// What reads one kind of capture.
pub(crate) trait RecordSource: Send {
    /// The next record in file order, `None` at the end; what is left out is counted in `summary`.
    fn next_record(&mut self, summary: &mut CaptureSummary) -> Option<Result<CaptureRecord, CaptureError>>;

    /// The earliest host stamp of all records, when opening already told: `Some(None)` = no records.
    fn known_earliest(&self) -> Option<Option<UnixNs>>;

    /// What a recording says of itself; foreign captures have none.
    fn recording(&self) -> Option<&RecordingHeader> {
        None
    }
}

/// An open capture: an iterator over its records in file order.
///
/// After the first `Err` it is at its end.
pub struct Capture {
    path: PathBuf,
    /// Of a recording; else empty.
    parts: Vec<PathBuf>,
    routing: Routing,
    source: Box<dyn RecordSource>,
    summary: CaptureSummary,
    finished: bool,
}

/// Opens a capture of any supported kind.
///
/// The kind is sniffed from the content. Records carry the sensor ids of `routing`.
///
/// # Errors
/// When the path cannot be read, when it is none of the kinds (the message says what it looks like and what to
/// do), or when its head already shows that nothing in it can be used.
pub fn open(path: &Path, routing: &Routing) -> Result<Capture, CaptureError> {
    let (kind, source, stamp_origin): (_, Box<dyn RecordSource>, _) = match files::sniff(path)? {
        Sniffed::Recording { parts } => return open_recording(path, parts, routing),
        Sniffed::Pcap => {
            (CaptureKind::Pcap, Box::new(packets::PacketSource::pcap(path, routing)?), StampOrigin::Capture)
        }
        Sniffed::PcapNg => {
            (CaptureKind::PcapNg, Box::new(packets::PacketSource::pcapng(path, routing)?), StampOrigin::Capture)
        }
        Sniffed::Bag { parts } => {
            (CaptureKind::Rosbag, Box::new(rosbag::BagSource::open(path, parts, routing)?), StampOrigin::Message)
        }
        Sniffed::FakenectFolder => {
            (CaptureKind::Fakenect, Box::new(fakenect::FakenectSource::folder(path, routing)?), StampOrigin::Capture)
        }
        Sniffed::PngFolder { frames } => {
            let source = depth_png::PngSource::folder(path, frames, routing)?;
            let origin = source.stamp_origin();
            (CaptureKind::DepthPngs, Box::new(source), origin)
        }
        Sniffed::Png => {
            let source = depth_png::PngSource::single(path, routing)?;
            (CaptureKind::DepthPngs, Box::new(source), StampOrigin::Synthetic)
        }
        Sniffed::Pgm => {
            let source = fakenect::FakenectSource::single(path, routing)?;
            let origin = source.stamp_origin();
            (CaptureKind::Fakenect, Box::new(source), origin)
        }
    };
    let summary = CaptureSummary::new(kind, stamp_origin);
    let (path, routing) = (path.to_owned(), routing.clone());
    Ok(Capture { path, parts: Vec::new(), routing, source, summary, finished: false })
}

fn open_recording(path: &Path, parts: Vec<PathBuf>, routing: &Routing) -> Result<Capture, CaptureError> {
    let source = recording::RecordingSource::open(&parts)?;
    let summary = CaptureSummary::new(CaptureKind::Recording, source.stamp_origin());
    let (path, routing) = (path.to_owned(), routing.clone());
    Ok(Capture { path, parts, routing, source: Box::new(source), summary, finished: false })
}

/// Opens several captures; parts of one recording are put together, whatever their order, as one capture that stands
/// where the first of them was given.
///
/// # Errors
/// As [`open`], and when a part is given twice.
pub fn open_all<P: AsRef<Path>>(paths: &[P], routing: &Routing) -> Result<Vec<Capture>, CaptureError> {
    let mut captures: Vec<Capture> = Vec::new();
    for path in paths {
        let capture = open(path.as_ref(), routing)?;
        let session = capture.session();
        let same = captures.iter_mut().find(|other| session.is_some() && other.session() == session);
        match same {
            Some(other) => {
                let parts = [other.parts.as_slice(), &capture.parts].concat();
                *other = open_recording(&other.path, parts, routing)?;
            }
            None => captures.push(capture),
        }
    }
    Ok(captures)
}

/// What the recording says of itself when the paths are one recording and nothing else: one part, several parts, a folder
/// of them. `None` otherwise, and when a path cannot be read: whoever opens it tells why.
pub fn lone_recording<P: AsRef<Path>>(paths: &[P]) -> Option<RecordingHeader> {
    let mut parts = Vec::new();
    for path in paths {
        match files::sniff(path.as_ref()) {
            Ok(Sniffed::Recording { parts: more }) => parts.extend(more),
            _ => return None,
        }
    }
    // Parts of several recordings are not of one session, and refused.
    Reader::open(&parts).ok().map(|reader| reader.header().clone())
}

impl Capture {
    /// The path it was opened with.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What was counted so far; complete once the iterator has ended.
    pub fn summary(&self) -> &CaptureSummary {
        &self.summary
    }

    /// What the recording says of itself; `None` for foreign captures.
    pub fn recording(&self) -> Option<&RecordingHeader> {
        self.source.recording()
    }

    fn session(&self) -> Option<&str> {
        self.recording().map(|header| header.session.as_str())
    }

    /// The earliest host stamp of all records, `None` when there are none.
    ///
    /// Bags and folders know it from opening; a pcap or a recording is read once more from its start, because its
    /// records need not be in order of time. An error met on that way is left for the iteration itself to report.
    ///
    /// # Errors
    /// When the file cannot be opened again.
    pub fn earliest_host(&self) -> Result<Option<UnixNs>, CaptureError> {
        if let Some(known) = self.source.known_earliest() {
            return Ok(known);
        }
        let again = match self.parts.as_slice() {
            [] => open(&self.path, &self.routing)?,
            parts => open_recording(&self.path, parts.to_vec(), &self.routing)?,
        };
        Ok(again.map_while(Result::ok).map(|record| record.host).min())
    }
}

impl fmt::Debug for Capture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Capture").field("path", &self.path).field("summary", &self.summary).finish_non_exhaustive()
    }
}

impl Iterator for Capture {
    type Item = Result<CaptureRecord, CaptureError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.finished {
            return None;
        }
        let next = self.source.next_record(&mut self.summary);
        match &next {
            Some(Ok(record)) => self.summary.count_record(record),
            Some(Err(_)) | None => self.finished = true,
        }
        next
    }
}

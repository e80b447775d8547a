//! fakenect dump folders, and single files of them.
//!
//! `INDEX.txt` lists one file a line, `TYPE-SECONDS-TICKS.ext`: TYPE `d` depth, `r` colour, `a` accelerometer;
//! SECONDS the host's time, decimal; TICKS the device's stamp. A depth file is one line of header, not looked at,
//! and the payload as the USB library gave it: 614 400 bytes of little-endian 11-bit disparities, or 422 400
//! bytes of the packed stream. Blank lines of the index are passed over.

use super::files::{excerpt, io_error, open_regular, read_lines};
use super::packets::{ReadUpTo, gap};
use super::seconds::parse_seconds;
use super::summary::{CaptureSummary, StampOrigin};
use super::{CaptureError, CaptureRecord, RecordSource, Routing};
use bytes::Bytes;
use std::path::{Path, PathBuf};
use tumbled_model::{Body, DepthEncoding, KinectTicks, PacketMask, SensorId, UnixNs};

/// 640 × 480 × 2 bytes.
const UNPACKED_BYTES: usize = 614_400;
/// 640 × 480 × 11 / 8 bytes.
const PACKED_BYTES: usize = 422_400;
/// The header line is 17 bytes in every dump seen; a comment may make it longer.
const HEADER_LIMIT: usize = 1024;

/// A line of the index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct EntryName {
    is_depth: bool,
    host: UnixNs,
    ticks: KinectTicks,
}

impl EntryName {
    /// `None` when it is not of the form TYPE-SECONDS-TICKS.ext or leads out of the folder.
    fn parse(name: &str) -> Option<Self> {
        if name.contains(['/', '\\']) {
            return None;
        }
        let mut parts = name.splitn(3, '-');
        let is_depth = match parts.next()? {
            "d" => true,
            "r" | "a" => false,
            _ => return None,
        };
        let host = parse_seconds(parts.next()?)?;
        let (ticks, _extension) = parts.next()?.split_once('.')?;
        let digits_only = ticks.bytes().all(|byte| byte.is_ascii_digit());
        let ticks = KinectTicks(ticks.parse().ok().filter(|_| digits_only)?);
        Some(Self { is_depth, host, ticks })
    }
}

/// A depth frame still on disk.
#[derive(Debug)]
struct Frame {
    path: PathBuf,
    host: UnixNs,
    ticks: Option<KinectTicks>,
}

/// Depth frames of a dump.
pub(crate) struct FakenectSource {
    sensor: SensorId,
    frames: std::vec::IntoIter<Frame>,
    earliest: Option<UnixNs>,
    ignored_files: u64,
    stamp_origin: StampOrigin,
}

impl FakenectSource {
    /// Reads the index; the frames are read as they are asked for.
    pub(crate) fn folder(path: &Path, routing: &Routing) -> Result<Self, CaptureError> {
        let index = path.join("INDEX.txt");
        let mut frames = Vec::new();
        let mut ignored_files = 0;
        for (line, name) in read_lines(&index)? {
            let Some(entry) = EntryName::parse(&name) else {
                return Err(CaptureError::IndexLine { path: index, line, found: excerpt(&name) });
            };
            if entry.is_depth {
                frames.push(Frame { path: path.join(name), host: entry.host, ticks: Some(entry.ticks) });
            } else {
                ignored_files += 1;
            }
        }
        Self::new(path, routing, frames, ignored_files, StampOrigin::Capture)
    }

    /// One depth file. Its name gives time and ticks if it is a dump's, else the time is a synthetic 0.
    pub(crate) fn single(path: &Path, routing: &Routing) -> Result<Self, CaptureError> {
        if let Ok((DepthEncoding::Raw11, payload)) = read_frame(path)?
            && is_big_endian(&payload)
        {
            return Err(CaptureError::BigEndianPgm { path: path.to_owned() });
        }
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let (frame, origin) = match EntryName::parse(&name).filter(|entry| entry.is_depth) {
            Some(entry) => {
                (Frame { path: path.to_owned(), host: entry.host, ticks: Some(entry.ticks) }, StampOrigin::Capture)
            }
            None => (Frame { path: path.to_owned(), host: UnixNs(0), ticks: None }, StampOrigin::Synthetic),
        };
        Self::new(path, routing, vec![frame], 0, origin)
    }

    fn new(
        path: &Path,
        routing: &Routing,
        frames: Vec<Frame>,
        ignored_files: u64,
        stamp_origin: StampOrigin,
    ) -> Result<Self, CaptureError> {
        let Some(sensor) = routing.kinect_of(path) else {
            return Err(CaptureError::NoKinect { path: path.to_owned() });
        };
        let earliest = frames.iter().map(|frame| frame.host).min();
        Ok(Self { sensor: sensor.clone(), frames: frames.into_iter(), earliest, ignored_files, stamp_origin })
    }

    pub(crate) fn stamp_origin(&self) -> StampOrigin {
        self.stamp_origin
    }
}

impl RecordSource for FakenectSource {
    fn next_record(&mut self, summary: &mut CaptureSummary) -> Option<Result<CaptureRecord, CaptureError>> {
        summary.ignored_files += std::mem::take(&mut self.ignored_files);
        let frame = self.frames.next()?;
        let read = match read_frame(&frame.path) {
            Ok(read) => read,
            // A dump copied in part: the frame is lost, the others are not.
            Err(error) => Err(error.to_string()),
        };
        let body = match read {
            Ok((encoding, bytes)) => Body::DepthFrame {
                sensor: self.sensor.clone(),
                ticks: frame.ticks,
                encoding,
                lost_packets: PacketMask::NONE,
                bytes,
            },
            Err(detail) => {
                summary.count_damaged(&frame.path, detail);
                gap(&self.sensor, 1)
            }
        };
        Some(Ok(CaptureRecord::foreign(frame.host, body)))
    }

    fn known_earliest(&self) -> Option<Option<UnixNs>> {
        Some(self.earliest)
    }
}

/// A frame's payload and how it is laid out; the inner error says why the file holds no whole frame.
fn read_frame(path: &Path) -> Result<Result<(DepthEncoding, Bytes), String>, CaptureError> {
    let mut file = Vec::new();
    open_regular(path)?.read_up_to(HEADER_LIMIT + UNPACKED_BYTES + 1, &mut file).map_err(io_error(path))?;
    Ok(split_frame(file))
}

fn split_frame(file: Vec<u8>) -> Result<(DepthEncoding, Bytes), String> {
    let Some(header) = file.iter().take(HEADER_LIMIT).position(|&byte| byte == b'\n') else {
        return Err(format!("no header line within its first {HEADER_LIMIT} bytes"));
    };
    let payload = Bytes::from(file).slice(header + 1..);
    match payload.len() {
        UNPACKED_BYTES => Ok((DepthEncoding::Raw11, payload)),
        PACKED_BYTES => Ok((DepthEncoding::Packed11, payload)),
        length => {
            Err(format!("{length} bytes after the header line, expected {UNPACKED_BYTES} (or {PACKED_BYTES} packed)"))
        }
    }
}

/// Whether 16-bit samples are 11-bit numbers only when read high byte first.
fn is_big_endian(payload: &[u8]) -> bool {
    let eleven_bit = |high: &u8| *high < 8;
    let high_bytes_if_little = payload.iter().skip(1).step_by(2);
    let high_bytes_if_big = payload.iter().step_by(2);
    !high_bytes_if_little.clone().all(eleven_bit) && high_bytes_if_big.clone().all(eleven_bit)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn names_are_type_seconds_ticks() {
        let depth =
            EntryName { is_depth: true, host: UnixNs(1_332_333_250_000_000), ticks: KinectTicks(4_294_967_295) };
        assert_eq!(EntryName::parse("d-1332333.250000-4294967295.pgm"), Some(depth));
        assert!(EntryName::parse("r-1.000000-5.ppm").is_some_and(|entry| !entry.is_depth));
        for name in ["", "d", "d-1-2", "d-1-4294967296.pgm", "d-x-2.pgm", "x-1-2.pgm", "d-1-+2.pgm", "d-1-2./../x"] {
            assert_eq!(EntryName::parse(name), None, "{name}");
        }
    }

    #[test]
    fn payload_starts_after_the_first_line_feed_even_if_line_feeds_follow() {
        let mut file = b"P5 640 480 65535\n".to_vec();
        file.extend(std::iter::repeat_n(b'\n', UNPACKED_BYTES));
        let (encoding, payload) = split_frame(file.clone()).unwrap();
        assert_eq!((encoding, payload.len()), (DepthEncoding::Raw11, UNPACKED_BYTES));
        file.truncate(17 + PACKED_BYTES);
        assert_eq!(split_frame(file.clone()).unwrap().0, DepthEncoding::Packed11);
        file.pop();
        assert!(split_frame(file).unwrap_err().starts_with("422399 bytes"));
    }

    #[test]
    fn byte_order_shows_in_the_high_bits() {
        assert!(is_big_endian(&[0x03, 0xff, 0x07, 0xff]));
        assert!(!is_big_endian(&[0xff, 0x03, 0xff, 0x07]));
        assert!(!is_big_endian(&[0x01, 0x02]), "either way an 11-bit number: taken as the dump writes it");
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn any_name_is_parsed_or_refused(name in "[dra]?-?[0-9.]{0,12}-?[0-9]{0,11}\\PC{0,6}") {
            if EntryName::parse(&name).is_some() {
                prop_assert!(!name.contains('/'));
            }
        }

        #[test]
        fn any_file_is_a_frame_of_exact_length_or_refused(file in prop::collection::vec(any::<u8>(), 0..2000)) {
            prop_assert!(split_frame(file).is_err(), "2000 bytes hold no frame");
        }
    }
}

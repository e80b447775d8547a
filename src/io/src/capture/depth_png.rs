//! 16-bit depth PNGs: a folder in name order, or one.
//!
//! Runs of digits in names count as numbers, so `frame_2` is before `frame_10`. Values are millimetres; a file with
//! `raw11` in its name holds raw 11-bit disparities. Times come from `times.txt` in the folder, one decimal number of
//! seconds a line for the frames in the same order; without it frame k is at k × 33 333 333 ns after 1970-01-01,
//! and the summary says that this is synthetic. Files that are not named `.png` are ignored.

use super::files::{PNG_MAGIC, excerpt, open_buffered, read_head, read_lines};
use super::packets::gap;
use super::seconds::parse_seconds;
use super::summary::{CaptureSummary, StampOrigin};
use super::{CaptureError, CaptureRecord, RecordSource, Routing};
use bytes::Bytes;
use core::fmt;
use std::path::{Path, PathBuf};
use tumbled_model::{Body, DepthEncoding, PacketMask, SensorId, UnixNs};

/// 640 × 480 × 2 bytes.
const FRAME_BYTES: usize = 614_400;

/// A thirtieth of a second, the Kinect's nominal frame period.
const FRAME_PERIOD_NS: i64 = 33_333_333;

/// The decoder's own memory; a 640-pixel wide image needs a few rows.
const DECODER_BYTES: usize = 16 << 20;

/// The form of a PNG, from its header.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PngForm {
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
    /// Bits per sample: 1, 2, 4, 8 or 16.
    pub bits: u8,
    /// PNG colour type: 0 grey, 2 RGB, 3 palette, 4 grey and alpha, 6 RGB and alpha.
    pub colour_type: u8,
}

impl PngForm {
    const DEPTH: Self = Self { width: 640, height: 480, bits: 16, colour_type: 0 };

    /// Reads signature (8 bytes), IHDR length and name (8), width, height, bits, colour type.
    fn from_head(head: &[u8]) -> Option<Self> {
        let &[
            g0,
            g1,
            g2,
            g3,
            g4,
            g5,
            g6,
            g7,
            0,
            0,
            0,
            13,
            b'I',
            b'H',
            b'D',
            b'R',
            w0,
            w1,
            w2,
            w3,
            h0,
            h1,
            h2,
            h3,
            bits,
            colour_type,
        ] = head.first_chunk::<26>()?
        else {
            return None;
        };
        let width = u32::from_be_bytes([w0, w1, w2, w3]);
        let height = u32::from_be_bytes([h0, h1, h2, h3]);
        ([g0, g1, g2, g3, g4, g5, g6, g7] == PNG_MAGIC).then_some(Self { width, height, bits, colour_type })
    }
}

impl fmt::Display for PngForm {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let colour = match self.colour_type {
            0 => "greyscale",
            2 => "RGB",
            3 => "palette colour",
            4 => "greyscale with alpha",
            6 => "RGB with alpha",
            _ => "of unknown colour type",
        };
        write!(f, "{}x{}, {}-bit {colour}", self.width, self.height, self.bits)
    }
}

/// Depth frames of PNG files.
pub(crate) struct PngSource {
    sensor: SensorId,
    frames: std::iter::Zip<std::vec::IntoIter<PathBuf>, std::vec::IntoIter<UnixNs>>,
    earliest: Option<UnixNs>,
    stamp_origin: StampOrigin,
}

impl PngSource {
    /// Checks every file's form at once: better now than after half of the frames.
    pub(crate) fn folder(path: &Path, frames: Vec<PathBuf>, routing: &Routing) -> Result<Self, CaptureError> {
        let times_path = path.join("times.txt");
        let (times, origin) = match times_path.try_exists() {
            Ok(true) => (read_times(&times_path, frames.len())?, StampOrigin::TimesFile),
            Ok(false) => {
                let times = (0..).map(|k| UnixNs(k * FRAME_PERIOD_NS)).take(frames.len()).collect();
                (times, StampOrigin::Synthetic)
            }
            Err(source) => return Err(CaptureError::Io { path: times_path, source }),
        };
        Self::new(path, routing, frames, times, origin)
    }

    /// One frame, at a synthetic 0.
    pub(crate) fn single(path: &Path, routing: &Routing) -> Result<Self, CaptureError> {
        Self::new(path, routing, vec![path.to_owned()], vec![UnixNs(0)], StampOrigin::Synthetic)
    }

    fn new(
        path: &Path,
        routing: &Routing,
        frames: Vec<PathBuf>,
        times: Vec<UnixNs>,
        stamp_origin: StampOrigin,
    ) -> Result<Self, CaptureError> {
        let Some(sensor) = routing.kinect_of(path) else {
            return Err(CaptureError::NoKinect { path: path.to_owned() });
        };
        for frame in &frames {
            match PngForm::from_head(&read_head(frame, 26)?) {
                Some(PngForm::DEPTH) => {}
                Some(found) => return Err(CaptureError::NotDepthPng { path: frame.clone(), found }),
                None => return Err(CaptureError::NotPng { path: frame.clone() }),
            }
        }
        let earliest = times.iter().copied().min();
        Ok(Self { sensor: sensor.clone(), frames: frames.into_iter().zip(times), earliest, stamp_origin })
    }

    pub(crate) fn stamp_origin(&self) -> StampOrigin {
        self.stamp_origin
    }
}

fn read_times(path: &Path, frames: usize) -> Result<Vec<UnixNs>, CaptureError> {
    let mut times = Vec::new();
    for (line, text) in read_lines(path)? {
        let Some(time) = parse_seconds(&text) else {
            return Err(CaptureError::TimesLine { path: path.to_owned(), line, found: excerpt(&text) });
        };
        times.push(time);
    }
    if times.len() != frames {
        return Err(CaptureError::TimesCount { path: path.to_owned(), times: times.len(), frames });
    }
    Ok(times)
}

impl RecordSource for PngSource {
    fn next_record(&mut self, summary: &mut CaptureSummary) -> Option<Result<CaptureRecord, CaptureError>> {
        let (path, host) = self.frames.next()?;
        let raw = path.file_name().is_some_and(|name| name.to_string_lossy().contains("raw11"));
        let encoding = if raw { DepthEncoding::Raw11 } else { DepthEncoding::Mm16 };
        let body = match decode(&path) {
            Ok(bytes) => Body::DepthFrame {
                sensor: self.sensor.clone(),
                ticks: None,
                encoding,
                lost_packets: PacketMask::NONE,
                bytes,
            },
            Err(detail) => {
                summary.count_damaged(&path, detail);
                gap(&self.sensor, 1)
            }
        };
        Some(Ok(CaptureRecord::foreign(host, body)))
    }

    fn known_earliest(&self) -> Option<Option<UnixNs>> {
        Some(self.earliest)
    }
}

/// The samples, little-endian; or why the file has none, header or not.
fn decode(path: &Path) -> Result<Bytes, String> {
    let file = open_buffered(path).map_err(|error| error.to_string())?;
    decode_from(file)
}

fn decode_from(file: impl std::io::BufRead + std::io::Seek) -> Result<Bytes, String> {
    let mut decoder = png::Decoder::new_with_limits(file, png::Limits { bytes: DECODER_BYTES });
    decoder.set_transformations(png::Transformations::IDENTITY);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let mut reader = decoder.read_info().map_err(|error| error.to_string())?;
    let info = reader.info();
    let form = PngForm {
        width: info.width,
        height: info.height,
        bits: info.bit_depth as u8,
        colour_type: info.color_type as u8,
    };
    if form != PngForm::DEPTH || reader.output_buffer_size() != Some(FRAME_BYTES) {
        return Err(format!("{form}, but was {} when the folder was opened", PngForm::DEPTH));
    }
    let mut samples = vec![0; FRAME_BYTES];
    reader.next_frame(&mut samples).map_err(|error| error.to_string())?;
    // PNG is big-endian, a ledger's frames are little-endian.
    for sample in samples.chunks_exact_mut(2) {
        sample.reverse();
    }
    Ok(Bytes::from(samples))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::sync::LazyLock;

    /// A PNG whose pixels count up from `first`, modulo 65 536.
    pub(in super::super) fn ramp(
        width: u32,
        height: u32,
        depth: png::BitDepth,
        colour: png::ColorType,
        first: u16,
    ) -> Vec<u8> {
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, width, height);
        encoder.set_depth(depth);
        encoder.set_color(colour);
        let samples = width as usize * height as usize * colour.samples();
        let pixels: Vec<u8> = if depth == png::BitDepth::Sixteen {
            (0..samples).flat_map(|k| first.wrapping_add(k as u16).to_be_bytes()).collect()
        } else {
            vec![0; samples]
        };
        encoder.write_header().unwrap().write_image_data(&pixels).unwrap();
        file
    }

    #[test]
    fn samples_come_out_little_endian() {
        let file = ramp(640, 480, png::BitDepth::Sixteen, png::ColorType::Grayscale, 1000);
        let bytes = decode_from(std::io::Cursor::new(&file)).unwrap();
        assert_eq!(bytes.len(), FRAME_BYTES);
        for (k, sample) in bytes.chunks_exact(2).enumerate() {
            assert_eq!(u16::from_le_bytes([sample[0], sample[1]]), 1000u16.wrapping_add(k as u16));
        }
    }

    #[test]
    fn forms_are_read_from_the_header() {
        let file = ramp(2, 3, png::BitDepth::Eight, png::ColorType::Rgba, 0);
        let form = PngForm::from_head(&file).unwrap();
        assert_eq!(form.to_string(), "2x3, 8-bit RGB with alpha");
        assert_eq!(PngForm::from_head(&file[..25]), None);
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn flipped_and_cut_pngs_give_a_whole_frame_or_a_reason(
            flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..4),
            cut in any::<prop::sample::Index>(),
        ) {
            static WHOLE: LazyLock<Vec<u8>> =
                LazyLock::new(|| ramp(640, 480, png::BitDepth::Sixteen, png::ColorType::Grayscale, 0));
            let mut file = WHOLE.clone();
            for (at, value) in flips {
                let at = at.index(file.len());
                file[at] ^= value;
            }
            if cut.index(4) > 0 {
                file.truncate(cut.index(file.len()));
            }
            if let Ok(bytes) = decode_from(std::io::Cursor::new(&file)) {
                prop_assert_eq!(bytes.len(), FRAME_BYTES);
            }
        }

        #[test]
        fn any_bytes_have_a_form_or_none(head in prop::collection::vec(any::<u8>(), 0..40)) {
            prop_assert_eq!(PngForm::from_head(&head), None, "40 random bytes do not begin with PNG's eight");
        }
    }
}

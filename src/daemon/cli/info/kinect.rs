//! One Kinect's frames, watched from the first to the last.

use std::collections::BTreeMap;

use tumbled_kinect::PIXELS;
use tumbled_model::{KinectTicks, RigNs};

use super::histogram::Histogram;
use super::report::kinect::{Encoding, EncodingCount, KinectReport, ValidShare};
use super::report::{RateClock, Refusal};
use crate::cli::Failure;
use crate::config::KinectConfig;
use crate::decoding::KinectDecoder;
use crate::decoding::kinect::Frame;

/// Depths are counted in millimetres.
const BINS_PER_M: f32 = 1_000.0;

/// From one frame to the next at the device's 30 Hz, ns.
const FRAME_NS: i64 = 33_333_333;

/// The device's counter begins again after 2³² ticks of 50/3 ns.
const WRAP_NS: i64 = (1 << 32) * 50 / 3;

/// Follows one Kinect through the inputs.
pub(super) struct KinectWatch {
    decoder: KinectDecoder,
    encodings: BTreeMap<Encoding, u64>,
    first_ticks: Option<KinectTicks>,
    last: Option<(Option<KinectTicks>, RigNs)>,
    device: Steps,
    host: Steps,
    missing: u64,
    depths: Histogram,
    valid_pixels: u64,
    fewest_valid: Option<u64>,
}

/// Steps from frame to frame and the time they took together.
#[derive(Default)]
struct Steps {
    count: u64,
    span_ns: i64,
}

impl Steps {
    /// A step that takes no time is a frame that came twice, and none.
    fn add(&mut self, span_ns: i64) {
        if span_ns > 0 {
            self.count += 1;
            self.span_ns += span_ns;
        }
    }

    fn hz(&self) -> Option<f64> {
        (self.count > 0).then(|| self.count as f64 * 1e9 / self.span_ns as f64)
    }
}

impl KinectWatch {
    /// Nothing seen yet.
    pub(super) fn new(kinect: &KinectConfig) -> Result<Self, Failure> {
        Ok(Self {
            decoder: KinectDecoder::new(kinect)?,
            encodings: BTreeMap::new(),
            first_ticks: None,
            last: None,
            device: Steps::default(),
            host: Steps::default(),
            missing: 0,
            depths: Histogram::new(BINS_PER_M),
            valid_pixels: 0,
            fewest_valid: None,
        })
    }

    /// Its id.
    pub(super) fn id(&self) -> &tumbled_model::SensorId {
        &self.decoder.id
    }

    /// Whether the inputs held anything for it.
    pub(super) fn seen(&self) -> bool {
        self.last.is_some()
    }

    /// Takes one frame.
    pub(super) fn frame(&mut self, frame: Frame<'_>, arrived: RigNs) {
        *self.encodings.entry(frame.encoding.into()).or_default() += 1;
        self.time(frame.ticks, arrived);
        // A frame that cannot be decoded is counted by the decoder.
        let Ok(depth) = self.decoder.metres(frame) else { return };
        let mut valid = 0;
        for metres in depth.pixels().iter().filter(|metres| **metres > 0.0) {
            self.depths.add(*metres);
            valid += 1;
        }
        self.valid_pixels += valid;
        self.fewest_valid = Some(self.fewest_valid.map_or(valid, |fewest| fewest.min(valid)));
    }

    /// The report; `host_times` says whether the inputs have times of their own.
    pub(super) fn report(&self, host_times: bool) -> KinectReport {
        let counts = self.decoder.counts();
        let host = self.host.hz().filter(|_| host_times).map(|hz| (hz, RateClock::Host));
        let rate = self.device.hz().map(|hz| (hz, RateClock::Device)).or(host);
        let all_pixels = (counts.frames * PIXELS as u64) as f64;
        let share = |fewest: u64| ValidShare {
            mean: self.valid_pixels as f64 / all_pixels,
            min: fewest as f64 / PIXELS as f64,
        };
        let mut warnings = Vec::new();
        if self.decoder.repeated() > 0 {
            warnings.push(
                "frames repeat the one before them: the device was frozen, or they were recorded twice".to_owned(),
            );
        }
        KinectReport {
            id: self.decoder.id.to_string(),
            frames: self.encodings.values().sum(),
            encodings: self.encodings.iter().map(|(e, n)| EncodingCount { encoding: *e, frames: *n }).collect(),
            rate_hz: rate.map(|(hz, _)| hz),
            rate_clock: rate.map(|(_, clock)| clock),
            first_ticks: self.first_ticks.map(|ticks| ticks.0),
            last_ticks: self.last.and_then(|(ticks, _)| ticks).map(|ticks| ticks.0),
            frames_missing: (self.device.count > 0).then_some(self.missing),
            frames_with_usb_loss: counts.frames_with_loss,
            usb_packets_lost: counts.lost_packets,
            pixels_lost: counts.lost_pixels,
            refused: refusals(counts),
            repeated: self.decoder.repeated(),
            valid_share: self.fewest_valid.map(share),
            depth_m: self.depths.spread(),
            warnings,
        }
    }

    fn time(&mut self, ticks: Option<KinectTicks>, arrived: RigNs) {
        self.first_ticks = self.first_ticks.or(ticks);
        let Some((ticks_before, arrived_before)) = self.last.replace((ticks, arrived)) else { return };
        let by_arrival = (arrived - arrived_before).0;
        self.host.add(by_arrival);
        if let (Some(before), Some(now)) = (ticks_before, ticks) {
            let short = now.since(before).0;
            // Whole rounds of the counter in a long gap, told by the host's clock.
            let rounds = (by_arrival - short).saturating_add(WRAP_NS / 2).div_euclid(WRAP_NS);
            let span_ns = short + rounds.max(0) * WRAP_NS;
            self.device.add(span_ns);
            self.missing += ((span_ns + FRAME_NS / 2) / FRAME_NS - 1).max(0) as u64;
        }
    }
}

fn refusals(counts: &tumbled_kinect::DecodeCounts) -> Vec<Refusal> {
    let kinds = [
        (counts.wrong_length_packed11, "not the length of a packed 11-bit frame (422400 bytes)"),
        (counts.wrong_length_raw11, "not the length of an unpacked 11-bit frame (614400 bytes)"),
        (counts.wrong_length_mm16, "not the length of a frame in millimetres (614400 bytes)"),
        (counts.not_raw, "millimetres where raw disparities were asked for"),
    ];
    let seen = kinds.iter().filter(|(count, _)| *count > 0);
    seen.map(|(count, reason)| Refusal { reason: (*reason).to_owned(), count: *count }).collect()
}

//! A device that sends one frame for ever.
//!
//! After a USB fault a Kinect, or the stack above it, may deliver the same frame again and again. It looks like a target
//! that stands still, so it has to be told apart from one. Two signs are certain:
//!
//! * **The same bytes.** The noise of a real scene is about half a disparity step, so codes flicker, standing target or
//!   not. A frame has some ten thousand patches of independent noise (a correlation window each): even if each of them
//!   repeated itself nine times out of ten, all would in one frame of 10⁴⁵⁷. The exception is a frame without any data (a
//!   covered lens, a sensor turned to the sky): those are all alike, and are not held against the device.
//! * **The clock stands.** Each frame has a stamp of the device's own; one that does not rise is no new frame.

use crate::frame::{RawDisparity, frame_bytes, is_depth_mm};
use crate::packed;
use bytes::Bytes;
use tumbled_model::{DepthEncoding, KinectTicks, Span};

/// What a frame repeats.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RepeatCause {
    /// Every byte of the frame before, with data in it.
    SameBytes,
    /// The frame before's device stamp, or an earlier one.
    TicksNotRising,
}

/// What a frame says about the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Freshness {
    /// A new frame, or the first.
    Fresh,
    /// No data at all, as the frame before: nothing can be said.
    Blank,
    /// It repeats the frame before; so did `run` frames on end, this one included, fewer than the limit.
    Repeated {
        /// Repetitions on end.
        run: u32,
        /// By what sign.
        cause: RepeatCause,
    },
    /// As many repetitions as the limit or more: the device is frozen. Close and open it.
    Frozen {
        /// Repetitions on end.
        run: u32,
        /// By what sign.
        cause: RepeatCause,
    },
}

/// Watches one device's frames for repetition. Fed with every frame in order; no clock of its own.
///
/// It keeps the last frame's buffer (shared, not copied) to compare with.
#[derive(Clone, Debug)]
pub struct FrozenDetector {
    limit: u32,
    run: u32,
    before: Option<(Option<KinectTicks>, Bytes)>,
}

impl Default for FrozenDetector {
    /// Three repetitions: a tenth of a second at 30 Hz. One alone can be a host that delivered a buffer twice.
    fn default() -> Self {
        Self::new(3)
    }
}

impl FrozenDetector {
    /// A watch that calls a device frozen after `limit` repetitions on end (0 counts as 1).
    pub fn new(limit: u32) -> Self {
        Self { limit: limit.max(1), run: 0, before: None }
    }

    /// Takes the next frame. Frames without a device stamp are judged by their bytes alone.
    pub fn observe(&mut self, ticks: Option<KinectTicks>, encoding: DepthEncoding, bytes: &Bytes) -> Freshness {
        let Some((ticks_before, bytes_before)) = self.before.replace((ticks, bytes.clone())) else {
            return Freshness::Fresh;
        };
        let stands = matches!((ticks_before, ticks), (Some(before), Some(now)) if now.since(before) <= Span(0));
        let same = bytes_before == *bytes; // ends at the first difference: a fresh frame costs next to nothing
        let cause = if stands {
            RepeatCause::TicksNotRising
        } else if same && !is_blank(encoding, bytes) {
            RepeatCause::SameBytes
        } else {
            self.run = 0;
            return if same { Freshness::Blank } else { Freshness::Fresh };
        };
        self.run = self.run.saturating_add(1);
        let run = self.run;
        if run >= self.limit { Freshness::Frozen { run, cause } } else { Freshness::Repeated { run, cause } }
    }

    /// The device was opened again: its counter may start anywhere, so an earlier stamp says nothing. Its image is remembered:
    /// one that was frozen before and sends the same frame once more is frozen still.
    pub fn reopened(&mut self) {
        if let Some((ticks, _)) = &mut self.before {
            *ticks = None;
        }
    }
}

/// Whether no pixel of the frame has a depth. A frame of a wrong length counts as one that has: it is not looked into.
fn is_blank(encoding: DepthEncoding, bytes: &[u8]) -> bool {
    if bytes.len() != frame_bytes(encoding) {
        return false;
    }
    let mut words = bytes.as_chunks::<2>().0.iter().map(|word| u16::from_le_bytes(*word));
    match encoding {
        DepthEncoding::Packed11 => !packed::codes(bytes).any(RawDisparity::is_depth),
        DepthEncoding::Raw11 => !words.any(|code| RawDisparity(code).is_depth()),
        DepthEncoding::Mm16 => !words.any(is_depth_mm),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::{encode_mm, encode_raw};
    use crate::image::{MmImage, RawImage};

    const PACKED: DepthEncoding = DepthEncoding::Packed11;
    const FRAME: u32 = 2_000_000;

    fn frame(code: u16) -> Bytes {
        encode_raw(&RawImage::filled(RawDisparity(code)), PACKED).expect("eleven bits").into()
    }

    /// What the n-th frame (stamps a frame apart, from just before the counter's wrap) is called.
    fn observe_all(frames: &[Bytes]) -> Vec<Freshness> {
        let mut detector = FrozenDetector::new(3);
        let stamp = |n: usize| Some(KinectTicks(u32::MAX.wrapping_add(n as u32 * FRAME)));
        frames.iter().enumerate().map(|(n, bytes)| detector.observe(stamp(n), PACKED, bytes)).collect()
    }

    #[test]
    fn frames_that_differ_in_one_bit_are_fresh_across_the_counters_wrap() {
        let mut other = frame(700).to_vec();
        other[422_399] ^= 1;
        let (one, other) = (frame(700), Bytes::from(other));
        assert_eq!(observe_all(&[one.clone(), other.clone(), one, other]), [Freshness::Fresh; 4]);
    }

    #[test]
    fn the_same_frame_is_repeated_then_frozen_then_fresh_again() {
        let (one, other) = (frame(700), frame(701));
        let cause = RepeatCause::SameBytes;
        let expected = [
            Freshness::Fresh,
            Freshness::Repeated { run: 1, cause },
            Freshness::Repeated { run: 2, cause },
            Freshness::Frozen { run: 3, cause },
            Freshness::Frozen { run: 4, cause },
            Freshness::Fresh,
            Freshness::Fresh,
            Freshness::Repeated { run: 1, cause },
        ];
        let frames = [&one, &one, &one, &one, &one, &other, &one, &one].map(Bytes::clone);
        assert_eq!(observe_all(&frames), expected);
    }

    #[test]
    fn a_covered_lens_is_not_a_frozen_device() {
        let blank = frame(2_047);
        let expected = [Freshness::Fresh, Freshness::Blank, Freshness::Blank, Freshness::Blank, Freshness::Blank];
        assert_eq!(observe_all(&[&blank; 5].map(Bytes::clone)), expected);
        let raw = encode_raw(&RawImage::new(), DepthEncoding::Raw11).expect("eleven bits");
        assert!(is_blank(DepthEncoding::Raw11, &raw) && is_blank(DepthEncoding::Mm16, &encode_mm(&MmImage::new())));
        assert!(!is_blank(DepthEncoding::Mm16, &encode_mm(&MmImage::filled(1))));
    }

    #[test]
    fn a_clock_that_stands_or_falls_is_a_repetition_whatever_the_bytes() {
        let mut detector = FrozenDetector::new(2);
        let cause = RepeatCause::TicksNotRising;
        assert_eq!(detector.observe(Some(KinectTicks(9)), PACKED, &frame(1)), Freshness::Fresh);
        assert_eq!(detector.observe(Some(KinectTicks(9)), PACKED, &frame(2)), Freshness::Repeated { run: 1, cause });
        assert_eq!(detector.observe(Some(KinectTicks(8)), PACKED, &frame(3)), Freshness::Frozen { run: 2, cause });
        assert_eq!(detector.observe(Some(KinectTicks(10)), PACKED, &frame(4)), Freshness::Fresh);
    }

    #[test]
    fn a_device_opened_again_may_begin_with_any_stamp() {
        let mut detector = FrozenDetector::default();
        detector.observe(Some(KinectTicks(5_000_000)), PACKED, &frame(1));
        detector.reopened();
        assert_eq!(detector.observe(Some(KinectTicks(0)), PACKED, &frame(2)), Freshness::Fresh);
    }

    #[test]
    fn a_frozen_device_that_was_opened_again_and_sends_the_same_is_frozen_still() {
        let mut detector = FrozenDetector::new(2);
        for n in 1..4 {
            detector.observe(Some(KinectTicks(n * FRAME)), PACKED, &frame(1));
        }
        detector.reopened();
        let cause = RepeatCause::SameBytes;
        assert_eq!(detector.observe(Some(KinectTicks(1)), PACKED, &frame(1)), Freshness::Frozen { run: 3, cause });
    }

    #[test]
    fn captures_without_stamps_are_judged_by_their_bytes() {
        let mut detector = FrozenDetector::new(1);
        assert_eq!(detector.observe(None, PACKED, &frame(1)), Freshness::Fresh);
        assert_eq!(detector.observe(None, PACKED, &frame(2)), Freshness::Fresh);
        let frozen = Freshness::Frozen { run: 1, cause: RepeatCause::SameBytes };
        assert_eq!(detector.observe(None, PACKED, &frame(2)), frozen);
    }
}

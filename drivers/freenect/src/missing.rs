//! Frames that the device stamped and that never arrived.
//!
//! Each frame's stamp is a thirtieth of a second after the one before. What the library gives up it does not tell, but the
//! stamps of the next frame do.

use tumbled_model::{KinectTicks, Span};

/// Ticks of a frame: 60 MHz / 30 Hz.
const FRAME_TICKS: i64 = 2_000_000;
/// A longer silence ends the stream, so a longer step is no loss but another clock.
const LONGEST: Span = Span(5_000_000_000);

/// Counts missing frames by the stamps of those that came.
#[derive(Debug, Default)]
pub(crate) struct MissingFrames {
    before: Option<KinectTicks>,
}

impl MissingFrames {
    /// Frames missing between the previous one and this one. A stamp that falls, or jumps by more than 5 s, counts as none.
    pub(crate) fn before(&mut self, ticks: KinectTicks) -> u32 {
        let Some(before) = self.before.replace(ticks) else { return 0 };
        let step = ticks.since(before);
        if step <= Span(0) || step > LONGEST {
            return 0;
        }
        let steps = (i64::from(ticks.0.wrapping_sub(before.0)) + FRAME_TICKS / 2) / FRAME_TICKS;
        u32::try_from(steps - 1).unwrap_or(0)
    }

    /// Forgets the stamps so far: the stream was started anew.
    pub(crate) fn restart(&mut self) {
        self.before = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_of_n_frames_lacks_n_minus_one() {
        let mut missing = MissingFrames::default();
        // Across the counter's wrap, with 5 % of unevenness: 1, 2, 10 frames on.
        let start = u32::MAX - 1_000_000;
        let steps = [0, 2_000_000, 4_000_000 + 100_000, 20_000_000 - 100_000];
        let mut ticks = start;
        let told: Vec<u32> = steps
            .iter()
            .map(|step| {
                ticks = ticks.wrapping_add(*step);
                missing.before(KinectTicks(ticks))
            })
            .collect();
        assert_eq!(told, [0, 0, 1, 9]);
    }

    #[test]
    fn a_clock_that_falls_stands_or_leaps_tells_of_no_loss() {
        let mut missing = MissingFrames::default();
        for ticks in [5_000_000, 1_000_000, 1_000_000, 1_000_000 + 301_000_000] {
            assert_eq!(missing.before(KinectTicks(ticks)), 0);
        }
        missing.restart();
        assert_eq!(missing.before(KinectTicks(400_000_000)), 0);
    }
}

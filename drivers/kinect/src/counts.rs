//! How many frames were decoded, and what went wrong how often.

use crate::depth::{DecodeError, FrameLoss};
use tumbled_model::DepthEncoding;

/// Counts by kind. The caller keeps them and adds each frame's outcome: decoding itself has no state.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DecodeCounts {
    /// Frames decoded, with or without loss.
    pub frames: u64,
    /// Of these, frames that had lost packets.
    pub frames_with_loss: u64,
    /// USB packets lost in them.
    pub lost_packets: u64,
    /// Pixels that became no data for it.
    pub lost_pixels: u64,
    /// Frames refused: not the length of a packed 11-bit frame.
    pub wrong_length_packed11: u64,
    /// Frames refused: not the length of an unpacked 11-bit frame.
    pub wrong_length_raw11: u64,
    /// Frames refused: not the length of a frame in millimetres.
    pub wrong_length_mm16: u64,
    /// Frames in millimetres that were asked for raw disparities.
    pub not_raw: u64,
}

impl DecodeCounts {
    /// Adds one frame's outcome.
    pub fn add(&mut self, outcome: &Result<FrameLoss, DecodeError>) {
        let count = match outcome {
            Ok(loss) => {
                self.frames_with_loss += u64::from(loss.packets > 0);
                self.lost_packets += u64::from(loss.packets);
                self.lost_pixels += u64::from(loss.pixels);
                &mut self.frames
            }
            Err(DecodeError::WrongLength { encoding: DepthEncoding::Packed11, .. }) => &mut self.wrong_length_packed11,
            Err(DecodeError::WrongLength { encoding: DepthEncoding::Raw11, .. }) => &mut self.wrong_length_raw11,
            Err(DecodeError::WrongLength { encoding: DepthEncoding::Mm16, .. }) => &mut self.wrong_length_mm16,
            Err(DecodeError::NotRaw) => &mut self.not_raw,
        };
        *count += 1;
    }

    /// Frames refused for whatever reason.
    pub fn refused(&self) -> u64 {
        self.wrong_length_packed11 + self.wrong_length_raw11 + self.wrong_length_mm16 + self.not_raw
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_outcome_is_counted_under_its_own_kind() {
        let mut counts = DecodeCounts::default();
        let wrong = |encoding| Err(DecodeError::WrongLength { encoding, found: 1, expected: 2 });
        counts.add(&Ok(FrameLoss::default()));
        counts.add(&Ok(FrameLoss { packets: 2, pixels: 2_543 }));
        counts.add(&wrong(DepthEncoding::Packed11));
        counts.add(&wrong(DepthEncoding::Raw11));
        counts.add(&wrong(DepthEncoding::Raw11));
        counts.add(&wrong(DepthEncoding::Mm16));
        counts.add(&Err(DecodeError::NotRaw));
        let expected = DecodeCounts {
            frames: 2,
            frames_with_loss: 1,
            lost_packets: 2,
            lost_pixels: 2_543,
            wrong_length_packed11: 1,
            wrong_length_raw11: 2,
            wrong_length_mm16: 1,
            not_raw: 1,
        };
        assert_eq!(counts, expected);
        assert_eq!(counts.refused(), 5);
    }
}

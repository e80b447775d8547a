//! `--frames A..B`.

use std::str::FromStr;

/// A range of frame numbers, half open: `2..5` is 2, 3, 4; `3..` from 3 on; `..3` the first three; `7` the one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FrameRange {
    start: u64,
    end: u64,
}

/// A text that is no range.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected A..B with whole numbers, A below B, as in 0..10 (the first ten), 3.. or ..3")]
pub struct FrameRangeError;

impl FrameRange {
    /// Whether frame `n` is wanted.
    pub fn contains(&self, n: u64) -> bool {
        (self.start..self.end).contains(&n)
    }

    /// Whether every frame is wanted.
    pub fn is_all(&self) -> bool {
        (self.start, self.end) == (0, u64::MAX)
    }

    /// Whether all frames from `n` on are unwanted.
    pub fn is_behind(&self, n: u64) -> bool {
        n >= self.end
    }
}

impl FromStr for FrameRange {
    type Err = FrameRangeError;

    fn from_str(text: &str) -> Result<Self, FrameRangeError> {
        let number = |text: &str, empty: u64| match text {
            "" => Ok(empty),
            digits => digits.parse().map_err(|_error| FrameRangeError),
        };
        let range = match text.split_once("..") {
            Some((start, end)) => Self { start: number(start, 0)?, end: number(end, u64::MAX)? },
            None => {
                let only: u64 = text.parse().map_err(|_error| FrameRangeError)?;
                Self { start: only, end: only.saturating_add(1) }
            }
        };
        if range.start < range.end { Ok(range) } else { Err(FrameRangeError) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_half_open() {
        let frames =
            |text: &str| text.parse::<FrameRange>().map(|r| (0..9).filter(|n| r.contains(*n)).collect::<Vec<_>>());
        assert_eq!(frames("2..5"), Ok(vec![2, 3, 4]));
        assert_eq!(frames("7.."), Ok(vec![7, 8]));
        assert_eq!(frames("..2"), Ok(vec![0, 1]));
        assert_eq!(frames(".."), Ok((0..9).collect()));
        assert_eq!(frames("4"), Ok(vec![4]));
        for wrong in ["", "a..b", "5..5", "5..2", "-1..2", "1...2"] {
            assert_eq!(frames(wrong), Err(FrameRangeError), "{wrong}");
        }
    }
}

//! From the block azimuths of one packet to how far the head turns during each block.
//!
//! The encoder is read once a block and quantised to 0.01°; between two readings the head turns evenly (M16,
//! M32 9.5). Two things break that rule: the wrap at 360°, and the jump of a sensor with a limited field of view,
//! which goes silent inside a packet and goes on half a turn later.

use crate::wire::{BLOCKS, TURN_CDEG};

const TURN: i32 = TURN_CDEG as i32;

/// A step backwards of up to 0.5° is encoder jitter of a slow or standing motor, not almost a whole turn.
const JITTER_CDEG: i32 = 50;

/// A jump is at least this wide. Below it lies encoder jitter, ±0.02° a block, which a slow or standing motor's small
/// median would take for a jump; above it the narrowest silent sector that a sensor can be set to, 1°.
const MIN_JUMP_CDEG: i32 = 50;

/// The forward step from one azimuth to the next, 0.01°, −50..36000−50.
pub fn forward_cdeg(from: u16, to: u16) -> i32 {
    let step = (i32::from(to) - i32::from(from)).rem_euclid(TURN);
    if step >= TURN - JITTER_CDEG { step - TURN } else { step }
}

/// Where a packet's azimuth jumps: once, unless the field of view is so narrow that a packet spans several turns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Jumps {
    /// By firing group (block, or in dual mode pair of blocks): how far the azimuth jumps behind it, 0.01°; 0 = not.
    width_cdeg: [u16; BLOCKS],
}

impl Jumps {
    /// How many, 0 for almost every packet.
    pub fn count(&self) -> usize {
        self.width_cdeg.iter().filter(|width| **width > 0).count()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.count() == 0
    }

    /// The first: the group before it and its width, 0.01°.
    pub fn first(&self) -> Option<(usize, u16)> {
        self.width_cdeg.iter().copied().enumerate().find(|(_, width)| *width > 0)
    }

    /// The last, likewise.
    pub fn last(&self) -> Option<(usize, u16)> {
        self.width_cdeg.iter().copied().enumerate().rfind(|(_, width)| *width > 0)
    }

    /// All widths together, 0.01°.
    pub fn total_cdeg(&self) -> u32 {
        self.width_cdeg.iter().map(|width| u32::from(*width)).sum()
    }

    /// How much of the packet's silence lies before a group, ns: shared out by the jumps' widths.
    pub fn pause_before_ns(&self, group: usize, pause_ns: i64) -> i64 {
        let before: u32 = self.width_cdeg.iter().take(group).map(|width| u32::from(*width)).sum();
        match self.total_cdeg() {
            0 => 0,
            total if before == total => pause_ns,
            total => (i128::from(pause_ns) * i128::from(before) / i128::from(total)) as i64,
        }
    }
}

/// How far the head turns from each firing group of a packet to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turning {
    /// Azimuth of each group, 0.01°. Only the first `groups` count.
    pub base_cdeg: [u16; BLOCKS],
    /// Turn from each group to the next, 0.01°, jumps and the open end filled in.
    pub gap_cdeg: [i32; BLOCKS],
    /// 12 for single return, 6 for dual.
    pub groups: usize,
    /// Median step, 0.01°: the head's speed in this packet.
    pub median_cdeg: i32,
    /// The jumps of a limited field of view.
    pub jumps: Jumps,
}

impl Turning {
    /// Measures the turning in a packet whose consecutive firing groups are `blocks_per_group` blocks.
    ///
    /// The last group has no successor in the packet: it takes the previous gap (M16, M32 9.5). A gap wider
    /// than 1.5 × the median is a jump and takes the median.
    pub fn measure(azimuth_cdeg: &[u16; BLOCKS], blocks_per_group: usize) -> Self {
        let mut base_cdeg = [0; BLOCKS];
        let mut groups = 0;
        for (base, azimuth) in base_cdeg.iter_mut().zip(azimuth_cdeg.iter().step_by(blocks_per_group.max(1))) {
            *base = *azimuth;
            groups += 1;
        }
        let mut gap_cdeg = [0; BLOCKS];
        let steps = groups - 1;
        for (gap, pair) in gap_cdeg.iter_mut().zip(base_cdeg.windows(2)).take(steps) {
            if let [from, to] = *pair {
                *gap = forward_cdeg(from, to);
            }
        }
        let median_cdeg = median(gap_cdeg, steps);
        let jump_above = (median_cdeg + median_cdeg / 2).max(MIN_JUMP_CDEG); // 1.5 × an odd median: rounding down loses no integer gap
        let mut jumps = Jumps::default();
        let mut previous = median_cdeg;
        let places = gap_cdeg.iter_mut().zip(&mut jumps.width_cdeg);
        for (group, (gap, jump)) in places.take(groups).enumerate() {
            if group == steps {
                *gap = previous;
            } else if *gap > jump_above {
                *jump = *gap as u16;
                *gap = median_cdeg;
            }
            previous = *gap;
        }
        Self { base_cdeg, gap_cdeg, groups, median_cdeg, jumps }
    }

    /// Azimuth of the first group, 0.01°.
    pub fn first_cdeg(&self) -> u16 {
        self.base_cdeg.first().copied().unwrap_or(0)
    }

    /// Azimuth of the last group, 0.01°.
    pub fn last_cdeg(&self) -> u16 {
        self.base_cdeg.get(self.groups - 1).copied().unwrap_or(0)
    }
}

/// Lower median of the first `n` values (n ≥ 1).
fn median(mut values: [i32; BLOCKS], n: usize) -> i32 {
    let (head, _) = values.split_at_mut(n.clamp(1, BLOCKS));
    head.sort_unstable();
    head.get((head.len() - 1) / 2).copied().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn ramp(start: u16, step: u16) -> [u16; BLOCKS] {
        core::array::from_fn(|b| ((u32::from(start) + b as u32 * u32::from(step)) % 36_000) as u16)
    }

    #[test]
    fn a_steady_head_turns_evenly_and_the_last_block_repeats_the_step() {
        let t = Turning::measure(&ramp(100, 20), 1);
        assert_eq!((t.gap_cdeg, t.jumps.count()), ([20; BLOCKS], 0));
    }

    #[test]
    fn a_jump_takes_the_median_and_is_reported_with_its_width() {
        // A real case: 90.95° to 270.12° between two blocks is 179.17° forward.
        let mut azimuth = ramp(9_015, 20);
        azimuth[4] = 9_095;
        for (k, a) in azimuth[5..].iter_mut().enumerate() {
            *a = 27_012 + 20 * k as u16;
        }
        let t = Turning::measure(&azimuth, 1);
        assert_eq!((t.jumps.count(), t.jumps.first()), (1, Some((4, 17_917))));
        assert_eq!(t.gap_cdeg, [20; BLOCKS]);
    }

    #[test]
    fn a_jump_before_the_last_block_does_not_leak_into_it() {
        let mut azimuth = ramp(9_015, 20);
        azimuth[11] = 27_012;
        let t = Turning::measure(&azimuth, 1);
        assert_eq!(t.jumps.first().map(|(group, _)| group), Some(10));
        assert_eq!(t.gap_cdeg[10..], [20, 20]);
    }

    #[test]
    fn a_view_narrower_than_a_packet_jumps_more_than_once() {
        // Five blocks a turn: 1.00° to 1.80°, then 358.8° to 1.00° + a little.
        let azimuth = core::array::from_fn(|b| [100, 120, 140, 160, 180][b % 5] + b as u16 / 5);
        let t = Turning::measure(&azimuth, 1);
        assert_eq!((t.jumps.count(), t.jumps.first()), (2, Some((4, 35_921))));
        // Two jumps of one width: half of the silence before block 5, all of it before block 10.
        assert_eq!([4, 5, 9, 10].map(|group| t.jumps.pause_before_ns(group, 200)), [0, 100, 100, 200]);
        assert_eq!(t.gap_cdeg, [20; BLOCKS]);
    }

    #[test]
    fn dual_return_measures_pairs() {
        // VLP-16 dual: pairs share an azimuth, 40 per pair.
        let azimuth = core::array::from_fn(|b| 66 + 40 * (b as u16 / 2));
        let t = Turning::measure(&azimuth, 2);
        assert_eq!((t.groups, &t.gap_cdeg[..6]), (6, &[40; 6][..]));
        assert_eq!(t.last_cdeg(), 266);
    }

    #[test]
    fn a_standing_motor_is_neither_a_jump_nor_a_turn() {
        let azimuth = [100, 101, 100, 99, 100, 100, 101, 100, 100, 99, 100, 100];
        let t = Turning::measure(&azimuth, 1);
        assert_eq!((t.jumps.count(), t.median_cdeg), (0, 0));
        assert_eq!(t.gap_cdeg[1], -1);
    }

    proptest! {
        /// 300 to 1200 rpm are 9.95 to 79.6 cdeg a block; wherever the wrap lies, no jump is seen and no gap is lost.
        #[test]
        fn the_wrap_is_invisible(start in 0u16..36_000, step in 9u16..80, jitter in prop::array::uniform12(0u16..3)) {
            let azimuth: [u16; BLOCKS] = core::array::from_fn(|b| (ramp(start, step)[b] + jitter[b]) % 36_000);
            let t = Turning::measure(&azimuth, 1);
            prop_assert!(t.jumps.is_empty());
            for gap in t.gap_cdeg {
                prop_assert!((gap - i32::from(step)).abs() <= 2);
            }
        }

        #[test]
        fn any_azimuths_give_gaps_within_a_turn(azimuth in prop::array::uniform12(0u16..36_000), dual in any::<bool>()) {
            let t = Turning::measure(&azimuth, if dual { 2 } else { 1 });
            prop_assert!(t.gap_cdeg.iter().all(|gap| gap.abs() < 36_000));
        }
    }
}

//! The three generations of HDL-64E and when their lasers fire.
//!
//! | | blocks of a packet | clock | 64 lasers | packet, single / dual |
//! |---|---|---|---|---|
//! | S1 | lower, upper, upper, upper, three times; an azimuth each | none | 128 µs (lower), 43 µs (upper) | 384 µs / – |
//! | S2 | upper, lower, six times; an azimuth per pair | µs past the hour | 48 µs | 288 µs / 144 µs |
//! | S3 | as S2; dual: upper, lower, upper, lower of one firing | µs past the hour | 57.6 µs | 345.6 µs / 172.8 µs |
//!
//! **S2, S3**: "Laser firing time table" of the later S2 and of the S3 manual: groups of four, both banks together.
//!
//! **S1** has no table and no clock; times are counted back from the packet's end (its arrival). Blocks fire every
//! 32 µs: a real capture at 590 rpm has 384.02 µs per packet of twelve over 152 packets, and its block azimuths step by
//! 0.09° or 0.18° such that any run of n steps holds one of two neighbouring numbers of long ones (n from 3 to 96).
//! That is the mark of a constant rate read through an encoder of 4 000 counts, not of blocks that take turns at being
//! long. Within a block the lasers are taken to be evenly spread.

use crate::wire::{BLOCKS, Bank, SLOTS};

/// Which HDL-64E.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Generation {
    /// 2007; text for status.
    S1,
    /// 2010; six firings of 64 per packet in 288 µs.
    S2,
    /// 2013; slower firing, dual return, warnings.
    S3,
}

/// Nanoseconds between the blocks of an S1.
const S1_BLOCK_NS: i32 = 32_000;
/// S1: nanoseconds between neighbouring lasers of a block.
const S1_LASER_NS: i32 = S1_BLOCK_NS / SLOTS as i32;
/// S2: from one firing of all 64 to the next, from four lasers to the next four, within the four. Nanoseconds.
const S2: (i32, i32, [i32; 4]) = (48_000, 6_000, [0, 1_260, 2_460, 3_660]);
/// S3: the same.
const S3: (i32, i32, [i32; 4]) = (57_600, 7_200, [0, 1_300, 2_500, 3_700]);

impl Generation {
    /// The three.
    pub const ALL: [Self; 3] = [Self::S1, Self::S2, Self::S3];

    /// From the first laser of a block (S2, S3: of all 64) to the first of the next, ns.
    pub const fn cycle_ns(self) -> i32 {
        match self {
            Self::S1 => S1_BLOCK_NS,
            Self::S2 => S2.0,
            Self::S3 => S3.0,
        }
    }

    /// Firings in a packet: S1 one per block, else one per pair of blocks, per four in dual return.
    pub const fn cycles_per_packet(self, dual: bool) -> u8 {
        match (self, dual) {
            (Self::S1, _) => 12,
            (_, false) => 6,
            (_, true) => 3,
        }
    }

    /// From one packet to the next, ns.
    pub const fn period_ns(self, dual: bool) -> i32 {
        self.cycle_ns() * self.cycles_per_packet(dual) as i32
    }

    /// Which firing a block belongs to.
    pub const fn cycle(self, dual: bool, block: u8) -> u8 {
        match (self, dual) {
            (Self::S1, _) => block,
            (_, false) => block / 2,
            (_, true) => block / 4,
        }
    }

    /// When the 32 lasers of a block fire after the block's (S2, S3: the firing's) first, ns, by slot.
    pub fn lasers_ns(self) -> [i32; SLOTS] {
        let mut at = [0; SLOTS];
        for (slot, at) in (0i32..).zip(at.iter_mut()) {
            let of_four = |(_, four, within): (i32, i32, [i32; 4])| {
                let [a, b, c, d] = within;
                slot / 4 * four
                    + match slot % 4 {
                        0 => a,
                        1 => b,
                        2 => c,
                        _ => d,
                    }
            };
            *at = match self {
                Self::S1 => slot * S1_LASER_NS,
                Self::S2 => of_four(S2),
                Self::S3 => of_four(S3),
            };
        }
        at
    }

    /// When the first laser of a block fires, ns after the stamp of the packet, or, with no clock in the packet
    /// (`stamped` false), before its arrival: negative.
    pub const fn block_ns(self, dual: bool, stamped: bool, block: u8) -> i32 {
        let end = if stamped && !matches!(self, Self::S1) { 0 } else { self.period_ns(dual) };
        self.cycle_ns() * self.cycle(dual, block) as i32 - end
    }

    /// When a laser fires, ns as [`Generation::block_ns`] counts: the laser of slot `slot` (0..32) of a block.
    /// `None` for a slot there is none of.
    pub fn firing_ns(self, dual: bool, block: u8, slot: u8) -> Option<i32> {
        let after = *self.lasers_ns().get(usize::from(slot))?;
        Some(self.block_ns(dual, true, block) + after)
    }

    /// The banks of the twelve blocks.
    pub const fn banks(self) -> [Bank; BLOCKS] {
        const U: Bank = Bank::Upper;
        const L: Bank = Bank::Lower;
        match self {
            Self::S1 => [L, U, U, U, L, U, U, U, L, U, U, U],
            Self::S2 | Self::S3 => [U, L, U, L, U, L, U, L, U, L, U, L],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packet_periods_are_those_of_the_manuals() {
        use Generation::{S1, S2, S3};
        // 12 · 32, 6 · 48, 6 · 57.6 µs; dual: half.
        let periods = [S1, S2, S3].map(|g| (g.period_ns(false), g.period_ns(true)));
        assert_eq!(periods, [(384_000, 384_000), (288_000, 144_000), (345_600, 172_800)]);
    }

    #[test]
    fn firing_times_by_hand() {
        use Generation::{S1, S2, S3};
        // S2 block 5 is of firing 2: 96 + 7 · 6 + 3.66 µs for slot 31.
        assert_eq!(S2.firing_ns(false, 5, 31), Some(141_660));
        // S3 block 11: 5 · 57.6 + 1 · 7.2 + 2.5 µs for slot 6; dual: block 11 is of firing 2.
        assert_eq!(S3.firing_ns(false, 11, 6), Some(297_700));
        assert_eq!(S3.firing_ns(true, 11, 6), Some(124_900));
        // S1: the last laser of a packet 1 µs before its end, the first 384 µs.
        assert_eq!((S1.firing_ns(false, 11, 31), S1.firing_ns(false, 0, 0)), (Some(-1_000), Some(-384_000)));
        assert_eq!(S2.firing_ns(false, 0, 32), None);
    }

    #[test]
    fn an_s2_without_a_clock_is_counted_from_its_end() {
        assert_eq!(Generation::S2.block_ns(false, false, 11), 240_000 - 288_000);
    }
}

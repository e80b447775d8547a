//! When a turning head fires and where it points then, for any packet by its number alone.
//!
//! Times are the oscillator's, ns since the session's start; angles are whole parts of a turn, so that neither wears out
//! however long the head has been turning.

use serde::{Deserialize, Serialize};

/// What the head does not look at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum View {
    /// All round.
    #[default]
    Full,
    /// A sector: the sensor is silent for the rest of each turn.
    Sector {
        /// Where it begins, degrees clockwise from above.
        from_deg: f64,
        /// Where it ends, likewise, beyond the beginning.
        to_deg: f64,
    },
}

/// A turn in parts: at so many turns a minute the head turns as many parts in a nanosecond.
const TURN: u64 = 60_000_000_000;

/// The head turns for 60 days; beyond, all packets are the last one. At 1200 rpm no product below leaves 64 bits until then:
/// 1200 · 5.2e15 is 6.2e18.
const LAST_NS: u64 = 60 * 86_400_000_000_000;

/// The most firing groups in a packet.
pub(super) const GROUPS: usize = 12;

/// Firing groups (all lasers once, a VLP-16's twice) one after the other, and which of them a packet holds.
#[derive(Clone, Debug)]
pub(super) struct Schedule {
    /// Turns a minute.
    rpm: u64,
    /// From one group to the next, ns.
    group_ns: u64,
    /// Groups in a packet.
    groups: usize,
    /// The head's place at the start.
    start: u64,
    /// The sector that is looked at: its beginning and its width.
    sector: Option<(u64, u64)>,
}

/// One firing group.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Group {
    /// When its first laser fires.
    pub(super) oscillator_ns: i64,
    /// Where the head points then, turns clockwise, 0..1.
    pub(super) turns: f64,
}

impl Schedule {
    pub(super) fn new(rpm: u32, group_ns: u32, groups: usize, start_deg: f64, view: View) -> Self {
        let sector = match view {
            View::Full => None,
            View::Sector { from_deg, to_deg } => Some((parts(from_deg), parts(to_deg - from_deg))),
        };
        Self {
            rpm: u64::from(rpm),
            group_ns: u64::from(group_ns),
            groups: groups.min(GROUPS),
            start: parts(start_deg),
            sector: sector.filter(|(_, width)| *width > 0),
        }
    }

    /// The groups of a packet, in order; only the first [`Schedule::groups`] count.
    pub(super) fn packet(&self, index: u64) -> [Group; GROUPS] {
        let first = index.saturating_mul(self.groups as u64).min(self.last());
        let mut number = if self.sector.is_some() { self.seen(first) } else { first };
        let mut packet = [Group::default(); GROUPS];
        for group in packet.iter_mut().take(self.groups) {
            number = self.looks_from(number);
            *group = Group {
                oscillator_ns: (number * self.group_ns) as i64,
                turns: self.place(number) as f64 / TURN as f64,
            };
            number += 1;
        }
        packet
    }

    pub(super) fn groups(&self) -> usize {
        self.groups
    }

    /// How far the head turns in a nanosecond, turns.
    pub(super) fn turns_per_ns(&self) -> f64 {
        self.rpm as f64 / TURN as f64
    }

    /// How many groups of the view there are.
    fn last(&self) -> u64 {
        let all = LAST_NS / self.group_ns.max(1);
        self.sector.map_or(all, |(_, width)| (u128::from(all) * u128::from(width) / u128::from(TURN)) as u64)
    }

    fn step(&self) -> u64 {
        self.rpm * self.group_ns % TURN
    }

    /// Where the head points at a group.
    fn place(&self, number: u64) -> u64 {
        (self.start + number * self.step()) % TURN
    }

    /// The first group at or after one that lies in the view, which is wider than the head turns from group to group.
    fn looks_from(&self, number: u64) -> u64 {
        let Some((from, width)) = self.sector else { return number };
        let inside = (self.place(number) + TURN - from) % TURN;
        if inside < width { number } else { number + (TURN - inside).div_ceil(self.step().max(1)) }
    }

    /// The group that so many groups in the view come before.
    fn seen(&self, before: u64) -> u64 {
        let Some((_, width)) = self.sector else { return before };
        let turn = TURN / self.step().max(1) + 2;
        let groups = |seen: i128| seen * i128::from(TURN) / i128::from(width);
        // Of the places that a head comes back to turn after turn a little more or less than the sector's share may lie in
        // it: the guess by the share is put right by what it sees, until it is off by less than a turn.
        let mut about = groups(i128::from(before));
        for _ in 0..16 {
            let missing = i128::from(before) - i128::from(self.seen_before(about.max(0) as u64));
            about += groups(missing);
            if groups(missing).abs() <= i128::from(turn) {
                break;
            }
        }
        let about = about.max(0) as u64;
        let (mut low, mut high) = (about.saturating_sub(2 * turn), about + 2 * turn);
        while low < high {
            let middle = low + (high - low) / 2;
            if self.seen_before(middle + 1) > before { high = middle } else { low = middle + 1 }
        }
        low
    }

    /// How many of the groups below `number` lie in the view: of x = inside + k·step, those with x mod TURN < width,
    /// each of which is ⌊x / TURN⌋ − ⌊(x − width) / TURN⌋.
    fn seen_before(&self, number: u64) -> u64 {
        let Some((from, width)) = self.sector else { return number };
        let inside = (self.start + TURN - from) % TURN;
        let step = self.step();
        let (all, below) = (floor_sum(number, step, inside), floor_sum(number, step, inside + TURN - width));
        number.wrapping_add(all).wrapping_sub(below)
    }
}

/// Σ ⌊(a k + b) / TURN⌋ for k in 0..n modulo 2⁶⁴, by counting the lattice points below the line from both axes in turn.
fn floor_sum(n: u64, a: u64, b: u64) -> u64 {
    let (mut n, mut m, mut a, mut b) = (n, TURN, a, b);
    let mut sum = 0u64;
    while n > 0 {
        let pairs = if n.is_multiple_of(2) { (n / 2).wrapping_mul(n - 1) } else { n.wrapping_mul((n - 1) / 2) };
        sum = sum.wrapping_add(pairs.wrapping_mul(a / m)).wrapping_add(n.wrapping_mul(b / m));
        (a, b) = (a % m, b % m);
        let top = a * n + b;
        if top < m {
            break;
        }
        (n, b) = (top / m, top % m);
        (m, a) = (a, m);
    }
    sum
}

/// Degrees to parts of a turn, whole turns taken off.
fn parts(deg: f64) -> u64 {
    let turns = deg / 360.0;
    libm::round((turns - libm::floor(turns)) * TURN as f64) as u64 % TURN
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_full_view_fires_without_a_break() {
        // VLP-32C at 600 rpm: a packet of twelve every 663.552 µs; 3600 °/s · 55.296 µs = 0.1990656° a group.
        let schedule = Schedule::new(600, 55_296, 12, 350.0, View::Full);
        let packet = schedule.packet(100);
        for (k, group) in packet.iter().enumerate() {
            let number = 1_200 + k as i64;
            assert_eq!(group.oscillator_ns, number * 55_296);
            let want = (350.0 + 0.199_065_6 * number as f64).rem_euclid(360.0);
            assert!((group.turns * 360.0 - want).abs() < 1e-6);
        }
    }

    #[test]
    fn floor_sums_are_those_of_counting() {
        for (n, a, b) in [(0, 5, 7), (1, 0, TURN), (50, TURN / 7 + 3, TURN / 3), (1_000, 3 * TURN + 1, 11)] {
            let counted: u64 = (0..n).map(|k| (a * k + b) / TURN).sum();
            assert_eq!(floor_sum(n, a, b), counted);
        }
    }

    #[test]
    fn sixty_days_of_turning_do_not_wear_the_angle() {
        let schedule = Schedule::new(1_200, 115_200, 12, 0.0, View::Sector { from_deg: 300.0, to_deg: 420.0 });
        let packet = schedule.packet(u64::MAX);
        // The head comes back to 15 625 places, of which 5208 or 5209 lie in a third of a turn, 5208.33: by the share the
        // end is told to 0.67 in 5208, by the count exactly.
        assert!(packet[0].oscillator_ns.abs_diff(LAST_NS as i64) < LAST_NS / 7_500);
        let first = schedule.last();
        let number = packet[0].oscillator_ns as u64 / 115_200;
        assert_eq!((schedule.seen_before(number), schedule.looks_from(number)), (first, number));
        assert!(packet.iter().all(|group| group.turns >= 300.0 / 360.0 || group.turns < 60.0 / 360.0));
        assert!(packet.windows(2).all(|pair| pair[1].oscillator_ns > pair[0].oscillator_ns));
    }

    proptest! {
        /// Packets made one by one are those of a head that is followed from the start.
        #[test]
        fn packets_made_one_by_one_are_those_of_the_run(
            rpm in prop::sample::select(vec![300u32, 600, 1_200]),
            group_ns in prop::sample::select(vec![46_080u32, 48_000, 55_296, 110_592]),
            groups in prop::sample::select(vec![3usize, 6, 12]),
            start in 0.0f64..360.0,
            from_deg in 0.0f64..360.0,
            width in 1.0f64..359.5,
        ) {
            let view = View::Sector { from_deg, to_deg: from_deg + width };
            let schedule = Schedule::new(rpm, group_ns, groups, start, view);
            let mut followed = (0u64..).filter(|number| schedule.looks_from(*number) == *number);
            for index in 0..300 {
                for group in schedule.packet(index).iter().take(groups) {
                    let number = followed.next().expect("endless");
                    prop_assert_eq!(group.oscillator_ns as u64, number * u64::from(group_ns));
                    let inside = (group.turns * 360.0 - from_deg).rem_euclid(360.0);
                    prop_assert!(inside < width + 1e-6 || inside > 360.0 - 1e-6);
                }
            }
        }
    }
}

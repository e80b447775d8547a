//! The pace of the stamps: which generation sends them, and how many packets lie between two.

use super::timing::Generation;
use tumbled_model::LidarTime;

/// How far one packet's step may be from the nominal period: 288 and 345.6 µs are 20 % apart.
const NOMINAL_WITHIN: f64 = 0.05;
/// How far a longer step may be from a whole number of periods.
const WHOLE_WITHIN: f64 = 0.3;
/// Longest gap that is counted, packets: beyond, the error of the period (1 µs of stamp over the packets it was
/// learnt from) could add up to a packet.
const LONGEST_GAP: f64 = 200.0;
/// Weight of a new step in the period, an average over some 64 packets.
const LEARNING: f64 = 1.0 / 64.0;

/// From one packet to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// The first packet.
    First,
    /// So many packets on; 1 = none lost.
    Packets(u16),
    /// No whole number of periods: out of order, another sensor, a clock that was set, a gap too long.
    Unclear,
}

/// Follows the stamps of one sensor.
#[derive(Clone, Copy, Debug, Default)]
pub struct Pace {
    last: Option<(LidarTime, bool)>,
    /// Generation and its period as it really is, ns.
    known: Option<(Generation, f64)>,
}

impl Pace {
    /// S2 or S3 by the period, once two packets came in a row.
    pub fn generation(&self) -> Option<Generation> {
        self.known.map(|(generation, _)| generation)
    }

    /// Takes in the next packet's stamp.
    pub fn step(&mut self, stamp: LidarTime, dual: bool) -> Step {
        let Some((last, was_dual)) = self.last.replace((stamp, dual)) else {
            return Step::First;
        };
        if dual != was_dual {
            self.known = None;
            return Step::Unclear;
        }
        let step_ns = stamp.since(last).0 as f64;
        let Some((generation, period_ns)) = self.known else {
            self.known = nominal(step_ns, dual);
            return if self.known.is_some() { Step::Packets(1) } else { Step::Unclear };
        };
        let packets = libm::round(step_ns / period_ns);
        let off = (step_ns / period_ns - packets).abs();
        if !(1.0..=LONGEST_GAP).contains(&packets) || off > WHOLE_WITHIN {
            // Another sensor may have taken over: learn anew. A single odd step costs one packet's certainty.
            self.known = None;
            return Step::Unclear;
        }
        if packets == 1.0 {
            self.known = Some((generation, period_ns + LEARNING * (step_ns - period_ns)));
        }
        Step::Packets(packets as u16)
    }
}

fn nominal(step_ns: f64, dual: bool) -> Option<(Generation, f64)> {
    [Generation::S2, Generation::S3].into_iter().find_map(|generation| {
        let period_ns = f64::from(generation.period_ns(dual));
        ((step_ns - period_ns).abs() <= NOMINAL_WITHIN * period_ns).then_some((generation, period_ns))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_period_names_the_generation() {
        let of = |period_us: f64, dual: bool| {
            let mut pace = Pace::default();
            let step = |pace: &mut Pace, n: u32| pace.step(LidarTime((f64::from(n) * period_us) as u32), dual);
            assert_eq!(step(&mut pace, 0), Step::First);
            assert_eq!(step(&mut pace, 1), Step::Packets(1));
            assert_eq!(step(&mut pace, 2), Step::Packets(1));
            pace.generation()
        };
        assert_eq!([of(288.0, false), of(345.6, false)], [Some(Generation::S2), Some(Generation::S3)]);
        assert_eq!([of(144.0, true), of(172.8, true)], [Some(Generation::S2), Some(Generation::S3)]);
    }

    #[test]
    fn gaps_are_counted_across_the_hour_and_with_a_clock_one_permille_off() {
        let mut pace = Pace::default();
        let mut at = LidarTime::HOUR_US - 30_000;
        let mut on = |pace: &mut Pace, us: u32| {
            at = (at + us) % LidarTime::HOUR_US;
            pace.step(LidarTime(at), false)
        };
        on(&mut pace, 0);
        // 345.9456 µs: 1 ‰ more than nominal, in whole stamps of 346 (and 345 every 18th).
        for n in 0..180 {
            assert_eq!(on(&mut pace, if n % 18 == 0 { 345 } else { 346 }), Step::Packets(1), "{n}");
        }
        assert_eq!(on(&mut pace, 346 * 7), Step::Packets(7));
        assert_eq!(on(&mut pace, 69_189), Step::Packets(200)); // 200 · 345.9456
        assert_eq!(on(&mut pace, 173), Step::Unclear); // half a period
        assert_eq!(on(&mut pace, 0), Step::Unclear); // a duplicate
        assert_eq!(pace.generation(), None);
    }
}

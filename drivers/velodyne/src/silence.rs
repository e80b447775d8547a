//! The silence of a sensor with a limited field of view, told from loss.

use crate::azimuth::forward_cdeg;
use crate::speed::TURN_CDEG;

/// Two gaps at the same azimuths to within this are the view's limit and not chance, if they are wide enough.
pub(crate) const SAME_GAP_CDEG: i32 = 100;
/// The turn in sectors of so many hundredths of a degree, to remember where the head has fired: a packet is no wider.
const SECTOR_CDEG: u32 = 500;
const SECTORS: usize = 36_000 / SECTOR_CDEG as usize;

/// The sector in which a sensor with a limited field of view does not fire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SilentSector {
    /// Azimuth of the last firing before it, 0.01°.
    pub from_cdeg: u16,
    /// From there to the first firing behind it, 0.01°.
    pub width_cdeg: u16,
    /// How much later than without it the firings behind it come, ns.
    pub pause_ns: i64,
}

/// A stretch of stamps longer than one packet.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Gap {
    pub(crate) from_cdeg: u16,
    pub(crate) to_cdeg: u16,
    pub(crate) span_ns: i64,
    pub(crate) period_ns: i64,
    pub(crate) lost: u64,
}

impl Gap {
    /// Packets lost in a gap, and how often the head passed the silent sector in it.
    pub(crate) fn explain(&self, silent: SilentSector, speed: Option<f64>) -> (u64, u64) {
        // The middle of the sector is passed, wherever exactly its ends lie this turn.
        let middle = (u32::from(silent.from_cdeg) + u32::from(silent.width_cdeg) / 2) % 36_000;
        let to_middle = i64::from(forward_cdeg(self.from_cdeg, middle as u16));
        let direct = i64::from(forward_cdeg(self.from_cdeg, self.to_cdeg));
        // Whole turns within the gap, from the time it took; without a speed there is less than one.
        let turned = speed.map_or(direct as f64, |speed| speed * self.span_ns as f64);
        let whole_turns = libm::round((turned - direct as f64) / TURN_CDEG).max(0.0) as i64;
        let passes = whole_turns + i64::from((0..=direct).contains(&to_middle));
        (packets_missing(self.span_ns - passes * silent.pause_ns, self.period_ns), passes as u64)
    }

    /// Whether two gaps begin and end at the same azimuths.
    pub(crate) fn same_place(&self, other: &Self) -> bool {
        near(self.from_cdeg, other.from_cdeg) && near(self.to_cdeg, other.to_cdeg)
    }
}

/// The silence that the widths of `jumps` jumps, `angle_cdeg` in all, tell: the time to turn through them less the one firing cycle each that passes
/// anyway, on the sensor's own grid of firing cycles.
pub(crate) fn pause_by_angle(
    angle_cdeg: u32,
    jumps: usize,
    speed_cdeg_per_ns: f64,
    groups: usize,
    period_ns: i64,
) -> i64 {
    if speed_cdeg_per_ns <= 0.0 {
        return 0;
    }
    let cycle = period_ns as f64 / groups as f64;
    let cycles = libm::round(f64::from(angle_cdeg) / speed_cdeg_per_ns / cycle) - jumps as f64;
    (cycles.max(0.0) * cycle) as i64
}

/// Whether two azimuths are the same place for a view's limit.
pub(crate) fn near(a: u16, b: u16) -> bool {
    let apart = forward_cdeg(a, b).rem_euclid(36_000);
    apart.min(36_000 - apart) < SAME_GAP_CDEG
}

/// Packets missing in a span between two stamps.
pub(crate) fn packets_missing(span_ns: i64, period_ns: i64) -> u64 {
    let periods = (span_ns + period_ns / 2) / period_ns.max(1);
    (periods - 1).max(0) as u64
}

/// Sectors in which the head has fired: the view's limits leave them open.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fired([bool; SECTORS]);

impl Default for Fired {
    fn default() -> Self {
        Self([false; SECTORS])
    }
}

impl Fired {
    pub(crate) fn note(&mut self, azimuth_cdeg: u16) {
        if let Some(sector) = self.0.get_mut((u32::from(azimuth_cdeg) / SECTOR_CDEG) as usize % SECTORS) {
            *sector = true;
        }
    }

    /// Whether a whole sector in which it fired lies in the gap. The gap's ends jitter from turn to turn.
    pub(crate) fn within(&self, gap: &Gap) -> bool {
        let width = forward_cdeg(gap.from_cdeg, gap.to_cdeg) - 2 * SAME_GAP_CDEG;
        let from = u32::from(gap.from_cdeg) + SAME_GAP_CDEG as u32;
        let to = from + u32::try_from(width).unwrap_or(0);
        let fired = |sector: u32| self.0.get(sector as usize % SECTORS).is_some_and(|fired| *fired);
        (from.div_ceil(SECTOR_CDEG)..to / SECTOR_CDEG).any(fired)
    }
}

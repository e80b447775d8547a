//! Per-slot constants of a model, computed once: where each of a block's 32 slots looks, and when.

use crate::models::ModelSpec;
use crate::wire::SLOTS;

/// Firing times and directions of the 32 slots of one block. Slot = laser for 32-laser models; for a 16-laser
/// model slots 16..32 are the second firing sequence of lasers 0..16.
#[derive(Clone, Debug)]
pub struct BeamTable {
    /// Distance counts to metres.
    pub(crate) distance_lsb_m: f64,
    /// Firing sequences in a block: 1, or 2 for 16-laser models.
    pub(crate) columns_per_block: u8,
    /// Time from one block's first firing to the next block's, ns (single return).
    pub(crate) block_ns: u32,
    /// Firing time after the block's first firing, ns.
    pub(crate) dt_ns: [i32; SLOTS],
    /// The same as a share of `block_ns`: how far the head has turned on from this block's azimuth to the next one's.
    pub(crate) turn_share: [f64; SLOTS],
    /// Azimuth offset of the laser, radians, and its sine and cosine.
    pub(crate) offset_rad: [f64; SLOTS],
    pub(crate) offset_sin: [f64; SLOTS],
    pub(crate) offset_cos: [f64; SLOTS],
    /// Metres per count along the horizontal and the vertical.
    pub(crate) horizontal_m: [f64; SLOTS],
    pub(crate) vertical_m: [f64; SLOTS],
    /// Height at which the beam leaves, metres; all 0 when vertical offsets are off.
    pub(crate) height_m: [f64; SLOTS],
    pub(crate) laser: [u8; SLOTS],
    pub(crate) ring: [u8; SLOTS],
    /// Firing sequence within the block.
    pub(crate) column: [u8; SLOTS],
}

/// One slot of a block: which laser, when it fires, where it looks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beam {
    /// Laser id.
    pub laser: u8,
    /// Rank by elevation, 0 = lowest.
    pub ring: u8,
    /// Firing sequence within the block, 0 or 1.
    pub column: u8,
    /// Firing time after the block's first firing, ns.
    pub dt_ns: i32,
    /// Elevation above the horizontal, radians.
    pub elevation_rad: f64,
    /// True azimuth less the head's azimuth at the same instant, radians.
    pub azimuth_offset_rad: f64,
    /// Height of the beam's origin over the optical centre, metres; 0 when vertical offsets are off.
    pub height_m: f64,
}

impl BeamTable {
    /// The table of a model; `vertical_offsets` says whether z includes the height −f·tan(elevation) at which a beam leaves.
    pub fn new(spec: &ModelSpec, vertical_offsets: bool) -> Self {
        let lasers = spec.elevation_deg.len().clamp(1, SLOTS);
        let columns_per_block = (SLOTS / lasers) as u8;
        let block_ns = spec.cycle_ns * u32::from(columns_per_block);
        let mut table = Self {
            distance_lsb_m: spec.distance_lsb_m,
            columns_per_block,
            block_ns,
            dt_ns: [0; SLOTS],
            turn_share: [0.0; SLOTS],
            offset_rad: [0.0; SLOTS],
            offset_sin: [0.0; SLOTS],
            offset_cos: [0.0; SLOTS],
            horizontal_m: [0.0; SLOTS],
            vertical_m: [0.0; SLOTS],
            height_m: [0.0; SLOTS],
            laser: [0; SLOTS],
            ring: [0; SLOTS],
            column: [0; SLOTS],
        };
        let beams = spec.elevation_deg.iter().zip(spec.azimuth_offset_deg).enumerate().cycle();
        for (slot, (laser, (elevation, offset))) in (0..SLOTS).zip(beams) {
            let column = slot / lasers;
            let firing = laser as u32 / u32::from(spec.lasers_per_firing);
            let dt_ns = column as u32 * spec.cycle_ns + firing * spec.firing_ns;
            let (sin_e, cos_e) = libm::sincos(elevation.to_radians());
            let (sin_o, cos_o) = libm::sincos(offset.to_radians());
            let ring = spec.elevation_deg.iter().filter(|other| *other < elevation).count();
            let height_m = if vertical_offsets { -spec.focal_mm * 1e-3 * sin_e / cos_e } else { 0.0 };
            set(&mut table.dt_ns, slot, dt_ns as i32);
            set(&mut table.turn_share, slot, f64::from(dt_ns) / f64::from(block_ns));
            set(&mut table.offset_rad, slot, offset.to_radians());
            set(&mut table.offset_sin, slot, sin_o);
            set(&mut table.offset_cos, slot, cos_o);
            set(&mut table.horizontal_m, slot, cos_e * spec.distance_lsb_m);
            set(&mut table.vertical_m, slot, sin_e * spec.distance_lsb_m);
            set(&mut table.height_m, slot, height_m);
            set(&mut table.laser, slot, laser as u8);
            set(&mut table.ring, slot, ring as u8);
            set(&mut table.column, slot, column as u8);
        }
        table
    }

    /// Where and when a slot of a block looks; `None` past the last slot.
    pub fn beam(&self, slot: usize) -> Option<Beam> {
        Some(Beam {
            laser: *self.laser.get(slot)?,
            ring: *self.ring.get(slot)?,
            column: *self.column.get(slot)?,
            dt_ns: *self.dt_ns.get(slot)?,
            elevation_rad: libm::atan2(*self.vertical_m.get(slot)?, *self.horizontal_m.get(slot)?),
            azimuth_offset_rad: *self.offset_rad.get(slot)?,
            height_m: *self.height_m.get(slot)?,
        })
    }

    /// Metres a distance count.
    pub fn distance_lsb_m(&self) -> f64 {
        self.distance_lsb_m
    }

    /// Time from one block's first firing to the next block's (single return), ns.
    pub fn block_ns(&self) -> u32 {
        self.block_ns
    }

    /// From a packet's first firing to its last, ns. `groups` firing groups: 12 blocks, or in dual return 6 pairs.
    pub fn last_firing_ns(&self, groups: usize) -> i32 {
        (groups.max(1) as i32 - 1) * self.block_ns as i32 + self.dt_ns.iter().copied().max().unwrap_or(0)
    }
}

fn set<T>(column: &mut [T; SLOTS], slot: usize, value: T) {
    if let Some(place) = column.get_mut(slot) {
        *place = value;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::Model;

    fn table(model: Model) -> BeamTable {
        BeamTable::new(model.spec().expect("built-in model"), true)
    }

    #[test]
    fn vlp32c_rings_and_times_are_the_tables() {
        let t = table(Model::Vlp32c);
        // Laser 5 looks at 0°, 20 lasers look lower; it fires with laser 4 as the third pair: 2 × 2.304 µs.
        assert_eq!((t.ring[5], t.dt_ns[5], t.dt_ns[4]), (20, 4_608, 4_608));
        // Last pair: 15 × 2.304 = 34.560 µs; the packet's last firing: 11 × 55.296 + 34.560 = 642.816 µs.
        assert_eq!(t.dt_ns[31], 34_560);
        assert_eq!(11 * i64::from(t.block_ns) + i64::from(t.dt_ns[31]), 642_816);
        // f·tan 25° = 42.4 mm × 0.46631 = 19.77 mm.
        assert!((t.height_m[0] - 0.01977).abs() < 5e-6);
    }

    #[test]
    fn vlp16_slot_sixteen_is_laser_zero_one_cycle_later() {
        let t = table(Model::Vlp16);
        assert_eq!((t.laser[16], t.column[16], t.dt_ns[16]), (0, 1, 55_296));
        assert_eq!(t.turn_share[16], 0.5);
    }

    #[test]
    fn hdl32e_last_firing_is_542_592_ns_after_the_first() {
        // 11 × 46.080 + 31 × 1.152 = 542.592 µs [H32 appendix E].
        let t = table(Model::Hdl32e);
        assert_eq!(t.last_firing_ns(12), 542_592);
        // Dual: 5 × 46.080 + 35.712 µs.
        assert_eq!(t.last_firing_ns(6), 266_112);
    }
}

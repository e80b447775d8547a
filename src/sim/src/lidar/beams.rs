//! A head's lasers: when each fires within a firing group, where it leaves and where it looks.

use super::{Head, LidarError};
use crate::noise::Noise;
use tumbled_velodyne::ReturnMode;
use tumbled_velodyne::beams::BeamTable;
use tumbled_velodyne::encode::raw_distance;
use tumbled_velodyne::hdl64::{self, Calibration, Generation, LASERS, LaserCalibration};

/// One laser's firing within a group.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Beam {
    pub(super) laser: u8,
    /// After the group's first firing, ns.
    pub(super) dt_ns: i32,
    /// The beam's azimuth less the head's, clockwise.
    pub(super) sin_offset: f64,
    pub(super) cos_offset: f64,
    pub(super) sin_elevation: f64,
    pub(super) cos_elevation: f64,
    /// Where it leaves, to the left of its direction and above the centre, m.
    pub(super) left_m: f64,
    pub(super) height_m: f64,
}

/// All lasers of a head.
#[derive(Clone, Debug)]
pub(super) struct Beams {
    /// By place in the packet: slot of the block, an HDL-64E's lower bank after its upper one.
    pub(super) beams: Vec<Beam>,
    /// From one group to the next, ns.
    pub(super) group_ns: u32,
    /// Groups in a packet.
    pub(super) groups: usize,
    /// The widest azimuth offset, rad, and how far from the centre beams leave, m.
    pub(super) widest_rad: f64,
    pub(super) reach_m: f64,
    counts: Counts,
}

/// Distances to counts.
#[derive(Clone, Debug)]
enum Counts {
    /// Metres a count.
    Even(f64),
    /// By each laser's corrections.
    Calibrated(Box<hdl64::Beams>),
}

impl Beams {
    pub(super) fn new(head: &Head, mode: ReturnMode, vertical_offsets: Option<bool>) -> Result<Self, LidarError> {
        match head {
            Head::BuiltIn(model) => {
                let spec = model.spec().ok_or(LidarError::NoCalibration)?;
                let offsets = vertical_offsets.unwrap_or(model.vertical_offsets_default());
                let table = BeamTable::new(spec, offsets);
                let slots = (0..).map_while(|slot| table.beam(slot));
                let beams = slots.map(|beam| {
                    let (sin_offset, cos_offset) = libm::sincos(beam.azimuth_offset_rad);
                    let (sin_elevation, cos_elevation) = libm::sincos(beam.elevation_rad);
                    Beam {
                        laser: beam.laser,
                        dt_ns: beam.dt_ns,
                        sin_offset,
                        cos_offset,
                        sin_elevation,
                        cos_elevation,
                        left_m: 0.0,
                        height_m: beam.height_m,
                    }
                });
                let groups = 12 / mode.blocks_per_firing();
                Ok(Self::of(beams.collect(), table.block_ns(), groups, Counts::Even(table.distance_lsb_m())))
            }
            Head::Hdl64e { generation, calibration } => {
                let dual = mode == ReturnMode::Dual;
                if *generation == Generation::S1 || (dual && *generation != Generation::S3) {
                    return Err(LidarError::Generation { generation: *generation, mode });
                }
                let times = generation.lasers_ns();
                let lasers = (0u8..).zip(calibration.lasers()).zip(times.iter().cycle());
                let beams = lasers.map(|((laser, calibrated), dt_ns)| {
                    let (sin_offset, cos_offset) = libm::sincos(-calibrated.rotation_rad);
                    let (sin_elevation, cos_elevation) = libm::sincos(calibrated.vertical_rad);
                    Beam {
                        laser,
                        dt_ns: *dt_ns,
                        sin_offset,
                        cos_offset,
                        sin_elevation,
                        cos_elevation,
                        left_m: calibrated.horizontal_offset_m,
                        height_m: calibrated.vertical_offset_m,
                    }
                });
                let counts = Counts::Calibrated(Box::new(hdl64::Beams::new(calibration)));
                let groups = usize::from(generation.cycles_per_packet(dual));
                Ok(Self::of(beams.collect(), generation.cycle_ns() as u32, groups, counts))
            }
        }
    }

    fn of(beams: Vec<Beam>, group_ns: u32, groups: usize, counts: Counts) -> Self {
        let most = |of: &dyn Fn(&Beam) -> f64| beams.iter().map(of).fold(0.0, f64::max);
        let widest_rad = most(&|beam| libm::atan2(beam.sin_offset, beam.cos_offset).abs());
        let reach_m = most(&|beam| beam.left_m.abs() + beam.height_m.abs());
        Self { beams, group_ns, groups, widest_rad, reach_m, counts }
    }

    /// From a packet group's first firing to its last, ns.
    pub(super) fn last_ns(&self) -> i32 {
        self.beams.iter().map(|beam| beam.dt_ns).max().unwrap_or(0)
    }

    /// The count a distance becomes; 0 where none does. `head_rad` is where the head points at the firing.
    pub(super) fn raw(&self, laser: u8, head_rad: f64, range_m: f64) -> u16 {
        match &self.counts {
            Counts::Even(unit_m) => raw_distance(range_m, *unit_m),
            Counts::Calibrated(beams) => beams.raw(laser, head_rad, range_m).unwrap_or(0),
        }
    }
}

/// A calibration like an HDL-64E S2's, in whole units of the one it sends (0.01°, 1 mm): upper bank +2° to −8.33° in
/// thirds of a degree, lower bank −8.83° to −24.33° in halves (S2 manual), lasers turned and offset in pairs, one
/// distance correction each. Without near points, so that points lie on their rays.
///
/// # Errors
/// None in truth: the numbers are plausible. The constructor's error is handed on.
pub fn made_calibration() -> Result<Calibration, hdl64::calibration::CalibrationError> {
    made(|_within| 0)
}

/// The same as another unit of the series would have it: each laser is up to 0.1° and 3 cm off, drawn by the seed.
///
/// # Errors
/// As [`made_calibration`].
pub fn made_calibration_of(id: &str, seed: u64) -> Result<Calibration, hdl64::calibration::CalibrationError> {
    let mut noise = Noise::new(seed, &format!("lidar.{id}.calibration"), 0);
    made(|within| libm::round((2.0 * noise.uniform() - 1.0) * f64::from(within)) as i32)
}

/// `off`: a whole number between minus and plus its argument.
fn made(mut off: impl FnMut(i32) -> i32) -> Result<Calibration, hdl64::calibration::CalibrationError> {
    let mut lasers = [LaserCalibration::default(); LASERS];
    for (id, laser) in (0i32..).zip(lasers.iter_mut()) {
        let cdeg = |cdeg: i32| (f64::from(cdeg) * 0.01).to_radians();
        let mm = |mm: i32| f64::from(mm) * 1e-3;
        let elevation_cdeg = if id < 32 { 200 - (id * 100 + 1) / 3 } else { -883 - (id - 32) * 50 };
        let side = if id % 2 == 0 { 1 } else { -1 };
        *laser = LaserCalibration {
            rotation_rad: cdeg(side * (260 + id % 8 * 60) + off(10)),
            vertical_rad: cdeg(elevation_cdeg + off(10)),
            distance_m: mm(1_100 + id * 37 % 64 * 5 + off(30)),
            vertical_offset_m: mm(if id < 32 { 210 } else { 130 }),
            horizontal_offset_m: mm(side * 26),
            focal_distance_m: mm(12_000),
            focal_slope: 0.0,
            ..LaserCalibration::default()
        };
    }
    Calibration::new(lasers)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_unit_of_a_series_has_a_calibration_of_its_own_that_its_file_holds() {
        let nominal = made_calibration().expect("plausible");
        let mut seen = Vec::new();
        for seed in 0..20 {
            let unit = made_calibration_of("front", seed).expect("plausible");
            let again = Calibration::parse(&unit.to_db_xml()).expect("a database");
            for ((laser, read), usual) in unit.lasers().iter().zip(again.lasers()).zip(nominal.lasers()) {
                assert!((laser.vertical_rad - usual.vertical_rad).abs() <= 0.1001f64.to_radians());
                assert!((laser.rotation_rad - usual.rotation_rad).abs() <= 0.1001f64.to_radians());
                assert!((laser.distance_m - usual.distance_m).abs() <= 0.0301);
                assert!((laser.distance_m - read.distance_m).abs() < 1e-12);
            }
            assert!(!seen.contains(&unit));
            seen.push(unit);
        }
    }
}

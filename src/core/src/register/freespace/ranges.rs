//! Free space of a LiDAR's range image with its misses (method.md §3.4).

use super::angle::arc;
use super::{Depths, Sighting};
use crate::register::cloud::RangeView;

/// A place belongs to a ring within this elevation, rad: 0.25°.
const ON_RING: f32 = 4.363_323e-3;
/// Elevations in a table of the nearest ring, rad: 0.05°.
const TABLE_STEP: f32 = 8.726_646e-4;
/// Entries of that table at most: half a turn.
const MOST_ENTRIES: usize = 3_600;
/// No ring.
const NONE: u16 = u16::MAX;

/// What three neighbouring firings say.
#[derive(Clone, Copy, Debug)]
struct Firings {
    /// The least range, m; infinite: all three missed; NaN: one is not known.
    least: f32,
    /// The middle one's.
    middle: f32,
}

/// The least range around every firing.
#[derive(Clone, Debug)]
pub struct RangeMask {
    first_azimuth: f32,
    inverse_step: f32,
    columns: usize,
    first_elevation: f32,
    /// The ring of each elevation.
    ring_at: Vec<u16>,
    firings: Vec<Firings>,
}

impl RangeMask {
    /// From an image. `None`: it is empty, its rings are not as long as each other, or a step or elevation makes no sense.
    pub fn build(view: &RangeView) -> Option<Self> {
        let rings = view.elevations_rad.len();
        let columns = view.range_m.len().checked_div(rings)?;
        let whole = columns * rings == view.range_m.len() && columns >= 3 && rings < usize::from(NONE);
        let (&first, &last) = (view.elevations_rad.first()?, view.elevations_rad.last()?);
        let first_elevation = first - ON_RING;
        let entries = ((last + ON_RING - first_elevation) / TABLE_STEP) as usize + 1;
        let is_rising = view.elevations_rad.array_windows().all(|[a, b]| a < b);
        let makes_sense = is_rising && view.azimuth_step_rad > 0.0 && view.first_azimuth_rad.is_finite();
        if !whole || !makes_sense || !first.is_finite() || entries > MOST_ENTRIES {
            return None;
        }
        let ring = |entry: usize| {
            let elevation = first_elevation + (entry as f32 + 0.5) * TABLE_STEP;
            let away = |&(_, e): &(u16, &f32)| (e - elevation).abs();
            let nearest = (0..).zip(&view.elevations_rad).min_by(|a, b| away(a).total_cmp(&away(b)));
            nearest.filter(|ring| away(ring) < ON_RING).map_or(NONE, |(number, _)| number)
        };
        Some(Self {
            first_azimuth: view.first_azimuth_rad,
            inverse_step: 1.0 / view.azimuth_step_rad,
            columns,
            first_elevation,
            ring_at: (0..entries).map(ring).collect(),
            firings: view.range_m.chunks_exact(columns).flat_map(eroded).collect(),
        })
    }

    /// What the LiDAR says of a place in its own frame (z up), m.
    #[inline(always)]
    pub fn look(&self, [x, y, z]: [f32; 3]) -> Sighting {
        let flat = x * x + y * y;
        let elevation = arc(z, flat.sqrt());
        let entry = (elevation - self.first_elevation) * (1.0 / TABLE_STEP);
        // Not a number has no direction.
        if flat.is_nan() || entry.is_nan() || entry < 0.0 {
            return Sighting::UNKNOWN;
        }
        let Some(&ring) = self.ring_at.get(entry as usize).filter(|&&ring| ring != NONE) else {
            return Sighting::UNKNOWN;
        };
        // Less than a turn from the first column.
        let mut azimuth = arc(y, x) - self.first_azimuth;
        let turn = core::f32::consts::TAU;
        if azimuth < -0.5 / self.inverse_step {
            azimuth += turn;
        }
        if azimuth >= turn - 0.5 / self.inverse_step {
            azimuth -= turn;
        }
        let column = azimuth * self.inverse_step + 0.5;
        if !(column >= 0.0 && column < self.columns as f32) {
            return Sighting::UNKNOWN;
        }
        let place = usize::from(ring) * self.columns + column as usize;
        let Some(firings) = self.firings.get(place).filter(|firings| !firings.least.is_nan()) else {
            return Sighting::UNKNOWN;
        };
        let range = (flat + z * z).sqrt();
        let behind_m = if firings.middle.is_finite() { range - firings.middle } else { f32::INFINITY };
        if firings.least == f32::INFINITY {
            return Sighting { known: true, sky: 1.0, ..Sighting::UNKNOWN };
        }
        let (front, hidden) = (Depths::LIDAR.share(firings.least - range), Depths::LIDAR.share(range - firings.least));
        Sighting { known: true, front, hidden, sky: 0.0, behind_m }
    }
}

/// A ring with the least of three neighbours; its ends have no two.
fn eroded(ring: &[f32]) -> Vec<Firings> {
    let known = |range: f32| if range > 0.0 { range } else { f32::NAN };
    let least = |a: f32, b: f32| if a.is_nan() || a < b { a } else { b };
    let end = |range: f32| Firings { least: f32::NAN, middle: known(range) };
    let inner = ring
        .array_windows()
        .map(|&[a, b, c]| Firings { least: least(least(known(a), known(b)), known(c)), middle: known(b) });
    let ends = |at: Option<&f32>| at.map(|&range| end(range));
    ends(ring.first()).into_iter().chain(inner).chain(ends(ring.last())).collect()
}

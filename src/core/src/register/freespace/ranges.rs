//! Free space of a LiDAR's range image with its misses (method.md §3.4).

use super::angle::arc;
use super::rings::Rings;
use super::{Depths, Sightings, graded};
use crate::register::cloud::RangeView;
use crate::surface::four::indices;
use core::f32::consts::TAU;
use wide::f32x4;

/// A place belongs to a ring within this elevation, rad: 0.25°.
const ON_RING: f32 = 4.363_323e-3;
/// Elevations in a table of the nearest ring, rad: 0.05°.
const TABLE_STEP: f32 = 8.726_646e-4;
/// Entries of that table at most: half a turn.
const MOST_ENTRIES: usize = 3_600;
/// A place farther than this from every return begins to be one that the LiDAR would have seen, and as much farther it is, m.
/// Nearer ones are at an edge: rings lie 6 mm apart and more, a beam is some 6 mm wide there, and poses are not exact.
const EDGE_M: f32 = 0.03;
/// Returns are looked for within this angle, rad: 6 cm at 1 m.
const AROUND: f32 = 0.06;
/// No ring.
const NONE: u16 = u16::MAX;

/// What three neighbouring firings say.
#[derive(Clone, Copy, Debug)]
struct Firings {
    /// The least range, m; infinite: all three missed; NaN: one is not known.
    least: f32,
    /// The middle one's.
    middle: f32,
    /// From the middle one, which missed, to the nearest return of any ring, rad.
    away: f32,
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
    rings: Rings,
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
            firings: firings(view, columns),
            rings: Rings {
                elevations_rad: view.elevations_rad.iter().copied().map(f64::from).collect(),
                step_rad: view.azimuth_step_rad.into(),
            },
        })
    }

    /// The image's rings.
    pub fn rings(&self) -> &Rings {
        &self.rings
    }

    /// What the LiDAR says of four places in its own frame (z up), m.
    #[inline(always)]
    pub(crate) fn look_at_four(&self, [x, y, z]: [f32x4; 3]) -> Sightings {
        let flat = x * x + y * y;
        let elevation = arc(z, flat.sqrt());
        let entry = (elevation - f32x4::splat(self.first_elevation)) * f32x4::splat(1.0 / TABLE_STEP);
        let range = (flat + z * z).sqrt();
        // Not a number has no direction.
        let is_above = entry.simd_ge(f32x4::ZERO) & range.simd_eq(range);
        // Less than a turn from the first column.
        let (turn, half) = (f32x4::splat(TAU), 0.5 / self.inverse_step);
        let azimuth = arc(y, x) - f32x4::splat(self.first_azimuth);
        let azimuth = azimuth + (turn & azimuth.simd_lt(f32x4::splat(-half)));
        let azimuth = azimuth - (turn & azimuth.simd_ge(f32x4::splat(TAU - half)));
        let column = azimuth * f32x4::splat(self.inverse_step) + f32x4::splat(0.5);
        let in_columns = column.simd_ge(f32x4::ZERO) & column.simd_lt(f32x4::splat(self.columns as f32));
        let in_view = is_above & in_columns;
        let places = indices(entry & in_view).into_iter().zip(indices(column & in_view));
        let (mut least, mut middle, mut away) = ([f32::NAN; 4], [f32::NAN; 4], [0.0; 4]);
        let found = least.iter_mut().zip(&mut middle).zip(&mut away);
        for ((entry, column), ((least, middle), away)) in places.zip(found) {
            let ring = self.ring_at.get(entry).filter(|&&ring| ring != NONE);
            let firings = ring.and_then(|&ring| self.firings.get(usize::from(ring) * self.columns + column));
            if let Some(firings) = firings {
                (*least, *middle, *away) = (firings.least, firings.middle, firings.away);
            }
        }
        let (least, middle, away) = (f32x4::new(least), f32x4::new(middle), f32x4::new(away));
        let sky = graded((away * range - f32x4::splat(EDGE_M)) * f32x4::splat(1.0 / EDGE_M));
        Sightings::of_image(in_view, [range, least, middle], Depths::LIDAR, sky)
    }

    #[cfg(test)]
    pub(crate) fn look(&self, place: [f32; 3]) -> super::Sighting {
        self.look_at_four(place.map(f32x4::splat)).first()
    }
}

/// Every firing with its neighbours.
fn firings(view: &RangeView, columns: usize) -> Vec<Firings> {
    let mut firings: Vec<Firings> = view.range_m.chunks_exact(columns).flat_map(eroded).collect();
    let rings = view.range_m.chunks_exact(columns).zip(&view.elevations_rad);
    // Along each ring first; then from ring to ring.
    let along: Vec<(f32, Vec<f32>)> = rings
        .map(|(ring, &elevation)| (elevation, gaps(ring, view.azimuth_step_rad * libm::cosf(elevation))))
        .collect();
    for (own, &(elevation, _)) in firings.chunks_exact_mut(columns).zip(&along) {
        for (other, gaps) in along.iter().filter(|(other, _)| (other - elevation).abs() < AROUND) {
            let across = (other - elevation) * (other - elevation);
            for (firings, gap) in own.iter_mut().zip(gaps) {
                let squared = across + gap * gap;
                if squared < firings.away {
                    firings.away = squared;
                }
            }
        }
        own.iter_mut().for_each(|firings| firings.away = firings.away.sqrt());
    }
    firings
}

/// From each firing of a ring to its nearest return, rad; [`AROUND`] where there is none.
fn gaps(ring: &[f32], step: f32) -> Vec<f32> {
    let mut gaps = vec![AROUND; ring.len()];
    let sweep = |gaps: &mut dyn Iterator<Item = (&mut f32, &f32)>| {
        let mut gap = AROUND;
        for (nearest, range) in gaps {
            gap = if *range > 0.0 && range.is_finite() { 0.0 } else { gap + step };
            *nearest = nearest.min(gap);
        }
    };
    sweep(&mut gaps.iter_mut().zip(ring));
    sweep(&mut gaps.iter_mut().zip(ring).rev());
    gaps
}

/// A ring with the least of three neighbours; its ends have no two.
fn eroded(ring: &[f32]) -> Vec<Firings> {
    let known = |range: f32| if range > 0.0 { range } else { f32::NAN };
    let least = |a: f32, b: f32| if a.is_nan() || a < b { a } else { b };
    let end = |range: f32| Firings { least: f32::NAN, middle: known(range), away: f32::INFINITY };
    let inner = ring.array_windows().map(|&[a, b, c]| Firings {
        least: least(least(known(a), known(b)), known(c)),
        middle: known(b),
        away: f32::INFINITY,
    });
    let ends = |at: Option<&f32>| at.map(|&range| end(range));
    ends(ring.first()).into_iter().chain(inner).chain(ends(ring.last())).collect()
}

//! The rings of a LiDAR, found from its points.

use nalgebra::Vector3;

/// A gap of elevation that parts two rings, rad: 0.1°.
const PARTED: f64 = 0.1 * DEGREE;
/// A ring's width at most, in the median, rad.
const NARROW: f64 = 0.1 * DEGREE;
/// Wider than this is no ring, rad; such may be a fifth of all.
const WIDE: f64 = 0.2 * DEGREE;
/// Azimuths closer than this are the same firing's, rad.
const SAME: f64 = 1e-5;
/// Least azimuth step, rad: finer than any LiDAR's.
const LEAST_STEP: f64 = 0.02 * DEGREE;
/// The step where no ring has two points, rad.
const COARSEST_STEP: f64 = 2.0 * DEGREE;
/// Returns a radian of a ring, over the median step: 1/step where all are there, ln 2/step where they were thinned at
/// random (their gaps are exponential). The smaller, a little below it, is right for both.
const RATE: f64 = 0.7;

const DEGREE: f64 = core::f64::consts::PI / 180.0;

/// Rings: they exist only where they were seen.
#[derive(Clone, Debug, PartialEq)]
pub struct Rings {
    /// Mean elevation of each, rising, rad.
    pub elevations_rad: Vec<f64>,
    /// The median angle between neighbours on a ring, rad (of the arc, not of the azimuth).
    pub step_rad: f64,
}

/// A point's direction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Direction {
    /// From the mean direction's azimuth, −π..=π, rad.
    pub(crate) azimuth: f64,
    pub(crate) elevation: f64,
}

impl Direction {
    /// Of a ray, with azimuths from `from`.
    pub(crate) fn of(ray: &Vector3<f32>, from: f64) -> Self {
        let [x, y, z] = [ray.x, ray.y, ray.z].map(f64::from);
        let azimuth = libm::atan2(y, x) - from;
        let turn = core::f64::consts::TAU;
        Self {
            azimuth: azimuth - turn * libm::round(azimuth / turn),
            elevation: libm::atan2(z, (x * x + y * y).sqrt()),
        }
    }
}

impl Rings {
    /// Clusters of elevation, split at gaps. `None`: the points do not lie on rings.
    pub(crate) fn find(directions: &[Direction], mean_elevation: f64) -> Option<Self> {
        let mut sorted = directions.to_vec();
        sorted.sort_by(|a, b| a.elevation.total_cmp(&b.elevation).then(a.azimuth.total_cmp(&b.azimuth)));
        let clusters = || sorted.chunk_by(|a, b| b.elevation - a.elevation <= PARTED);
        let width = |ring: &[Direction]| match ring {
            [first, .., last] => last.elevation - first.elevation,
            _ => 0.0,
        };
        let mut widths: Vec<f64> = clusters().map(width).collect();
        let count = widths.len();
        let wide = widths.iter().filter(|&&width| width > WIDE).count();
        widths.sort_by(f64::total_cmp);
        let median = widths.get(count / 2)?;
        if 3 * count > directions.len() || *median >= NARROW || 5 * wide >= count {
            return None;
        }
        let mean = |ring: &[Direction]| ring.iter().map(|d| d.elevation).sum::<f64>() / ring.len() as f64;
        let mut gaps: Vec<f64> = clusters().flat_map(gaps_of).collect();
        gaps.sort_by(f64::total_cmp);
        let step = gaps.get(gaps.len() / 2).map(|gap| (gap * libm::cos(mean_elevation)).max(LEAST_STEP));
        Some(Self { elevations_rad: clusters().map(mean).collect(), step_rad: step.unwrap_or(COARSEST_STEP) })
    }

    /// The ring of an elevation, rad: the nearest.
    pub fn of(&self, elevation_rad: f64) -> Option<usize> {
        let above = self.elevations_rad.partition_point(|ring| *ring < elevation_rad);
        let off = |index: usize| self.elevations_rad.get(index).map(|ring| (ring - elevation_rad).abs());
        let nearest = match (above.checked_sub(1).and_then(off), off(above)) {
            (Some(below), Some(over)) if below <= over => above - 1,
            (_, Some(_)) => above,
            (Some(_), None) => above - 1,
            (None, None) => return None,
        };
        off(nearest).filter(|off| *off <= WIDE).map(|_| nearest)
    }

    /// Returns due in a disc of a radius (rad) about an elevation (rad), if a surface filled it.
    pub fn expected(&self, elevation_rad: f64, radius_rad: f64) -> f64 {
        let rate = RATE / self.step_rad;
        let chord = |ring: &f64| {
            let off = elevation_rad - ring;
            2.0 * (radius_rad * radius_rad - off * off).max(0.0).sqrt()
        };
        rate * self.elevations_rad.iter().map(chord).sum::<f64>()
    }
}

fn gaps_of(ring: &[Direction]) -> Vec<f64> {
    let mut azimuths: Vec<f64> = ring.iter().map(|direction| direction.azimuth).collect();
    azimuths.sort_by(f64::total_cmp);
    azimuths.array_windows().map(|[a, b]| b - a).filter(|gap| *gap > SAME).collect()
}

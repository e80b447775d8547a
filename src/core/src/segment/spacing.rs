//! How far apart points of one surface lie.

use crate::epoch::LidarScan;

/// Points of a Kinect, or of the finest LiDAR, nearer than this are of one thing, m.
pub(super) const LEAST_M: f32 = 0.05;
/// Coarser than this and everything is one thing, m.
const MOST_M: f32 = 0.40;
/// A ring may be lost between two that hold.
const RINGS: f32 = 2.5;

/// What connects the candidates of a LiDAR's scan, m: 2.5 times the distance between the rings that they are on.
pub(super) fn of_rings(scan: &LidarScan, candidates: &[u32]) -> f32 {
    let points = &scan.points;
    let mut elevations = [f32::NAN; 256];
    for ((ring, z), range) in points.ring.iter().zip(&points.z).zip(&points.range_m) {
        // The first point of a ring stands for it.
        if let Some(elevation) = elevations.get_mut(usize::from(*ring)).filter(|held| held.is_nan())
            && *range > 0.0
        {
            *elevation = libm::asinf((z / range).clamp(-1.0, 1.0));
        }
    }
    let (mut lowest, mut highest, mut ranges) = (u8::MAX, 0, 0.0f64);
    for number in candidates {
        let number = *number as usize;
        let (Some(ring), Some(range)) = (points.ring.get(number), points.range_m.get(number)) else { continue };
        (lowest, highest) = (lowest.min(*ring), highest.max(*ring));
        ranges += f64::from(*range);
    }
    // One ring more to both sides: what is on a single ring has neighbours too.
    let rings = usize::from(lowest.saturating_sub(1))..=usize::from(highest.saturating_add(1));
    let mut seen: Vec<f32> = elevations.get(rings).into_iter().flatten().copied().filter(|e| !e.is_nan()).collect();
    seen.sort_unstable_by(f32::total_cmp);
    let mut gaps: Vec<f32> = seen.iter().zip(seen.iter().skip(1)).map(|(below, above)| above - below).collect();
    gaps.sort_unstable_by(f32::total_cmp);
    let gap = gaps.get(gaps.len() / 2).copied().unwrap_or(0.0);
    (RINGS * gap * (ranges / candidates.len().max(1) as f64) as f32).clamp(LEAST_M, MOST_M)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::segment::scene::{everything, lidar_wall};

    #[test]
    fn rings_two_degrees_apart_at_three_metres_connect_over_a_quarter_of_a_metre() {
        // 2.5 × 3 m × 2° = 0.262 m; at 0.33° 0.043 m, which is below the least.
        for (degrees, expected) in [(2.0f32, 0.262), (0.33, 0.05), (5.0, 0.40)] {
            let scan = lidar_wall(16, degrees.to_radians(), 3.0);
            let found = of_rings(&scan, &everything(scan.points.len()));
            // The wall is a little farther off the middle than in it.
            assert!((found - expected).abs() < 0.01 * expected + 1e-6, "{degrees}: {found}");
        }
    }

    #[test]
    fn an_empty_scan_has_the_least() {
        assert_eq!(of_rings(&LidarScan::default(), &[]), LEAST_M);
    }
}

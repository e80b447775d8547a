//! Flying pixels of a Kinect: points between two surfaces, where one hides the other.

use tumbled_kinect::{PIXELS, Points, WIDTH};

/// A jump from pixel to pixel that no surface makes, in standard deviations of the depth: 4 cm at 2 m. A surface that is
/// seen at less than 80° from its normal makes smaller ones.
const JUMP_SIGMAS: f32 = 7.0;

/// Tells flying pixels; made once and reused.
#[derive(Clone, Debug)]
pub(super) struct FlyingPixels {
    /// Depth by pixel, m; 0: none. All 0 between two calls.
    depth: Vec<f32>,
}

impl FlyingPixels {
    pub(super) fn new() -> Self {
        Self { depth: vec![0.0; PIXELS] }
    }

    /// Leaves out of `candidates` (numbers of points, ascending) those that jump from both neighbours beside them, or from
    /// both above and below. What no depth is known of, beside an object, is a jump: what flies is seen next to shadows.
    /// Returns how many were left out.
    pub(super) fn remove(&mut self, points: &Points, candidates: &mut Vec<u32>) -> u32 {
        let (pixels, z, sigma) = (points.pixel(), points.z(), points.sigma_z());
        let pixel_of = |number: Option<&u32>| number.and_then(|number| pixels.get(*number as usize)).copied();
        let (Some(first), Some(last)) = (pixel_of(candidates.first()), pixel_of(candidates.last())) else { return 0 };
        // Pixels ascend: what may be a neighbour lies in one run of points.
        let from = pixels.partition_point(|pixel| *pixel as usize + WIDTH < first as usize);
        let to = pixels.partition_point(|pixel| *pixel as usize <= last as usize + WIDTH);
        let run = || pixels.get(from..to).unwrap_or_default().iter().zip(z.get(from..to).unwrap_or_default());
        for (pixel, z) in run() {
            if let Some(depth) = self.depth.get_mut(*pixel as usize) {
                *depth = *z;
            }
        }
        let before = candidates.len();
        candidates.retain(|number| {
            let number = *number as usize;
            let (Some(pixel), Some(z), Some(sigma)) = (pixels.get(number), z.get(number), sigma.get(number)) else {
                return false;
            };
            !self.flies(*pixel as usize, *z, JUMP_SIGMAS * sigma)
        });
        for (pixel, _) in run() {
            if let Some(depth) = self.depth.get_mut(*pixel as usize) {
                *depth = 0.0;
            }
        }
        (before - candidates.len()) as u32
    }

    fn flies(&self, pixel: usize, z: f32, most: f32) -> bool {
        let column = pixel % WIDTH;
        let jumps = |beside: Option<usize>| {
            let other = beside.and_then(|beside| self.depth.get(beside)).copied().unwrap_or(0.0);
            (other - z).abs() > most
        };
        let left = jumps(pixel.checked_sub(1).filter(|_| column > 0));
        let right = jumps(Some(pixel + 1).filter(|_| column + 1 < WIDTH));
        (left && right) || (jumps(pixel.checked_sub(WIDTH)) && jumps(Some(pixel + WIDTH)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::segment::scene::{depth_points, everything};

    fn left_over(of: impl Fn(usize, usize) -> f32) -> (Vec<usize>, u32) {
        let points = depth_points(of);
        let mut candidates = everything(points.len());
        let mut flying = FlyingPixels::new();
        let gone = flying.remove(&points, &mut candidates);
        assert!(flying.depth.iter().all(|z| *z == 0.0));
        (candidates.iter().map(|number| points.pixel()[*number as usize] as usize).collect(), gone)
    }

    #[test]
    fn what_flies_between_two_surfaces_goes_and_their_edges_stay() {
        // A plate at 1.5 m up to column 99, a wall at 2.5 m from column 101, and between them what no surface is: 480 pixels.
        let at = |u: usize, _: usize| match u {
            ..100 => 1.5,
            100 => 2.0,
            _ => 2.5,
        };
        let (left, gone) = left_over(at);
        assert_eq!(gone, 480);
        assert!(left.iter().all(|pixel| pixel % WIDTH != 100) && left.len() == PIXELS - 480);
    }

    #[test]
    fn a_pixel_next_to_a_shadow_and_off_the_surface_goes() {
        // The plate ends at column 100; column 100 trails off behind it by 20 cm; beyond is shadow.
        let (left, gone) = left_over(|u, _| {
            if u < 100 {
                2.0
            } else if u == 100 {
                2.2
            } else {
                0.0
            }
        });
        assert_eq!((left.len(), gone), (100 * 480, 480));
    }

    #[test]
    fn steep_surfaces_and_rims_stay() {
        // 75° from the normal: tan 75° / 580 of the depth from column to column, 0.64 %; 20 columns in no background.
        let (left, gone) =
            left_over(|u, _| if (300..320).contains(&u) { 2.0 + 0.0128 * (u - 300) as f32 } else { 0.0 });
        assert_eq!((left.len(), gone), (20 * 480, 0));
    }
}

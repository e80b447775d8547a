//! Flying pixels: depths between two surfaces, where one hides the other.

use crate::frame::{HEIGHT, WIDTH};
use crate::image::DepthImage;

/// A jump between neighbours at 2 m that no surface makes, m; it grows with the depth's square, as the steps of the
/// disparity do (11 mm at 2 m).
const JUMP_AT_2_M: f32 = 0.04;

/// The image without the pixels at jumps: those whose depth differs from that of a neighbour (left, right, above, below) by
/// more than 4 cm · (z/2 m)². Both sides of an edge go, and what flies between them; pixels without data (0) are no
/// neighbours. A surface that is seen at less than 80° from its normal stays, up to 4 m.
pub fn without_flying(depth: &DepthImage, out: &mut DepthImage) {
    let pixels = depth.pixels();
    let (rows, out_rows) = (pixels.chunks_exact(WIDTH), out.pixels_mut().chunks_exact_mut(WIDTH));
    let row = |v: usize| pixels.get(v * WIDTH..(v + 1) * WIDTH).unwrap_or(&[]);
    for ((v, here), out) in rows.enumerate().zip(out_rows) {
        let (above, below) = (if v > 0 { row(v - 1) } else { &[] }, if v + 1 < HEIGHT { row(v + 1) } else { &[] });
        for ((u, &z), out) in here.iter().enumerate().zip(out) {
            let most = JUMP_AT_2_M * 0.25 * z * z;
            let beside = [u.checked_sub(1).and_then(|u| here.get(u)), here.get(u + 1), above.get(u), below.get(u)];
            let jumps = beside.into_iter().flatten().any(|&other| other > 0.0 && (other - z).abs() > most);
            *out = if jumps { 0.0 } else { z };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn without(of: impl Fn(usize, usize) -> f32) -> DepthImage {
        let mut out = DepthImage::new();
        without_flying(&DepthImage::from_fn(of), &mut out);
        out
    }

    #[test]
    fn what_lies_between_two_surfaces_goes_with_both_edges() {
        // A plate at 1.5 m up to column 99, a wall at 2.5 m from column 101, and between them what no surface is.
        let at = |u: usize, _: usize| match u {
            ..100 => 1.5,
            100 => 2.0,
            _ => 2.5,
        };
        let out = without(at);
        for v in [0, 1, 240, 479] {
            assert_eq!([98, 99, 100, 101, 102].map(|u| out.at(u, v)), [1.5, 0.0, 0.0, 0.0, 2.5].map(Some));
        }
        assert_eq!(out.pixels().iter().filter(|z| **z == 0.0).count(), 3 * HEIGHT);
    }

    #[test]
    fn steep_surfaces_and_the_steps_of_far_ones_stay() {
        // A column is z/580 wide; at 75° from the normal it is tan 75° of that deeper than the one before: 0.64 % of z. From
        // 1 m on, where 10 mm are allowed, to 9 m.
        let mut along = vec![1.0f32];
        along.extend((1..WIDTH).scan(1.0f32, |z, u| {
            *z *= if u < 345 { 1.0064 } else { 1.0 };
            Some(*z)
        }));
        let steep = without(|u, _| along[u]);
        let stairs = without(|u, v| if (u + v) % 2 == 0 { 5.0 } else { 5.07 });
        assert!([steep, stairs].iter().all(|image| image.pixels().iter().all(|z| *z > 0.0)));
    }

    #[test]
    fn a_hole_is_no_jump() {
        let out = without(|u, v| if (u, v) == (10, 10) { 0.0 } else { 1.0 });
        assert_eq!(out.pixels().iter().filter(|z| **z == 0.0).count(), 1);
    }
}

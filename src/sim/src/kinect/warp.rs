//! A depth error nobody has modelled: a smooth surface over the image that grows while the device warms up.

use crate::kinect::parameters::KinectParameters;
use crate::noise::Noise;
use tumbled_kinect::{HEIGHT, WIDTH};
use tumbled_model::RigNs;

/// Terms xⁱ yʲ with i + j ≤ 3, by j then i.
const TERMS: [usize; 4] = [4, 3, 2, 1];

/// The surface at an instant.
#[derive(Clone, Debug)]
pub(super) struct Warp {
    /// Factors of the terms, m.
    factors: [[f64; 4]; 4],
}

/// The surface along a row: a cubic in the column.
#[derive(Clone, Copy, Debug)]
pub(super) struct WarpRow([f64; 4]);

impl Warp {
    /// The surface that `seed` draws for this device, at `t`: between its greatest and smallest value on the image the
    /// largest is [`KinectParameters::warp_m`] when warm.
    pub(super) fn new(parameters: &KinectParameters, seed: u64, name: &str, t: RigNs) -> Self {
        let mut noise = Noise::new(seed, name, 0);
        let mut shape = Self { factors: [[0.0; 4]; 4] };
        for (row, terms) in shape.factors.iter_mut().zip(TERMS) {
            for factor in row.iter_mut().take(terms) {
                *factor = noise.normal();
            }
        }
        let largest = (0..=32)
            .flat_map(|v| (0..=32).map(move |u| (u * WIDTH / 32, v * HEIGHT / 32)))
            .map(|(u, v)| shape.row(v).at(u).abs())
            .fold(f64::MIN_POSITIVE, f64::max);
        let seconds = (t.0 as f64 * 1e-9).max(0.0);
        let cold = parameters.warp_cold_share;
        let warmth = cold + (1.0 - cold) * (1.0 - libm::exp(-seconds / parameters.warp_warm_up_s));
        let scale = parameters.warp_m * warmth / largest;
        shape.factors.iter_mut().flatten().for_each(|factor| *factor *= scale);
        shape
    }

    pub(super) fn row(&self, v: usize) -> WarpRow {
        let y = v as f64 / (HEIGHT / 2) as f64 - 1.0;
        let mut powers = [0.0; 4];
        for terms in self.factors.iter().rev() {
            for (power, factor) in powers.iter_mut().zip(terms) {
                *power = *power * y + factor;
            }
        }
        WarpRow(powers)
    }
}

impl WarpRow {
    /// Depth to be added in a column, m.
    pub(super) fn at(&self, u: usize) -> f64 {
        let x = u as f64 / (WIDTH / 2) as f64 - 1.0;
        let [c0, c1, c2, c3] = self.0;
        c0 + x * (c1 + x * (c2 + x * c3))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn largest(t_s: i64) -> f64 {
        let warp = Warp::new(&KinectParameters::default(), 5, "warp", RigNs(t_s * 1_000_000_000));
        let places = (0..HEIGHT).step_by(4).flat_map(|v| (0..WIDTH).step_by(4).map(move |u| (u, v)));
        places.map(|(u, v)| warp.row(v).at(u).abs()).fold(0.0, f64::max)
    }

    #[test]
    fn the_surface_grows_to_five_millimetres() {
        // Cold 0.6 · 5 mm = 3 mm; after the time constant 5 · (0.6 + 0.4 · 0.632) = 4.264 mm; warm 5 mm. The grid on which
        // it is scaled and the one here differ: 1 %.
        for (seconds, expected) in [(0, 3.0e-3), (600, 4.264e-3), (86_400, 5.0e-3)] {
            let found = largest(seconds);
            assert!((found / expected - 1.0).abs() < 0.01, "{seconds} s: {found}");
        }
    }
}

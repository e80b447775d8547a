//! Numbers by seed.

use nalgebra::{Unit, Vector3, Vector6};

/// SplitMix64.
pub(crate) struct Chance(u64);

impl Chance {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// 0..1, never 0.
    pub(crate) fn share(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        (((z ^ (z >> 31)) >> 11) + 1) as f64 / (1u64 << 53) as f64
    }

    /// Of mean 0 and variance 1, by Box and Muller.
    pub(crate) fn normal(&mut self) -> f64 {
        let (length, angle) = (self.share(), core::f64::consts::TAU * self.share());
        libm::sqrt(-2.0 * libm::log(length)) * libm::cos(angle)
    }

    pub(crate) fn vector(&mut self) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal())
    }

    /// Six normal numbers of these standard deviations.
    pub(crate) fn twist(&mut self, sigma: &Vector6<f64>) -> Vector6<f64> {
        sigma.map(|sigma| sigma * self.normal())
    }

    pub(crate) fn direction(&mut self) -> Unit<Vector3<f64>> {
        Unit::new_normalize(self.vector())
    }
}

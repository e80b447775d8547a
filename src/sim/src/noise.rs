//! Random numbers by name and index: each packet, frame and fault has its own, whatever was made before it and on
//! whatever thread.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// A stream of random numbers.
#[derive(Clone, Debug)]
pub struct Noise {
    generator: ChaCha8Rng,
    /// The second of a pair of normal numbers.
    spare: Option<f64>,
}

impl Noise {
    /// The stream of `index` under `name` (e.g. `lidar.front.range`, the packet's number), for a scene's seed.
    pub fn new(seed: u64, name: &str, index: u64) -> Self {
        let mut key = [0; 32];
        let (head, tail) = key.split_at_mut(8);
        head.copy_from_slice(&seed.to_le_bytes());
        // FNV-1a, 64 bits: spreads names over the key; no secret is kept with it.
        let mut hash = 0xcbf2_9ce4_8422_2325_u64;
        for byte in name.bytes() {
            hash = (hash ^ u64::from(byte)).wrapping_mul(0x0000_0100_0000_01b3);
        }
        let (named, rest) = tail.split_at_mut(8);
        named.copy_from_slice(&hash.to_le_bytes());
        let (indexed, _) = rest.split_at_mut(8);
        indexed.copy_from_slice(&index.to_le_bytes());
        Self { generator: ChaCha8Rng::from_seed(key), spare: None }
    }

    /// Evenly over 0..2⁶⁴.
    pub fn bits(&mut self) -> u64 {
        self.generator.next_u64()
    }

    /// Evenly over 0..1, 53 bits.
    pub fn uniform(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Normal, mean 0, standard deviation 1 (Marsaglia's polar method).
    pub fn normal(&mut self) -> f64 {
        if let Some(spare) = self.spare.take() {
            return spare;
        }
        loop {
            let (u, v) = (2.0 * self.uniform() - 1.0, 2.0 * self.uniform() - 1.0);
            let s = u * u + v * v;
            if s > 0.0 && s < 1.0 {
                let scale = (-2.0 * libm::log(s) / s).sqrt();
                self.spare = Some(v * scale);
                return u * scale;
            }
        }
    }

    /// True with a probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.uniform() < probability
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_name_and_index_give_the_same_numbers_and_others_do_not() {
        let first = |seed, name, index| Noise::new(seed, name, index).bits();
        assert_eq!(first(1, "a", 2), first(1, "a", 2));
        let all = [first(1, "a", 2), first(2, "a", 2), first(1, "b", 2), first(1, "a", 3)];
        assert!((1..4).all(|n| all[n] != all[0]));
    }

    #[test]
    fn normal_numbers_are_normal() {
        const N: usize = 200_000;
        let mut noise = Noise::new(7, "normal", 0);
        let values: Vec<f64> = (0..N).map(|_| noise.normal()).collect();
        let moment = |k: i32| values.iter().map(|x| (0..k).fold(1.0, |p, _| p * x)).sum::<f64>() / N as f64;
        // Standard errors at N = 200,000: mean 0.0022, variance 0.0032, fourth moment 0.022; five of each.
        assert!(moment(1).abs() < 0.011 && (moment(2) - 1.0).abs() < 0.016 && (moment(4) - 3.0).abs() < 0.11);
        let beyond = values.iter().filter(|x| x.abs() > 1.96).count() as f64 / N as f64;
        assert!((beyond - 0.05).abs() < 0.0025, "{beyond}");
    }
}

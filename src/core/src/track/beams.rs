//! What each beam of a LiDAR measures too long, learned while it is tracked (method.md §7, 3c).

use nalgebra::{Point3, Vector3};

/// Beams at most: a laser's number is a byte.
const BEAMS: usize = 256;
/// What is known of a beam's bias beforehand: σ, m.
const PRIOR_M: f64 = 0.010;
/// How much of what was learned remains after each crossing.
const REMAINS: f64 = 0.998;
/// A crossing's returns share errors: each counts so much.
const SHARE: f64 = 0.25;
/// A residual greater than this, m, is no bias.
const MOST_M: f64 = 0.05;

/// Sums of one beam.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Evidence {
    /// Σ w ν (r + ν b).
    pull: f64,
    /// Σ w ν².
    weight: f64,
}

/// One point's say.
pub(super) struct Witness {
    pub(super) beam: u8,
    /// Distance from the model along the normal, after the correction, m.
    pub(super) residual_m: f64,
    /// The cosine of the normal to the ray: the share of a bias that shows.
    pub(super) cosine: f64,
    /// Of the range, m.
    pub(super) sigma_m: f64,
}

/// Biases of a LiDAR's beams.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct BeamBiases {
    sums: Vec<Evidence>,
}

impl BeamBiases {
    /// By how much a beam's ranges are too long, m: the estimate so far, 0 of a beam that said nothing yet.
    pub fn bias_m(&self, beam: u8) -> f64 {
        self.sums.get(usize::from(beam)).map_or(0.0, |sum| sum.pull / (sum.weight + 1.0 / (PRIOR_M * PRIOR_M)))
    }

    /// How well it is known: σ, m; 10 mm of a beam that said nothing yet.
    pub fn sigma_m(&self, beam: u8) -> f64 {
        let weight = self.sums.get(usize::from(beam)).map_or(0.0, |sum| sum.weight);
        1.0 / (weight + 1.0 / (PRIOR_M * PRIOR_M)).sqrt()
    }

    /// A return where it would be without its beam's bias.
    pub(crate) fn corrected(&self, point: &Point3<f64>, beam: u8, viewpoint: &Point3<f64>) -> Point3<f64> {
        let bias = self.bias_m(beam);
        match (point - viewpoint).try_normalize(1e-6) {
            Some(ray) if bias != 0.0 => point - ray * bias,
            _ => *point,
        }
    }

    /// What a crossing says, with the biases as they were when it was corrected.
    pub(super) fn weigh(&self, witnesses: impl Iterator<Item = Witness>) -> Vec<Evidence> {
        let mut crossing = vec![Evidence::default(); BEAMS];
        for Witness { beam, residual_m, cosine, sigma_m } in witnesses {
            if residual_m.abs() >= MOST_M {
                continue;
            }
            if let Some(sum) = crossing.get_mut(usize::from(beam)) {
                let weight = SHARE / (sigma_m * sigma_m);
                // The residual as it was before the correction: what is left after it alone would stop half way.
                sum.pull += weight * cosine * (residual_m + cosine * self.bias_m(beam));
                sum.weight += weight * cosine * cosine;
            }
        }
        crossing
    }

    /// Takes what a crossing said.
    pub(super) fn learn(&mut self, crossing: &[Evidence]) {
        if self.sums.len() < crossing.len() {
            self.sums.resize(crossing.len(), Evidence::default());
        }
        for (sum, new) in self.sums.iter_mut().zip(crossing) {
            sum.pull = (sum.pull + new.pull) * REMAINS;
            sum.weight = (sum.weight + new.weight) * REMAINS;
        }
    }
}

/// The cosine of a normal (rig axes) to the ray to a point.
pub(super) fn cosine(normal: &Vector3<f64>, point: &Point3<f64>, viewpoint: &Point3<f64>) -> f64 {
    (point - viewpoint).try_normalize(1e-6).map_or(0.0, |ray| ray.dot(normal))
}

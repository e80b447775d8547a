//! A sphere of known radius in one sensor's points: its centre with its covariance.
//!
//! A range sensor errs along its rays. So the centre is fitted to ranges: where a ray must meet the sphere against where it
//! was measured. Distances from the centre would be biased where rays graze the sphere.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::robust::{huber, scale};
use crate::view::Ranged;

/// Rays that meet the surface at a smaller cosine are left out: there a point is mixed with what is behind.
const LEAST_COSINE: f64 = 0.35;
/// Steps at most.
const STEPS: usize = 20;
/// A step below this is none, m.
const STILL_M: f64 = 1e-8;
/// A sphere's centre.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Centre {
    pub(super) at: Point3<f64>,
    /// m², scaled by what the residuals tell of the noise.
    pub(super) covariance: Matrix3<f64>,
    /// The points it is from.
    pub(super) points: Vec<Ranged>,
    /// Root mean square of their range errors, m.
    pub(super) rms_m: f64,
}

/// Range along a ray to the sphere, and the cosine of incidence; `None`: it passes by.
fn meets(centre: &Point3<f64>, radius_m: f64, ray: &Vector3<f64>) -> Option<(f64, f64)> {
    let along = ray.dot(&centre.coords);
    let inside = radius_m * radius_m - centre.coords.norm_squared() + along * along;
    let root = (inside > 0.0).then(|| inside.sqrt())?;
    Some((along - root, root / radius_m))
}

/// How much farther than the sphere a point was measured, m, with the cosine; `None`: its ray grazes or passes by.
pub(super) fn beyond_m(centre: &Point3<f64>, radius_m: f64, ranged: &Ranged) -> Option<(f64, f64)> {
    let (range, cosine) = meets(centre, radius_m, &ranged.ray())?;
    (cosine > LEAST_COSINE).then(|| (ranged.point.coords.norm() - range, cosine))
}

/// Fits a centre to points near a start; `gate_m`: farther along their rays they are of something else.
pub(super) fn fit(points: &[Ranged], radius_m: f64, start: &Point3<f64>, gate_m: f64) -> Option<Centre> {
    let mut centre = *start;
    let mut information = Matrix3::zeros();
    let mut used: Vec<(Ranged, f64, f64)> = Vec::new();
    for _ in 0..STEPS {
        used = points
            .iter()
            .filter_map(|ranged| {
                let (beyond, cosine) = beyond_m(&centre, radius_m, ranged)?;
                (beyond.abs() < gate_m).then_some((*ranged, beyond, cosine))
            })
            .collect();
        if used.len() < 10 {
            return None;
        }
        let mut residuals: Vec<f64> = used.iter().map(|(ranged, beyond, _)| beyond / ranged.sigma_m).collect();
        let noise = scale(&mut residuals);
        information = Matrix3::zeros();
        let mut toward = Vector3::zeros();
        for (ranged, beyond, cosine) in &used {
            let ray = ranged.ray();
            let met = ray * (ranged.point.coords.norm() - beyond);
            // The sphere's outward normal where the ray meets it: a range grows with the centre along it, by 1/cosine.
            let slope = (met - centre.coords) / (radius_m * -cosine);
            let sigma = ranged.sigma_m * noise;
            let weight = huber(beyond / sigma) / (sigma * sigma);
            information += slope * slope.transpose() * weight;
            toward += slope * (beyond * weight);
        }
        let step = information.try_inverse()? * toward;
        if !step.iter().all(|number| number.is_finite()) {
            return None;
        }
        // No farther than a part of the sphere at once: the sphere is far from linear.
        let length = step.norm();
        centre += step * (0.5 * radius_m / length.max(0.5 * radius_m));
        if length < STILL_M {
            break;
        }
    }
    let count = used.len() as f64;
    let rms_m = (used.iter().map(|(_, beyond, _)| beyond * beyond).sum::<f64>() / count).sqrt();
    let points = used.into_iter().map(|(ranged, ..)| ranged).collect();
    Some(Centre { at: centre, covariance: information.try_inverse()?, points, rms_m })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rays from the origin to a sphere, each measured too near and too far by an error.
    fn seen(centre: [f64; 3], radius_m: f64, error_m: f64) -> Vec<Ranged> {
        let centre = Point3::from(centre);
        let mut points = Vec::new();
        for row in -30..=30 {
            for column in -30..=30 {
                let ray = Vector3::new(f64::from(column) * 0.008, f64::from(row) * 0.008, 1.0).normalize();
                let Some((range, _)) = meets(&centre, radius_m, &ray) else { continue };
                for error in [-error_m, error_m] {
                    points.push(Ranged { point: Point3::from(ray * (range + error)), sigma_m: 0.02 });
                }
            }
        }
        points
    }

    #[test]
    fn range_noise_does_not_move_the_centre() {
        let points = seen([0.1, -0.05, 2.0], 0.25, 0.02);
        let centre = fit(&points, 0.25, &Point3::new(0.05, 0.0, 1.9), 0.2).expect("a centre");
        assert!((centre.at - Point3::new(0.1, -0.05, 2.0)).norm() < 2e-4, "{}", centre.at);
        assert!((centre.rms_m - 0.02).abs() < 1e-3);
    }
}

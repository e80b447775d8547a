//! All spheres at once: centres onto centres, each pair with its covariance.

use nalgebra::{Isometry3, Matrix3, Point3, SMatrix, SVector, Translation3, Vector3};
use tumbled_model::se3::exp_rotation;

use crate::board::inverse;
use crate::fit::{Covariance, Fit, PARAMETERS, Unsolved, rotation_onto};

/// The least pairs that fix a place.
pub const LEAST_POSES: usize = 4;
/// Gauss–Newton steps at most.
const STEPS: usize = 12;
const STILL: f64 = 1e-9;
/// A pair agrees with a place within this distance, m.
const AGREES_M: f64 = 0.05;

/// A sphere's centre as both sensors have it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CentrePair {
    /// In the camera's frame.
    pub camera: Point3<f64>,
    /// m².
    pub camera_covariance: Matrix3<f64>,
    /// In the LiDAR's frame.
    pub lidar: Point3<f64>,
    /// m².
    pub lidar_covariance: Matrix3<f64>,
}

/// Points onto points by least squares.
fn place(pairs: &[&CentrePair]) -> Option<Isometry3<f64>> {
    let count = pairs.len().max(1) as f64;
    let mean =
        |of: &dyn Fn(&CentrePair) -> Vector3<f64>| pairs.iter().map(|pair| of(pair)).sum::<Vector3<f64>>() / count;
    let (from, to) = (mean(&|pair| pair.camera.coords), mean(&|pair| pair.lidar.coords));
    let ways: Vec<(Vector3<f64>, Vector3<f64>)> =
        pairs.iter().map(|pair| (pair.camera.coords - from, pair.lidar.coords - to)).collect();
    let rotation = rotation_onto(ways.iter().map(|(a, b)| (a, b, 1.0)))?;
    Some(Isometry3::from_parts(Translation3::from(to - rotation * from), rotation))
}

/// A start without a guess, and which pairs agree with it: of every three pairs that fix a place, the one that most agree with.
pub(super) fn closed_form(pairs: &[CentrePair]) -> Result<(Isometry3<f64>, Vec<bool>), Unsolved> {
    if pairs.len() < LEAST_POSES {
        return Err(Unsolved::TooFew { found: pairs.len(), least: LEAST_POSES });
    }
    let off = |pair: &CentrePair, t: &Isometry3<f64>| (t * pair.camera - pair.lidar).norm();
    let mut best: Option<(usize, f64, Isometry3<f64>)> = None;
    let mut spanned = false;
    let some: Vec<&CentrePair> = pairs.iter().take(40).collect();
    for (n, a) in some.iter().enumerate() {
        for (m, b) in some.iter().enumerate().skip(n + 1) {
            for c in some.iter().skip(m + 1) {
                // Twice the triangle's area: three places on a line fix no rotation.
                if (b.camera - a.camera).cross(&(c.camera - a.camera)).norm() < 0.04 {
                    continue;
                }
                spanned = true;
                let Some(t) = place(&[a, b, c]) else { continue };
                let agreeing = pairs.iter().map(|pair| off(pair, &t)).filter(|off| *off < AGREES_M);
                let (count, sum) = agreeing.fold((0, 0.0), |(count, sum), off| (count + 1, sum + off));
                if best.is_none_or(|(most, least, _)| count > most || (count == most && sum < least)) {
                    best = Some((count, sum, t));
                }
            }
        }
    }
    let Some((count, _, t)) = best else {
        return Err(if spanned { Unsolved::NoConsensus } else { Unsolved::Degenerate });
    };
    if count < LEAST_POSES || 2 * count <= pairs.len() {
        return Err(Unsolved::NoConsensus);
    }
    let inside: Vec<bool> = pairs.iter().map(|pair| off(pair, &t) < AGREES_M).collect();
    let agreeing: Vec<&CentrePair> =
        pairs.iter().zip(&inside).filter(|(_, inside)| **inside).map(|(pair, _)| pair).collect();
    Ok((place(&agreeing).unwrap_or(t), inside))
}

/// Solves for pairs from a start: `Σ eᵀ (Σ_L + R Σ_C Rᵀ)⁻¹ e`, `e = R c + t − l`.
pub(super) fn solve(pairs: &[CentrePair], start: &Isometry3<f64>) -> Result<Fit, Unsolved> {
    if pairs.len() < LEAST_POSES {
        return Err(Unsolved::TooFew { found: pairs.len(), least: LEAST_POSES });
    }
    let mut t = *start;
    let mut squares = Vec::new();
    let mut covariance = Covariance::zeros();
    for _ in 0..STEPS {
        let mut information = Covariance::zeros();
        let mut gradient = SVector::<f64, PARAMETERS>::zeros();
        // The scale is not solved for: a parameter that is known exactly.
        information.fixed_view_mut::<1, 1>(6, 6).fill(1.0);
        squares.clear();
        let turn = t.rotation.to_rotation_matrix().into_inner();
        for pair in pairs {
            let both = pair.lidar_covariance + turn * pair.camera_covariance * turn.transpose();
            let weight = both.try_inverse().ok_or(Unsolved::Degenerate)?;
            let turned = turn * pair.camera.coords;
            let off = turned + t.translation.vector - pair.lidar.coords;
            let mut rows = SMatrix::<f64, 3, PARAMETERS>::zeros();
            rows.fixed_view_mut::<3, 3>(0, 0).copy_from(&-turned.cross_matrix());
            rows.fixed_view_mut::<3, 3>(0, 3).copy_from(&Matrix3::identity());
            information += rows.transpose() * weight * rows;
            gradient += rows.transpose() * weight * off;
            squares.push(off.dot(&(weight * off)));
        }
        covariance = inverse(&information)?;
        let step = -(covariance * gradient);
        t.rotation = exp_rotation(&step.fixed_rows::<3>(0).into()) * t.rotation;
        t.translation.vector += step.fixed_rows::<3>(3);
        if step.norm() < STILL {
            break;
        }
    }
    covariance.row_mut(6).fill(0.0);
    covariance.column_mut(6).fill(0.0);
    let fit = Fit {
        t_lidar_camera: t,
        depth_scale: None,
        covariance,
        chi_square: squares.iter().sum(),
        freedom: (3 * pairs.len()).saturating_sub(6),
        misfits: squares.iter().map(|square| (square / 3.0).sqrt()).collect(),
    };
    let factor = fit.variance_factor();
    Ok(Fit { covariance: fit.covariance * factor, ..fit })
}

//! A start without a guess: normals onto normals, then distances; by the three boards that most others agree with.

use nalgebra::{Isometry3, Matrix3, Translation3, Vector3};

use crate::fit::{Unsolved, rotation_onto};
use crate::plane::Plane;

/// A board agrees with a place of the sensors if its planes do within this angle, rad (3°), and this distance, m.
const AGREES: (f64, f64) = (3.0 / 180.0 * core::f64::consts::PI, 0.06);
/// Three normals span space at least by this determinant.
const LEAST_VOLUME: f64 = 0.005;

/// The place of the camera in the LiDAR's frame by planes that both see, and which of them agree with it.
///
/// # Errors
/// [`Unsolved`]: fewer than three, all alike, or no three that agree.
pub(super) fn closed_form(pairs: &[(Plane, Plane)]) -> Result<(Isometry3<f64>, Vec<bool>), Unsolved> {
    if pairs.len() < super::joint::LEAST_POSES {
        return Err(Unsolved::TooFew { found: pairs.len(), least: super::joint::LEAST_POSES });
    }
    let mut best: Option<(usize, f64, Isometry3<f64>)> = None;
    let mut spanned = false;
    for (a, b, c) in triples(pairs.len()) {
        let three: Vec<&(Plane, Plane)> = [a, b, c].iter().filter_map(|n| pairs.get(*n)).collect();
        let normals: Vec<Vector3<f64>> = three.iter().map(|(camera, _)| camera.normal).collect();
        if Matrix3::from_columns(&normals).determinant().abs() < LEAST_VOLUME {
            continue;
        }
        spanned = true;
        let Some(t) = place(three.iter().copied()) else { continue };
        let agreeing = pairs.iter().filter(|pair| agrees(pair, &t));
        let (count, off) = agreeing.fold((0, 0.0), |(count, off), pair| {
            let (angle, distance) = apart(pair, &t);
            (count + 1, off + angle / AGREES.0 + distance / AGREES.1)
        });
        if best.is_none_or(|(most, least, _)| count > most || (count == most && off < least)) {
            best = Some((count, off, t));
        }
    }
    let Some((count, _, t)) = best else {
        return Err(if spanned { Unsolved::NoConsensus } else { Unsolved::Degenerate });
    };
    // Of three boards that were used all three agree if the sensors see the same planes at all; of four a fourth must.
    if count < super::joint::LEAST_POSES || (pairs.len() > 3 && 2 * count <= pairs.len()) {
        return Err(Unsolved::NoConsensus);
    }
    let inside: Vec<bool> = pairs.iter().map(|pair| agrees(pair, &t)).collect();
    let refined = place(pairs.iter().zip(&inside).filter(|(_, inside)| **inside).map(|(pair, _)| pair));
    Ok((refined.unwrap_or(t), inside))
}

/// Every three of so many; of more than 40 those of the first 40.
fn triples(count: usize) -> impl Iterator<Item = (usize, usize, usize)> {
    let count = count.min(40);
    (0..count).flat_map(move |a| (a + 1..count).flat_map(move |b| (b + 1..count).map(move |c| (a, b, c))))
}

/// `R` by the normals; `t` by `m·t = e − d`.
fn place<'a>(pairs: impl Iterator<Item = &'a (Plane, Plane)> + Clone) -> Option<Isometry3<f64>> {
    let rotation = rotation_onto(pairs.clone().map(|(camera, lidar)| (&camera.normal, &lidar.normal, 1.0)))?;
    let (mut scatter, mut toward) = (Matrix3::zeros(), Vector3::zeros());
    for (camera, lidar) in pairs {
        scatter += lidar.normal * lidar.normal.transpose();
        toward += lidar.normal * (lidar.distance_m - camera.distance_m);
    }
    let translation = scatter.try_inverse()? * toward;
    Some(Isometry3::from_parts(Translation3::from(translation), rotation))
}

/// How far a board's planes are apart at a place: angle, rad, and distance, m.
fn apart((camera, lidar): &(Plane, Plane), t: &Isometry3<f64>) -> (f64, f64) {
    let m = t.rotation * camera.normal;
    let distance = camera.distance_m + m.dot(&t.translation.vector) - lidar.distance_m;
    (libm::atan2(m.cross(&lidar.normal).norm(), m.dot(&lidar.normal)), distance.abs())
}

fn agrees(pair: &(Plane, Plane), t: &Isometry3<f64>) -> bool {
    let (angle, distance) = apart(pair, t);
    angle < AGREES.0 && distance < AGREES.1
}

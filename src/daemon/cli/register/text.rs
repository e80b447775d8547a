//! A registration for people.

use nalgebra::{Isometry3, Matrix3, Vector3};
use tumbled_core::register::{Cloud, Registration};
use tumbled_model::se3::{log_rotation, skew};

use super::report::RegisterReport;
use crate::experiment::trial::centroid;

pub(super) fn text(report: &RegisterReport, found: &Registration, moving: &Cloud) -> String {
    let RegisterReport { method, moving: m, reference: r, .. } = report;
    let mut text = format!(
        "{method}: {} {} points onto {} {} points in {:.1} ms\n",
        m.points, m.sensor, r.points, r.sensor, report.time_ms
    );
    let pose = &found.t_reference_moving;
    let [x, y, z] = report.t_reference_moving.translation_m;
    let [qx, qy, qz, qw] = report.t_reference_moving.rotation_xyzw;
    let (turn, at) = (log_rotation(&pose.rotation), pose * centroid(moving));
    let axis = turn.try_normalize(1e-12).unwrap_or_else(Vector3::zeros);
    let sigma = Sigmas::of(found, &at.coords);
    text.push_str(&format!("  translation  {x:.4} {y:.4} {z:.4} m\n"));
    text.push_str(&format!("  rotation     {qx:.6} {qy:.6} {qz:.6} {qw:.6} (x y z w)\n"));
    let (degrees, [ax, ay, az]) = (turn.norm().to_degrees(), <[f64; 3]>::from(axis));
    text.push_str(&format!("               {degrees:.2} deg about {ax:.3} {ay:.3} {az:.3}\n"));
    text.push_str(&format!(
        "  uncertainty  ±{:.2} deg, ±{:.1} mm at the moving cloud's centroid (one standard deviation of the whole)\n",
        sigma.rotation_deg, sigma.position_mm
    ));
    text.push_str(&format!(
        "  fit          {:.0} % of the sparser cloud's points on the surface, {:.1} mm r.m.s., score {:.3}\n",
        100.0 * report.inliers,
        1e3 * report.rmse_m,
        report.score
    ));
    match &report.reason {
        None => text.push_str("accepted: it may be used as a measurement\n"),
        Some(reason) => text.push_str(&format!("NOT accepted, the best candidate only: {reason}\n")),
    }
    if !report.alternatives.is_empty() {
        text.push_str(&format!(
            "this pose {:.0} %; other poses that explain the clouds:\n",
            100.0 * report.probability
        ));
    }
    for mode in &found.alternatives {
        let (degrees, metres) = apart(pose, &mode.t_reference_moving, moving);
        text.push_str(&format!(
            "  {:.0} %, score {:.3}: turned by {degrees:.1} deg against it, centroid {:.0} mm away\n",
            100.0 * mode.probability,
            mode.score,
            1e3 * metres
        ));
    }
    text
}

/// Standard deviations for people.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sigmas {
    /// About all axes together.
    pub(super) rotation_deg: f64,
    /// Along all axes together.
    pub(super) position_mm: f64,
}

impl Sigmas {
    /// Of a pose, and of the place `at` it takes the moving cloud's centroid to: with `Exp(ξ)` that moves by θ × at + ρ.
    pub(super) fn of(found: &Registration, at: &Vector3<f64>) -> Self {
        let block = |row, column| -> Matrix3<f64> { found.covariance.fixed_view::<3, 3>(row, column).into() };
        let (turn, cross, shift) = (block(0, 0), block(0, 3), block(3, 3));
        let lever = -skew(at);
        let place = lever * turn * lever.transpose() + lever * cross + cross.transpose() * lever.transpose() + shift;
        Self {
            rotation_deg: turn.trace().max(0.0).sqrt().to_degrees(),
            position_mm: 1e3 * place.trace().max(0.0).sqrt(),
        }
    }
}

/// The turn between two poses, degrees, and how far apart they put the cloud's centroid, m.
fn apart(a: &Isometry3<f64>, b: &Isometry3<f64>, cloud: &Cloud) -> (f64, f64) {
    let centre = centroid(cloud);
    (tumbled_model::se3::angle_between(&a.rotation, &b.rotation).to_degrees(), (a * centre - b * centre).norm())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix6;
    use tumbled_core::register::Registration;
    use tumbled_model::se3::adjoint;

    /// A pose known to 0.01 rad and 1 mm about a point 3 m away: at the origin the turn makes 3 cm of it.
    #[test]
    fn the_position_is_as_sure_at_the_centroid_as_it_was_found_there() {
        let at = Vector3::new(3.0, 0.0, 0.0);
        let there = Matrix6::from_diagonal(&[1e-4, 1e-4, 1e-4, 1e-6, 1e-6, 1e-6].into());
        let moved = adjoint(&Isometry3::translation(at.x, at.y, at.z));
        let found = Registration {
            t_reference_moving: Isometry3::identity(),
            covariance: moved * there * moved.transpose(),
            accepted: true,
            doubts: Vec::new(),
            score: 1.0,
            gap: None,
            probability: 1.0,
            inliers: 1.0,
            rmse_m: 0.0,
            weakest: (Default::default(), 1.0),
            iterations: 1,
            alternatives: Vec::new(),
        };
        let sigma = Sigmas::of(&found, &at);
        let (turn, place) = (3f64.sqrt() * 0.01f64.to_degrees(), 3f64.sqrt());
        assert!((sigma.rotation_deg - turn).abs() < 1e-9 && (sigma.position_mm - place).abs() < 1e-6, "{sigma:?}");
        assert!(Sigmas::of(&found, &Vector3::zeros()).position_mm > 40.0);
    }
}

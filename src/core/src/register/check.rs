//! Which clouds are fit to be registered.

use super::{Cloud, Prior, RegisterError};
use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

/// Fewer finite points are refused.
const LEAST_POINTS: usize = 10;
/// Extents of targets, m: smaller ones the sensors cannot resolve, larger ones come of wrong units.
const SIZES_M: core::ops::RangeInclusive<f64> = 0.05..=50.0;
/// Second largest to largest variance below which a cloud is a line.
const LINE: f64 = 1e-3;

/// The finite points of a cloud that may be registered, and where they are.
#[derive(Clone, Debug)]
pub(crate) struct CheckedPoints {
    /// Finite, m, in the cloud's frame and order.
    pub(crate) points: Vec<Point3<f32>>,
    /// Their centroid, m.
    pub(crate) centroid: Point3<f64>,
    /// Their covariance about it, m².
    pub(crate) covariance: Matrix3<f64>,
    /// Root mean square distance from it, m.
    pub(crate) radius_m: f64,
}

/// The finite points of a cloud. `name` is `moving` or `reference`.
///
/// # Errors
/// Too few points, an impossible size, a line.
pub(crate) fn check_cloud(cloud: &Cloud, name: &'static str) -> Result<CheckedPoints, RegisterError> {
    let finite = |point: &&Point3<f32>| point.iter().all(|number| number.is_finite());
    let points: Vec<Point3<f32>> = cloud.points.iter().filter(finite).copied().collect();
    if points.len() < LEAST_POINTS {
        return Err(RegisterError::TooFewPoints { cloud: name, found: points.len(), needed: LEAST_POINTS });
    }
    let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    let mut sum = Vector3::zeros();
    for point in &points {
        let at: Vector3<f64> = point.coords.cast();
        (low, high, sum) = (low.inf(&at), high.sup(&at), sum + at);
    }
    let size_m = (high - low).max();
    if !SIZES_M.contains(&size_m) {
        return Err(RegisterError::Size { cloud: name, size_m });
    }
    let count = points.len() as f64;
    let centroid = Point3::from(sum / count);
    let mut covariance = Matrix3::zeros();
    for point in &points {
        let offset = point.cast::<f64>() - centroid;
        covariance += offset * offset.transpose();
    }
    covariance /= count;
    let mut variances: [f64; 3] = SymmetricEigen::new(covariance).eigenvalues.into();
    variances.sort_by(f64::total_cmp);
    let [_, second, largest] = variances;
    if second < LINE * largest {
        return Err(RegisterError::Collinear { cloud: name });
    }
    Ok(CheckedPoints { points, centroid, covariance, radius_m: covariance.trace().sqrt() })
}

/// Whether a prior is one: finite, with spreads above 0.
///
/// # Errors
/// What is wrong with it.
pub(crate) fn check_prior(prior: &Prior) -> Result<(), RegisterError> {
    let pose = &prior.t_reference_moving;
    if !pose.translation.vector.iter().chain(pose.rotation.coords.iter()).all(|number| number.is_finite()) {
        return Err(RegisterError::Prior { what: "a number that is not finite" });
    }
    if (pose.rotation.norm() - 1.0).abs() > 1e-6 {
        return Err(RegisterError::Prior { what: "a quaternion that is not of length 1" });
    }
    let positive = |sigma: f64| sigma > 0.0 && sigma.is_finite();
    if !(positive(prior.sigma_rotation_rad) && positive(prior.sigma_translation_m)) {
        return Err(RegisterError::Prior { what: "a standard deviation that is not above 0" });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::register::{SensorKind, View};
    use nalgebra::Isometry3;

    fn cloud(points: Vec<Point3<f32>>) -> Cloud {
        Cloud { sensor: SensorKind::Lidar, points, viewpoint: None, view: View::Bare }
    }

    /// 27 points of a cube of the given edge about (0, 0, 3 edges).
    fn cube(edge: f32) -> Vec<Point3<f32>> {
        let at = |n: u32| (n % 3) as f32 * 0.5 * edge;
        (0..27).map(|n| Point3::new(at(n), at(n / 3), at(n / 9) + 2.5 * edge)).collect()
    }

    #[test]
    fn a_cloud_is_its_finite_points() {
        let mut points = cube(1.0);
        points.push(Point3::new(f32::NAN, 0.0, 0.0));
        points.push(Point3::new(0.0, f32::INFINITY, 0.0));
        let checked = check_cloud(&cloud(points), "moving").expect("27 points");
        assert_eq!(checked.points.len(), 27);
        assert!((checked.centroid - Point3::new(0.5, 0.5, 3.0)).norm() < 1e-7);
        // Per axis two of three at ±½: variance ⅙; √½ in all.
        assert!((checked.radius_m - 0.5f64.sqrt()).abs() < 1e-7);
    }

    #[test]
    fn what_is_no_cloud_is_refused_with_the_reason() {
        let refused = |points| check_cloud(&cloud(points), "moving").expect_err("no cloud");
        assert_eq!(refused(vec![]), RegisterError::TooFewPoints { cloud: "moving", found: 0, needed: 10 });
        assert_eq!(
            refused(cube(1.0)[..3].into()),
            RegisterError::TooFewPoints { cloud: "moving", found: 3, needed: 10 }
        );
        let nans = vec![Point3::new(f32::NAN, 0.0, 0.0); 40];
        assert_eq!(refused(nans), RegisterError::TooFewPoints { cloud: "moving", found: 0, needed: 10 });
        assert_eq!(refused(cube(1000.0)), RegisterError::Size { cloud: "moving", size_m: 1000.0 });
        assert!(matches!(refused(cube(0.01)), RegisterError::Size { .. }));
        let line = (0..30).map(|n| Point3::new(n as f32 * 0.1, 1.0, 2.0)).collect();
        assert_eq!(refused(line), RegisterError::Collinear { cloud: "moving" });
    }

    #[test]
    fn a_prior_is_finite_a_rotation_and_has_a_spread() {
        let good =
            Prior { t_reference_moving: Isometry3::identity(), sigma_rotation_rad: 0.1, sigma_translation_m: 0.1 };
        assert_eq!(check_prior(&good), Ok(()));
        let mut far = good;
        far.t_reference_moving.translation.x = f64::NAN;
        let sure = Prior { sigma_rotation_rad: 0.0, ..good };
        let mut long = good;
        long.t_reference_moving.rotation =
            nalgebra::UnitQuaternion::new_unchecked(nalgebra::Quaternion::new(2.0, 0.0, 0.0, 0.0));
        for bad in [far, sure, long] {
            assert!(matches!(check_prior(&bad), Err(RegisterError::Prior { .. })), "{bad:?}");
        }
    }
}

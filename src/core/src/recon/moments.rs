//! Running sums of points, and the plane through them.

use crate::surface::least_eigenvector;
use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

/// Σ w, Σ w p, Σ w p pᵀ about a place near the points, so that squares stay small.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moments {
    about: Point3<f64>,
    weight: f64,
    sum: Vector3<f64>,
    square: [f64; 6],
    pub(super) count: usize,
}

/// The plane of some moments.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fitted {
    /// Unit, of either sign.
    pub(super) normal: Vector3<f64>,
    pub(super) centroid: Point3<f64>,
    /// c_p = 2 (λ₂ − λ₃) / Σλ, 0..=1: 1 of a disc, 0 of a line and of a ball.
    pub(super) planarity: f64,
}

impl Moments {
    pub(super) fn about(place: &Point3<f64>) -> Self {
        Self { about: *place, weight: 0.0, sum: Vector3::zeros(), square: [0.0; 6], count: 0 }
    }

    pub(super) fn add(&mut self, place: &Point3<f64>, weight: f64) {
        let offset = place - self.about;
        let [x, y, z] = offset.into();
        self.weight += weight;
        self.sum += offset * weight;
        for (entry, term) in self.square.iter_mut().zip([x * x, x * y, x * z, y * y, y * z, z * z]) {
            *entry += term * weight;
        }
        self.count += 1;
    }

    /// Of the points' scatter about their middle, m².
    fn covariance(&self) -> [f64; 6] {
        let share = 1.0 / self.weight.max(f64::MIN_POSITIVE);
        let [x, y, z] = (self.sum * share).into();
        let mut covariance = self.square;
        for (entry, mean) in covariance.iter_mut().zip([x * x, x * y, x * z, y * y, y * z, z * z]) {
            *entry = *entry * share - mean;
        }
        covariance
    }

    /// The plane; `noise`: variance of the points, m², which is taken from every eigenvalue before the shape is judged.
    pub(super) fn plane(&self, noise: f64) -> Option<Fitted> {
        if self.count < 3 || self.weight <= 0.0 {
            return None;
        }
        let (eigenvalues, normal) = least_eigenvector(self.covariance());
        let [l3, l2, l1] = eigenvalues.map(|value| (value - noise).max(0.0));
        let total = l1 + l2 + l3;
        let planarity = if total > 0.0 { 2.0 * (l2 - l3) / total } else { 0.0 };
        Some(Fitted { normal, centroid: self.about + self.sum / self.weight, planarity })
    }

    /// The two directions of most scatter, that of the most first, and the scatter in them, m²; a right-handed frame with the
    /// normal as its third axis.
    pub(super) fn tangents(&self, normal: &Vector3<f64>) -> [(Vector3<f64>, f64); 2] {
        let [xx, xy, xz, yy, yz, zz] = self.covariance();
        let matrix = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        let eigen = SymmetricEigen::new(matrix);
        let most = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
        let along = most - normal * most.dot(normal);
        let aside = if normal.x.abs() < 0.6 { Vector3::x() } else { Vector3::y() };
        let mut first = along.try_normalize(1e-6).unwrap_or_else(|| normal.cross(&aside).normalize());
        // Of a definite sign: an eigenvector has none.
        if first.iter().find(|c| c.abs() > 1e-3).is_some_and(|c| *c < 0.0) {
            first = -first;
        }
        let second = normal.cross(&first);
        let scatter = |axis: &Vector3<f64>| axis.dot(&(matrix * axis)).max(0.0);
        [(first, scatter(&first)), (second, scatter(&second))]
    }
}

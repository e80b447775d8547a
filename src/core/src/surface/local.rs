//! Mean, normal and curvature of a neighbourhood.

use crate::neighbours::Neighbourhood;
use nalgebra::Vector3;
use wide::f32x4;

/// Largest curvature, 1/m: a radius of 12.5 cm (method.md §2.3).
const SHARPEST: f64 = 8.0;
/// Curvature counts where it exceeds so many of its own standard deviations.
const SIGNIFICANT: f64 = 3.0;

/// Sums of N numbers of every member: single precision is enough for a few offsets that are as long as each other.
#[inline(always)]
fn sums<const N: usize>(near: &Neighbourhood<'_>, of: impl Fn([f32x4; 3], f32x4) -> [f32x4; N]) -> [f64; N] {
    let mut sums = [f32x4::ZERO; N];
    for (offset, is_member) in near.members() {
        for (sum, value) in sums.iter_mut().zip(of(offset, is_member)) {
            *sum += value;
        }
    }
    sums.map(|sum| {
        let [a, b, c, d] = sum.to_array().map(f64::from);
        (a + b) + (c + d)
    })
}

/// What was fitted. Places are offsets from the point whose neighbourhood it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Local {
    pub(crate) mean: Vector3<f64>,
    /// Unit; its sign is arbitrary.
    pub(crate) normal: Vector3<f64>,
    /// On the fitted sphere: below the mean on the normal.
    pub(crate) foot: Vector3<f64>,
    /// At the foot, positive where the normal points away from the centre.
    pub(crate) curvature: f64,
    /// Of the covariance, rising, m².
    pub(crate) eigenvalues: [f64; 3],
    /// Mean square distance from the fit, corrected for what was fitted, m².
    pub(crate) residual: f64,
    pub(crate) members: u32,
}

impl Local {
    /// Fits a plane, and a sphere where curvature stands out from the residuals. Without points: a plane along z.
    pub(crate) fn fit(near: &Neighbourhood<'_>, curved: bool) -> Self {
        let [n, x, y, z, xx, xy, xz, yy, yz, zz] = sums(near, |[x, y, z], is_member| {
            [f32x4::ONE & is_member, x, y, z, x * x, x * y, x * z, y * y, y * z, z * z]
        });
        let share = 1.0 / n.max(1.0);
        let [mx, my, mz] = [x, y, z].map(|sum| sum * share);
        let means = [mx * mx, mx * my, mx * mz, my * my, my * mz, mz * mz];
        let mut covariance = [xx, xy, xz, yy, yz, zz];
        for (entry, mean) in covariance.iter_mut().zip(means) {
            *entry = *entry * share - mean;
        }
        let mean = Vector3::new(mx, my, mz);
        let (eigenvalues, normal) = least_eigenvector(covariance);
        let [l3, ..] = eigenvalues;
        let plane = l3 * n / (n.max(4.0) - 3.0);
        let flat = Self { mean, normal, foot: mean, curvature: 0.0, eigenvalues, residual: plane, members: n as u32 };
        if curved { flat.bent(near) } else { flat }
    }

    /// With the curvature that least squares of heights against ½ρ² find, if it stands out (method.md §2.3).
    fn bent(self, near: &Neighbourhood<'_>) -> Self {
        let n = f64::from(self.members);
        if n < 6.0 {
            return self;
        }
        let [mx, my, mz] = <[f64; 3]>::from(self.mean).map(|c| f32x4::splat(c as f32));
        let [nx, ny, nz] = <[f64; 3]>::from(self.normal).map(|c| f32x4::splat(c as f32));
        let [rr, r4, hr] = sums(near, |[x, y, z], is_member| {
            let (x, y, z) = (x - mx, y - my, z - mz);
            let height = nx * x + ny * y + nz * z;
            let square = (x * x + y * y + z * z - height * height) & is_member;
            [square, square * square, height * square]
        });
        // Heights have no mean: Σh(ρ² − ρ̄²) = Σhρ².
        let (mean_square, scatter) = (rr / n, r4 - rr * rr / n);
        if scatter <= 1e-18 {
            return self;
        }
        let a = -2.0 * hr / scatter;
        let explained = 0.25 * a * a * scatter;
        let [l3, ..] = self.eigenvalues;
        let residual = (l3 * n - explained).max(0.0) / (n - 4.0);
        let sigma = (4.0 * residual / scatter).sqrt();
        if a.abs() <= SIGNIFICANT * sigma || a == 0.0 {
            return self;
        }
        let a = a.clamp(-SHARPEST, SHARPEST);
        Self { curvature: a, foot: self.mean + self.normal * (0.5 * a * mean_square), residual, ..self }
    }
}

/// Eigenvalues, rising, and the unit eigenvector of the least of a covariance (xx, xy, xz, yy, yz, zz). Where it is not
/// unique one of them: of no spread at all z.
pub(crate) fn least_eigenvector([xx, xy, xz, yy, yz, zz]: [f64; 6]) -> ([f64; 3], Vector3<f64>) {
    let trace = xx + yy + zz;
    if trace.is_nan() || trace <= 1e-30 {
        return ([0.0; 3], Vector3::z());
    }
    let scale = 1.0 / trace;
    let [xx, xy, xz, yy, yz, zz] = [xx, xy, xz, yy, yz, zz].map(|c| c * scale);
    // λ³ − λ² + c₁λ − c₀ of the matrix of trace 1. Newton's steps from 0 rise to the least root and never pass it.
    let c1 = xx * yy - xy * xy + xx * zz - xz * xz + yy * zz - yz * yz;
    let c0 = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz);
    let mut least = 0.0;
    for _ in 0..40 {
        let value = ((least - 1.0) * least + c1) * least - c0;
        let slope = (3.0 * least - 2.0) * least + c1;
        let step = if slope > 0.0 { -value / slope } else { 0.0 };
        // Rounding alone makes it fall.
        if step <= 1e-15 {
            break;
        }
        least += step;
    }
    // The other two: their sum is 1 − λ, their product c₁ − λ(1 − λ).
    let (sum, product) = (1.0 - least, c1 - least * (1.0 - least));
    let root = (0.25 * sum * sum - product).max(0.0).sqrt();
    let (middle, most) = ((0.5 * sum - root).max(least), 0.5 * sum + root);
    let rows = [Vector3::new(xx - least, xy, xz), Vector3::new(xy, yy - least, yz), Vector3::new(xz, yz, zz - least)];
    ([least * trace, middle * trace, most * trace], perpendicular(&rows))
}

/// The unit vector at right angles to three vectors of one plane; of one line: some vector across it.
fn perpendicular([a, b, c]: &[Vector3<f64>; 3]) -> Vector3<f64> {
    let crosses = [a.cross(b), a.cross(c), b.cross(c)];
    let longer = |best: Vector3<f64>, next: &Vector3<f64>| {
        if next.norm_squared() > best.norm_squared() { *next } else { best }
    };
    let best = crosses.iter().fold(Vector3::zeros(), longer);
    if let Some(normal) = best.try_normalize(1e-9) {
        return normal;
    }
    let along = [a, b, c].into_iter().fold(Vector3::zeros(), longer);
    let Some(along) = along.try_normalize(1e-12) else { return Vector3::z() };
    // Across the line, as near to z as can be (to x where the line is z).
    let start = if along.z.abs() < 0.9 { Vector3::z() } else { Vector3::x() };
    (start - along * along.dot(&start)).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix3;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_eigenvector_is_one(entries in proptest::array::uniform9(-1.0..1.0f64), flat in 0.0..1.0f64) {
            let a = Matrix3::from_row_slice(&entries);
            let stretch = Matrix3::from_diagonal(&Vector3::new(1.0, 0.5, flat * flat));
            let c = a * stretch * a.transpose() * 1e-3;
            prop_assume!(c.trace() > 1e-9);
            let (values, normal) = least_eigenvector([c.m11, c.m12, c.m13, c.m22, c.m23, c.m33]);
            // C n = λ n, to the accuracy of the eigenvalues of a cubic: the root of rounding where two are equal.
            prop_assert!((c * normal - normal * values[0]).norm() < 1e-7 * c.trace());
            prop_assert!((normal.norm() - 1.0).abs() < 1e-12);
            let mut expected: Vec<f64> = c.symmetric_eigenvalues().iter().copied().collect();
            expected.sort_by(f64::total_cmp);
            for (found, expected) in values.iter().zip(expected) {
                prop_assert!((found - expected).abs() < 1e-7 * c.trace());
            }
        }
    }

    #[test]
    fn points_on_a_line_have_a_normal_across_it() {
        let along = Vector3::new(0.6, 0.0, 0.8);
        let points: Vec<_> = (0..10).map(|k| nalgebra::Point3::from((along * (f64::from(k) * 0.01)).cast())).collect();
        crate::neighbours::each_knn(&points, 10, |near| {
            // Sums in single precision: 6e-8 of the largest entry, times the ten of them, on a spread that is 1.
            assert!(Local::fit(near, true).normal.dot(&along).abs() < 1e-3);
        });
    }
}

//! Mean, normal and curvature of a neighbourhood.

use nalgebra::Vector3;

/// Largest curvature, 1/m: a radius of 12.5 cm (method.md §2.3).
const SHARPEST: f64 = 8.0;
/// Curvature counts where it exceeds so many of its own standard deviations.
const SIGNIFICANT: f64 = 3.0;

/// Sums are kept in so many lanes, and added up in their order.
const LANES: usize = 4;

/// Points of a neighbourhood, from the point whose neighbourhood it is, m: column by column.
#[derive(Clone, Debug, Default)]
pub(crate) struct Members {
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
}

impl Members {
    pub(crate) fn clear(&mut self) {
        self.x.clear();
        self.y.clear();
        self.z.clear();
    }

    pub(crate) fn push(&mut self, offset: Vector3<f32>) {
        let offset = offset.cast::<f64>();
        self.x.push(offset.x);
        self.y.push(offset.y);
        self.z.push(offset.z);
    }

    fn len(&self) -> usize {
        self.x.len()
    }

    /// Sums of N numbers of every member.
    #[inline]
    fn sums<const N: usize>(&self, of: impl Fn([f64; 3]) -> [f64; N]) -> [f64; N] {
        let mut lanes = [[0.0; N]; LANES];
        let (x, y, z) = (self.x.as_chunks::<LANES>(), self.y.as_chunks::<LANES>(), self.z.as_chunks::<LANES>());
        let add = |sums: &mut [f64; N], place: [f64; 3]| {
            for (sum, value) in sums.iter_mut().zip(of(place)) {
                *sum += value;
            }
        };
        for ((x, y), z) in x.0.iter().zip(y.0).zip(z.0) {
            for (((sums, &x), &y), &z) in lanes.iter_mut().zip(x).zip(y).zip(z) {
                add(sums, [x, y, z]);
            }
        }
        for (((sums, &x), &y), &z) in lanes.iter_mut().zip(x.1).zip(y.1).zip(z.1) {
            add(sums, [x, y, z]);
        }
        let [mut all, b, c, d] = lanes;
        for (((a, b), c), d) in all.iter_mut().zip(b).zip(c).zip(d) {
            *a = (*a + b) + (c + d);
        }
        all
    }
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
    pub(crate) fn fit(members: &Members, curved: bool) -> Self {
        let n = members.len();
        let share = 1.0 / n.max(1) as f64;
        let [mx, my, mz] = members.sums(|place| place).map(|sum| sum * share);
        let products = members.sums(|[x, y, z]| {
            let (x, y, z) = (x - mx, y - my, z - mz);
            [x * x, x * y, x * z, y * y, y * z, z * z]
        });
        let mean = Vector3::new(mx, my, mz);
        let (eigenvalues, normal) = least_eigenvector(products.map(|sum| sum * share));
        let [l3, ..] = eigenvalues;
        let plane = l3 * n as f64 / (n.max(4) - 3) as f64;
        let flat = Self { mean, normal, foot: mean, curvature: 0.0, eigenvalues, residual: plane, members: n as u32 };
        if curved { flat.bent(members) } else { flat }
    }

    /// With the curvature that least squares of heights against ½ρ² find, if it stands out (method.md §2.3).
    fn bent(self, members: &Members) -> Self {
        let n = f64::from(self.members);
        if n < 6.0 {
            return self;
        }
        let (mean, normal) = (self.mean, self.normal);
        let [rr, r4, hr] = members.sums(|[x, y, z]| {
            let (x, y, z) = (x - mean.x, y - mean.y, z - mean.z);
            let height = normal.x * x + normal.y * y + normal.z * z;
            let square = x * x + y * y + z * z - height * height;
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
        let mut members = Members::default();
        (0..10).for_each(|k| members.push((along * (f64::from(k) * 0.01)).cast()));
        assert!(Local::fit(&members, true).normal.dot(&along).abs() < 1e-6);
    }
}

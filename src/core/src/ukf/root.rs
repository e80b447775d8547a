//! A covariance as rows of deviations: `P = Σ rowᵀ row`. It can be neither negative nor asymmetric.
//!
//! Any rows may be put together to one matrix and turned to a triangle by one orthogonal transformation: no covariance is
//! ever subtracted. Columns lie together in memory, and products are sums over columns in a fixed order: the library's
//! product of large matrices picks its instructions by the processor, and with them its rounding.

use nalgebra::{DMatrix, SMatrix};

/// A covariance's root: upper triangular with a diagonal that is nowhere negative.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Root(DMatrix<f64>);

impl Root {
    /// Of independent states with these standard deviations.
    pub(super) fn diagonal(sigmas: &[f64]) -> Self {
        Self(DMatrix::from_diagonal(&nalgebra::DVector::from_column_slice(sigmas)))
    }

    /// Of the covariance that these rows make: at least as many rows as columns.
    pub(super) fn of(rows: DMatrix<f64>) -> Self {
        Self(triangle(rows))
    }

    /// Of the first so many states alone.
    pub(super) fn leading(&self, states: usize) -> Self {
        let states = states.min(self.0.ncols()).min(self.0.nrows());
        Self(self.0.view((0, 0), (states, states)).into_owned())
    }

    /// The triangle.
    pub(super) fn rows(&self) -> &DMatrix<f64> {
        &self.0
    }

    /// A block of the covariance.
    pub(super) fn covariance<const R: usize, const C: usize>(&self, row: usize, column: usize) -> SMatrix<f64, R, C> {
        product(&self.0, row, &self.0, column)
    }

    /// Three states' deviations twice as wide, their correlations with the others kept.
    pub(super) fn scale(&mut self, first: usize, by: f64) {
        let mut columns = self.0.columns_mut(first, 3);
        columns *= by;
    }

    /// With independent deviations added to three states from each of `firsts` on.
    pub(super) fn widen(&mut self, firsts: &[(usize, f64)]) {
        let width = self.0.ncols();
        let mut rows = self.0.clone().resize_vertically(width + 3 * firsts.len(), 0.0);
        for ((first, sigma), block) in firsts.iter().zip(0..) {
            for axis in 0..3 {
                put(&mut rows, width + 3 * block + axis, first + axis, *sigma);
            }
        }
        self.0 = triangle(rows);
    }

    /// Whether all is finite, and no state's variance zero unless it began so.
    pub(super) fn is_sound(&self, known: &[bool]) -> bool {
        self.0.iter().all(|value| value.is_finite())
            && known.iter().enumerate().all(|(state, known)| *known || entry(&self.0, state, state) > 0.0)
    }
}

/// One entry; 0 beyond the matrix.
pub(super) fn entry(matrix: &DMatrix<f64>, row: usize, column: usize) -> f64 {
    matrix.get((row, column)).copied().unwrap_or_default()
}

/// Sets one entry; beyond the matrix there is none.
pub(super) fn put(matrix: &mut DMatrix<f64>, row: usize, column: usize, value: f64) {
    if let Some(entry) = matrix.get_mut((row, column)) {
        *entry = value;
    }
}

/// `Aᵀ B` of some columns of two matrices of one height.
pub(super) fn product<const R: usize, const C: usize>(
    a: &DMatrix<f64>,
    row: usize,
    b: &DMatrix<f64>,
    column: usize,
) -> SMatrix<f64, R, C> {
    SMatrix::from_fn(|i, j| a.column(row + i).dot(&b.column(column + j)))
}

/// Adds to three columns of `onto` the deviations of three columns of `from` after a linear map.
pub(super) fn add_mapped(
    onto: &mut DMatrix<f64>,
    into: usize,
    from: &DMatrix<f64>,
    first: usize,
    map: &nalgebra::Matrix3<f64>,
) {
    for (i, row) in map.row_iter().enumerate() {
        for (k, factor) in row.iter().enumerate() {
            onto.column_mut(into + i).axpy(*factor, &from.column(first + k), 1.0);
        }
    }
}

/// The triangle R of a matrix's QR factors by Householder's reflections, its diagonal nowhere negative.
pub(super) fn triangle(mut rows: DMatrix<f64>) -> DMatrix<f64> {
    let (height, width) = rows.shape();
    let mut rest = rows.as_mut_slice();
    for done in 0..width.min(height) {
        let (pivot, others) = rest.split_at_mut(height);
        if let Some(pivot) = pivot.get_mut(done..) {
            reflect(pivot, others.chunks_exact_mut(height).filter_map(|column| column.get_mut(done..)));
        }
        rest = others;
    }
    let mut triangle = rows.resize_vertically(width, 0.0);
    triangle.fill_lower_triangle(0.0, 1);
    for row in 0..width {
        if entry(&triangle, row, row) < 0.0 {
            triangle.row_mut(row).neg_mut();
        }
    }
    triangle
}

/// Turns the first column onto its first axis, and the others with it.
fn reflect<'a>(pivot: &mut [f64], others: impl Iterator<Item = &'a mut [f64]>) {
    // Below the last entry that is not zero nothing changes.
    let Some(last) = pivot.iter().rposition(|value| *value != 0.0) else { return };
    let Some(pivot) = pivot.get_mut(..=last) else { return };
    let length = libm::sqrt(dot(pivot, pivot));
    let Some(head) = pivot.first().copied() else { return };
    let onto = if head > 0.0 { -length } else { length };
    if let Some(first) = pivot.first_mut() {
        *first = head - onto;
    }
    // 2/vᵀv, v = x − onto e₁.
    let scale = 1.0 / (length * (length + head.abs()));
    for column in others {
        let along = scale * dot(pivot, column);
        for (value, direction) in column.iter_mut().zip(pivot.iter()) {
            *value -= along * direction;
        }
    }
    if let Some(first) = pivot.first_mut() {
        *first = onto;
    }
}

/// Sum of products in four strands: an order that the compiler can keep in one register.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (fours, others) = (a.chunks_exact(4), b.chunks_exact(4));
    let (tail, other_tail) = (fours.remainder(), b.get(a.len() - a.len() % 4..).unwrap_or_default());
    for (x, y) in fours.zip(others) {
        for ((sum, x), y) in sums.iter_mut().zip(x).zip(y) {
            *sum += x * y;
        }
    }
    let [p, q, r, s] = sums;
    (p + q) + (r + s) + tail.iter().zip(other_tail).map(|(x, y)| x * y).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_triangle_has_the_covariance_of_its_rows(values in proptest::collection::vec(-1.0..1.0f64, 9 * 6)) {
            let rows = DMatrix::from_column_slice(9, 6, &values);
            let root = Root::of(rows.clone());
            prop_assert!((root.covariance::<6, 6>(0, 0) - product::<6, 6>(&rows, 0, &rows, 0)).norm() < 1e-13);
            for row in 0..6 {
                prop_assert!(root.rows()[(row, row)] >= 0.0);
                prop_assert!((0..row).all(|column| root.rows()[(row, column)] == 0.0));
            }
        }
    }

    #[test]
    fn widening_adds_variances_and_keeps_correlations() {
        let mut root = Root::of(DMatrix::from_row_slice(3, 3, &[2.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0]));
        let before = root.covariance::<3, 3>(0, 0);
        root.widen(&[(0, 3.0)]);
        let added = root.covariance::<3, 3>(0, 0) - before;
        assert!((added - nalgebra::Matrix3::identity() * 9.0).norm() < 1e-12, "{added}");
    }

    #[test]
    fn states_that_are_known_stay_known() {
        let root = Root::of(DMatrix::from_row_slice(3, 2, &[2.0, 0.0, 1.0, 0.0, 2.0, 0.0]));
        assert_eq!(root.rows(), &DMatrix::from_row_slice(2, 2, &[3.0, 0.0, 0.0, 0.0]));
        assert!(root.is_sound(&[false, true]) && !root.is_sound(&[false, false]));
    }
}

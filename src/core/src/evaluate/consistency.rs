//! Whether errors are as large as they are said to be.

use super::Covariance;
use super::chi_square::mean_bounds;
use nalgebra::SVector;

/// An estimate's error, truth less estimate, in the order of its covariance.
pub(super) type Error12 = SVector<f64, 12>;

/// How errors compare with their covariances.
#[derive(Clone, Debug, PartialEq)]
pub struct Consistency {
    /// Mean of the normalised square of pose, velocity and angular velocity: 12 if the covariances are right.
    pub nees12: NormalisedMean,
    /// Mean of the normalised square of the pose alone: 6 if they are right.
    pub nees6: NormalisedMean,
    /// By state, in the covariance's order: stated standard deviation over r.m.s. error, 1 if it is right. Infinite where
    /// there was no error.
    pub sigma_over_rms: [f64; 12],
    /// What that is of, for figures over several runs: the stated variances' mean and the squared errors' mean, by state.
    pub variance: [f64; 12],
    /// See [`Self::variance`].
    pub square: [f64; 12],
    /// Estimates whose covariance was no covariance; they are in none of the others.
    pub not_positive: u32,
}

/// A mean of normalised squares.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalisedMean {
    /// The mean; its expectation is the number of degrees of freedom.
    pub mean: f64,
    /// Where it lies in 95 of 100 cases if the covariances are right.
    pub bounds: (f64, f64),
    /// How many estimates it is of.
    pub count: u32,
}

impl NormalisedMean {
    /// Of values with this many degrees of freedom, of which `independent` (one at least) tell something new. `None`: no value.
    pub(super) fn of(values: impl Iterator<Item = f64>, freedom: u32, independent: u32) -> Option<Self> {
        let (sum, count) = values.fold((0.0, 0u32), |(sum, count), value| (sum + value, count + 1));
        let bounds = mean_bounds(freedom, independent.clamp(1, count.max(1)));
        (count > 0).then(|| Self { mean: sum / f64::from(count), bounds, count })
    }
}

/// The normalised squares of one error: of all twelve, and of the pose's six. `None`: the covariance is none.
pub(super) fn normalised(error: &Error12, covariance: &Covariance) -> Option<(f64, f64)> {
    let twelve = covariance.cholesky()?.solve(error).dot(error);
    let pose = error.fixed_rows::<6>(0).into_owned();
    let six = covariance.fixed_view::<6, 6>(0, 0).into_owned().cholesky()?.solve(&pose).dot(&pose);
    (twelve.is_finite() && six.is_finite()).then_some((twelve, six))
}

/// Of errors with their covariances; `None`: no estimate has one.
pub(super) fn consistency<'a>(
    pairs: impl Iterator<Item = (&'a Error12, &'a Covariance)> + Clone,
    independent: u32,
) -> Option<Consistency> {
    let found: Vec<_> = pairs.map(|(error, covariance)| (error, covariance, normalised(error, covariance))).collect();
    let values = || found.iter().filter_map(|(_, _, values)| *values);
    let nees12 = NormalisedMean::of(values().map(|(twelve, _)| twelve), 12, independent)?;
    let nees6 = NormalisedMean::of(values().map(|(_, six)| six), 6, independent)?;
    let (mut variances, mut squares) = (Error12::zeros(), Error12::zeros());
    for (error, covariance, _) in found.iter().filter(|(_, _, values)| values.is_some()) {
        variances += covariance.diagonal();
        squares += error.component_mul(error);
    }
    let mut sigma_over_rms = [0.0; 12];
    for (to, (variance, square)) in sigma_over_rms.iter_mut().zip(variances.iter().zip(&squares)) {
        *to = libm::sqrt(variance / square);
    }
    let mean = |sums: &Error12| core::array::from_fn(|row| sums[row] / f64::from(nees12.count));
    let (variance, square) = (mean(&variances), mean(&squares));
    let not_positive = found.len() as u32 - nees12.count;
    Some(Consistency { nees12, nees6, sigma_over_rms, variance, square, not_positive })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A covariance with correlations: L Lᵀ, and errors L u with |u|² = 12.
    fn root() -> Covariance {
        Covariance::from_fn(|row, column| match row.cmp(&column) {
            core::cmp::Ordering::Less => 0.0,
            core::cmp::Ordering::Equal => 0.01 * (row + 1) as f64,
            core::cmp::Ordering::Greater => 0.002 * (row as f64 - 1.5 * column as f64),
        })
    }

    fn signs(n: usize) -> Error12 {
        Error12::from_fn(|row, _| if (n >> (row % 4)) & 1 == 0 { 1.0 } else { -1.0 })
    }

    #[test]
    fn errors_of_one_sigma_in_every_direction_have_a_mean_of_their_number() {
        let covariance = root() * root().transpose();
        let errors: Vec<Error12> = (0..16).map(|n| root() * signs(n)).collect();
        let found = consistency(errors.iter().map(|error| (error, &covariance)), 16).expect("some");
        // u has twelve components of ±1; its first six are the pose's, L being triangular.
        assert!((found.nees12.mean - 12.0).abs() < 1e-9 && (found.nees6.mean - 6.0).abs() < 1e-9, "{found:?}");
        assert_eq!((found.nees12.count, found.not_positive), (16, 0));
        assert_eq!(found.nees12.bounds, mean_bounds(12, 16));
    }

    #[test]
    fn twice_the_stated_sigma_is_a_ratio_of_a_half_and_four_times_the_square() {
        let covariance = Covariance::from_diagonal_element(1e-4);
        let errors: Vec<Error12> = (0..16).map(|n| signs(n) * 0.02).collect();
        let found = consistency(errors.iter().map(|error| (error, &covariance)), 4).expect("some");
        assert!((found.nees12.mean - 48.0).abs() < 1e-9);
        assert!(found.sigma_over_rms.iter().all(|ratio| (ratio - 0.5).abs() < 1e-12));
        // 0.01² was stated, and 0.02² it is.
        let is = |found: &[f64; 12], expected: f64| found.iter().all(|mean| (mean / expected - 1.0).abs() < 1e-12);
        assert!(is(&found.variance, 1e-4) && is(&found.square, 4e-4));
        // Too large by far, and said so.
        assert!(found.nees12.mean > found.nees12.bounds.1);
    }

    #[test]
    fn what_is_no_covariance_is_counted_and_left_out() {
        let (good, bad) = (Covariance::identity(), Covariance::zeros());
        let error = signs(0);
        let found = consistency([(&error, &good), (&error, &bad)].into_iter(), 1).expect("one");
        assert_eq!((found.nees12.count, found.not_positive), (1, 1));
        assert_eq!(consistency([(&error, &bad)].into_iter(), 1), None);
    }
}

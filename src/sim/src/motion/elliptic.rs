//! Jacobi's amplitude, by arithmetic and geometric means (Abramowitz and Stegun, 16.4 and 17.6).

/// Means are taken until they agree to the last digit: quadratic, so ten are plenty down to 1 − m = 1e-24.
const MEANS: usize = 10;

/// The amplitude am(τ | m) for one parameter m, 0 ≤ m < 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Amplitude {
    /// cₙ/aₙ for n = 1, 2, …
    ratios: [f64; MEANS],
    /// 2ᴺ·aₙ at the last.
    scale: f64,
    /// A quarter of sn's period.
    pub(super) quarter: f64,
}

impl Amplitude {
    /// By the complement 1 − m, which keeps its digits where m is almost 1.
    pub(super) fn new(complement: f64) -> Self {
        let (mut a, mut b, mut scale) = (1.0, complement.sqrt(), 1.0);
        let ratios = [(); MEANS].map(|()| {
            let (mean, c) = ((a + b) / 2.0, (a - b) / 2.0);
            b = (a * b).sqrt();
            a = mean;
            scale *= 2.0;
            c / a
        });
        Self { ratios, scale: scale * a, quarter: core::f64::consts::FRAC_PI_2 / a }
    }

    pub(super) fn at(&self, tau: f64) -> f64 {
        let last = self.scale * tau;
        self.ratios.iter().rev().fold(last, |angle, ratio| (angle + libm::asin(ratio * libm::sin(angle))) / 2.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::FRAC_PI_2;

    #[test]
    fn without_a_parameter_the_amplitude_is_the_argument() {
        let amplitude = Amplitude::new(1.0);
        assert!((amplitude.quarter - FRAC_PI_2).abs() < 1e-15);
        assert!([-3.0, 0.0, 0.5, 7.0].iter().all(|tau| (amplitude.at(*tau) - tau).abs() < 1e-14));
    }

    #[test]
    fn a_quarter_period_is_the_complete_integral() {
        // K(m) from tables (Abramowitz and Stegun, table 17.1): m = 0.5 and m = 0.9.
        assert!((Amplitude::new(0.5).quarter - 1.854_074_677_301_372).abs() < 1e-14);
        assert!((Amplitude::new(0.1).quarter - 2.578_092_113_348_173).abs() < 1e-14);
        for complement in [0.9, 0.5, 0.1, 1e-6, 1e-20] {
            let amplitude = Amplitude::new(complement);
            assert!((amplitude.at(amplitude.quarter) - FRAC_PI_2).abs() < 1e-9, "{complement}");
        }
    }

    #[test]
    fn the_amplitude_grows_by_dn() {
        for complement in [0.8, 0.3, 1e-4] {
            let amplitude = Amplitude::new(complement);
            for k in -20..20 {
                let tau = f64::from(k) * 0.37;
                let sin = libm::sin(amplitude.at(tau));
                let dn = (1.0 - (1.0 - complement) * sin * sin).sqrt();
                let slope = (amplitude.at(tau + 1e-5) - amplitude.at(tau - 1e-5)) / 2e-5;
                assert!((slope - dn).abs() < 1e-8, "{complement} {tau}: {slope} {dn}");
            }
        }
    }
}

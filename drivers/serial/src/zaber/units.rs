//! Counts and velocity data, and what they mean in radians and seconds.

use core::f64::consts::TAU;
use tumbled_model::Span;

/// Velocity data per count a second (protocol manual, "units": 16 384 data units are 10 000 counts a second).
const DATA_PER_RATE: f64 = 1.6384;

/// The units of a stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Scale {
    counts_per_turn: u32,
    resolution_counts: u32,
}

impl Scale {
    /// Counts of a full turn, as `limit.cycle.dist` says or a config overrides for a stage behind a gear; and the step
    /// of the encoder in the same counts (1 where it is not known to be coarser). `None` where either is 0.
    pub const fn new(counts_per_turn: u32, resolution_counts: u32) -> Option<Self> {
        if counts_per_turn == 0 || resolution_counts == 0 {
            return None;
        }
        Some(Self { counts_per_turn, resolution_counts })
    }

    /// Counts of a full turn.
    pub const fn counts_per_turn(self) -> u32 {
        self.counts_per_turn
    }

    /// The step of the encoder, counts.
    pub const fn resolution_counts(self) -> u32 {
        self.resolution_counts
    }

    /// The angle of a position, rad, not wrapped: a stage that turns on counts on.
    pub fn angle_rad(self, counts: i64) -> f64 {
        // Whole turns and the rest apart, so that a month of turning costs no digits of the angle within the turn.
        let turn = i64::from(self.counts_per_turn);
        let (turns, rest) = (counts.div_euclid(turn), counts.rem_euclid(turn));
        TAU * turns as f64 + TAU * (rest as f64 / turn as f64)
    }

    /// The position nearest to an angle, counts; the ends of the range where it lies beyond, 0 for no number.
    pub fn counts(self, angle_rad: f64) -> i64 {
        (angle_rad / TAU * f64::from(self.counts_per_turn)).round() as i64
    }

    /// The position an encoder shows at an angle: the nearest of its own steps, counts.
    pub fn encoder_counts(self, angle_rad: f64) -> i64 {
        let step = i64::from(self.resolution_counts);
        let steps = angle_rad / TAU * f64::from(self.counts_per_turn) / step as f64;
        (steps.round() as i64).saturating_mul(step)
    }

    /// The rate of velocity data, rad/s.
    pub fn rate_rps(self, data: i64) -> f64 {
        data as f64 / DATA_PER_RATE / f64::from(self.counts_per_turn) * TAU
    }

    /// The velocity data of a rate.
    pub fn velocity_data(self, rate_rps: f64) -> i64 {
        (rate_rps / TAU * f64::from(self.counts_per_turn) * DATA_PER_RATE).round() as i64
    }

    /// How far an angle may be off, rad, one standard deviation: the encoder's step, and what the stage turned in the
    /// time that the sample's instant is uncertain, both evenly spread (step²/12 + (rate · half round trip)²/3).
    pub fn sigma_rad(self, rate_rps: f64, half_rtt: Span) -> f64 {
        let step = TAU * f64::from(self.resolution_counts) / f64::from(self.counts_per_turn);
        let turned = rate_rps * half_rtt.as_secs_f64();
        (step * step / 12.0 + turned * turned / 3.0).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STAGE: Scale = Scale { counts_per_turn: 768_000, resolution_counts: 1 };

    #[test]
    fn counts_are_turns() {
        // 1 066 667 / 768 000 turn = 500.0002°.
        assert!((STAGE.angle_rad(1_066_667).to_degrees() - 500.0).abs() < 2e-4);
        assert_eq!(STAGE.counts(500.0_f64.to_radians()), 1_066_667);
        assert!((STAGE.angle_rad(-192_000).to_degrees() + 90.0).abs() < 1e-12);
        assert!(Scale::new(0, 1).is_none() && Scale::new(1, 0).is_none());
    }

    #[test]
    fn five_degrees_a_second_are_17476_data_units() {
        // 5/360 · 768 000 = 10 666.67 counts/s; · 1.6384 = 17 476.3.
        assert_eq!(STAGE.velocity_data(5.0_f64.to_radians()), 17_476);
        assert!((STAGE.rate_rps(17_476).to_degrees() - 5.0).abs() < 1e-4);
    }

    #[test]
    fn two_milliseconds_at_five_degrees_a_second_are_six_thousandths_of_a_degree() {
        // 5 °/s · 2 ms / √3 = 0.00577°; the step of 0.00047° / √12 adds nothing one sees.
        let sigma = STAGE.sigma_rad(5.0_f64.to_radians(), Span::from_micros(2_000)).to_degrees();
        assert!((sigma - 0.005_77).abs() < 1e-5, "{sigma}");
    }

    #[test]
    fn a_coarse_encoder_shows_its_own_steps() {
        let coarse = Scale { resolution_counts: 100, ..STAGE };
        let angle = |counts: f64| TAU * counts / 768_000.0;
        assert_eq!(coarse.encoder_counts(angle(149.0)), 100);
        assert_eq!(coarse.encoder_counts(angle(151.0)), 200);
        assert_eq!(STAGE.encoder_counts(angle(151.4)), 151);
    }
}

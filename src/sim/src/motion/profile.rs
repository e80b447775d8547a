//! How far a stage has turned at any instant.

use core::f64::consts::TAU;
use tumbled_model::{RigNs, Span};

/// A stage's turning over the session, in closed form: the angle is 0 at the session's start, and counts turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Profile {
    /// The same rate throughout, before the session's start too.
    Constant {
        /// rad/s.
        rate_rps: f64,
    },
    /// One rate, then another, with an even change between.
    Ramp {
        /// The rate before, rad/s.
        from_rps: f64,
        /// The rate after, rad/s.
        to_rps: f64,
        /// When the change begins.
        begins: RigNs,
        /// How long it takes; 0 or less: at once.
        lasts: Span,
    },
    /// Runs and stops in turn, a stop first.
    StopAndGo {
        /// The rate of a run between its ramps, rad/s.
        rate_rps: f64,
        /// A stop's length.
        stop: Span,
        /// A run's length, ramps included.
        go: Span,
        /// The length of the speeding up at a run's begin, and of the slowing down at its end.
        ramp: Span,
    },
    /// Moves of the same angle with a rest before each, and after the last.
    Steps {
        /// A move's angle, rad.
        step_rad: f64,
        /// A rest's length.
        rest: Span,
        /// A move's length, ramps included.
        moving: Span,
        /// The length of the speeding up at a move's begin, and of the slowing down at its end.
        ramp: Span,
        /// Moves in all.
        count: u32,
    },
    /// At each rate forwards by an angle and back again, with a rest before each move; then it stays.
    BothWays {
        /// The rates between a move's ramps, rad/s; one that is 0 is left out.
        rates_rps: [f64; 3],
        /// A move's angle, rad.
        turn_rad: f64,
        /// A rest's length.
        rest: Span,
        /// The length of the speeding up at a move's begin, and of the slowing down at its end.
        ramp: Span,
    },
    /// To and fro about an even turning, in its middle at the session's start.
    Sinusoid {
        /// The even turning, rad/s.
        mean_rps: f64,
        /// How far to either side, rad.
        amplitude_rad: f64,
        /// The time from one middle to the next but one; 0 or less: no swing.
        period: Span,
    },
}

/// A stage's angle and rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turn {
    /// rad, not wrapped.
    pub angle_rad: f64,
    /// rad/s.
    pub rate_rps: f64,
}

impl Profile {
    /// The angle and rate at an instant.
    pub fn at(&self, t: RigNs) -> Turn {
        let seconds = super::seconds(t);
        match *self {
            Self::Constant { rate_rps } => Turn { angle_rad: rate_rps * seconds, rate_rps },
            Self::Ramp { from_rps, to_rps, begins, lasts } => {
                let gone = Span(t.0.saturating_sub(begins.0)).as_secs_f64();
                let whole = lasts.as_secs_f64().max(0.0);
                let change = to_rps - from_rps;
                let (more_rps, more_rad) = if gone <= 0.0 {
                    (0.0, 0.0)
                } else if gone < whole {
                    (change * gone / whole, change * gone * gone / (2.0 * whole))
                } else {
                    (change, change * (gone - whole / 2.0))
                };
                Turn { angle_rad: from_rps * seconds + more_rad, rate_rps: from_rps + more_rps }
            }
            Self::StopAndGo { rate_rps, stop, go, ramp } => {
                let ramp = within(ramp, go);
                moves(t, rate_rps * Span(go.0.max(0) - ramp.0).as_secs_f64(), stop, go, ramp, u32::MAX)
            }
            Self::Steps { step_rad, rest, moving, ramp, count } => {
                moves(t, step_rad, rest, moving, within(ramp, moving), count)
            }
            Self::BothWays { rates_rps, turn_rad, rest, ramp } => both_ways(seconds, rates_rps, turn_rad, rest, ramp),
            Self::Sinusoid { mean_rps, amplitude_rad, period } => {
                let even = Turn { angle_rad: mean_rps * seconds, rate_rps: mean_rps };
                if period.0 <= 0 {
                    return even;
                }
                // Reduced in whole nanoseconds: the phase is as exact in the last hour as in the first.
                let (sin, cos) = libm::sincos(TAU * (t.0.rem_euclid(period.0) as f64 / period.0 as f64));
                Turn {
                    angle_rad: even.angle_rad + amplitude_rad * sin,
                    rate_rps: even.rate_rps + amplitude_rad * TAU / period.as_secs_f64() * cos,
                }
            }
        }
    }
}

/// Speeding up and slowing down have half a move each, at most.
fn within(ramp: Span, moving: Span) -> Span {
    Span(ramp.0.clamp(0, moving.0.max(0) / 2))
}

/// `count` moves of an angle, each after a rest, all of one shape: speeding up evenly, at one rate, slowing down.
fn moves(t: RigNs, step_rad: f64, rest: Span, moving: Span, ramp: Span, count: u32) -> Turn {
    let (rest, moving) = (rest.0.max(0), moving.0.max(1));
    let period = rest.saturating_add(moving);
    let done = t.0.max(0) / period;
    if t.0 <= 0 || done >= i64::from(count) {
        return Turn { angle_rad: step_rad * done.clamp(0, i64::from(count)) as f64, rate_rps: 0.0 };
    }
    let into = Span(t.0 % period - rest).as_secs_f64().max(0.0);
    let turn = within_move(into, step_rad, Span(moving).as_secs_f64(), ramp.as_secs_f64());
    Turn { angle_rad: step_rad * done as f64 + turn.angle_rad, ..turn }
}

/// Moves of one angle forwards and back at each rate, a rest before each.
fn both_ways(seconds: f64, rates_rps: [f64; 3], turn_rad: f64, rest: Span, ramp: Span) -> Turn {
    let (rest, ramp) = (rest.as_secs_f64().max(0.0), ramp.as_secs_f64().max(0.0));
    let mut begin = 0.0;
    for rate in rates_rps.into_iter().map(f64::abs).filter(|rate| *rate > 0.0) {
        // So long that the rate between the ramps is the one asked for; a move shorter than its ramps has a lower one.
        let whole = (turn_rad.abs() / rate + ramp).max(2.0 * ramp);
        for (from, by) in [(0.0, turn_rad), (turn_rad, -turn_rad)] {
            let into = seconds - begin - rest;
            if into < whole {
                let turn = within_move(into.max(0.0), by, whole, ramp);
                return Turn { angle_rad: from + turn.angle_rad, ..turn };
            }
            begin += rest + whole;
        }
    }
    Turn { angle_rad: 0.0, rate_rps: 0.0 }
}

/// So long, s, into a move of an angle: speeding up evenly, at one rate, slowing down.
fn within_move(into: f64, step_rad: f64, whole: f64, ramp: f64) -> Turn {
    let peak_rps = step_rad / (whole - ramp);
    let left = whole - into;
    let (angle, rate_rps) = if into < ramp {
        (peak_rps * into * into / (2.0 * ramp), peak_rps * into / ramp)
    } else if left < ramp {
        (step_rad - peak_rps * left * left / (2.0 * ramp), peak_rps * left / ramp)
    } else if into > 0.0 {
        (peak_rps * (into - ramp / 2.0), peak_rps)
    } else {
        (0.0, 0.0)
    };
    Turn { angle_rad: angle, rate_rps }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: f64 = 22.5 / 360.0 * TAU;

    fn secs(s: f64) -> RigNs {
        RigNs((s * 1e9) as i64)
    }

    fn span(s: f64) -> Span {
        Span(secs(s).0)
    }

    /// The paper's: 16 moves of 22.5°, here 2 s of rest and 1.5 s of moving with ramps of 0.5 s.
    const STEPS: Profile = Profile::Steps {
        step_rad: STEP,
        rest: Span(2_000_000_000),
        moving: Span(1_500_000_000),
        ramp: Span(500_000_000),
        count: 16,
    };

    #[test]
    fn steps_rest_at_multiples_of_the_step_and_stop_after_the_last() {
        for k in 0..16 {
            let begin = f64::from(k) * 3.5;
            for at in [begin, begin + 1.0, begin + 1.999] {
                assert_eq!(STEPS.at(secs(at)), Turn { angle_rad: f64::from(k) * STEP, rate_rps: 0.0 });
            }
        }
        assert_eq!(STEPS.at(secs(1e6)), Turn { angle_rad: TAU, rate_rps: 0.0 });
        assert_eq!(STEPS.at(secs(-5.0)), Turn { angle_rad: 0.0, rate_rps: 0.0 });
    }

    #[test]
    fn a_step_speeds_up_evenly_runs_and_slows_down() {
        // Peak rate: 22.5° in (1.5 − 0.5) s of equivalent running. Half of it half way up the ramp, where an eighth of
        // ramp · peak is behind: 0.25² / (2 · 0.5) = 0.0625 s of running.
        let near = |turn: Turn, part: f64, rate: f64| {
            let off = (turn.angle_rad - part * STEP).abs().max((turn.rate_rps - rate * STEP).abs());
            assert!(off < 1e-12, "{turn:?}");
        };
        near(STEPS.at(secs(2.25)), 0.0625, 0.5);
        near(STEPS.at(secs(2.75)), 0.5, 1.0);
        near(STEPS.at(secs(3.25)), 1.0 - 0.0625, 0.5);
    }

    #[test]
    fn stop_and_go_covers_what_its_rate_says() {
        let profile = Profile::StopAndGo { rate_rps: 0.2, stop: span(3.0), go: span(5.0), ramp: span(1.0) };
        // A run of 5 s with ramps of 1 s is 4 s at 0.2 rad/s; 125 periods of 8 s.
        assert!((profile.at(secs(1_000.0)).angle_rad - 125.0 * 0.8).abs() < 1e-9);
        assert_eq!(profile.at(secs(1_005.5)).rate_rps, 0.2);
        assert_eq!(profile.at(secs(1_002.5)).rate_rps, 0.0);
    }

    #[test]
    fn both_ways_goes_forth_and_back_at_each_rate_and_stays() {
        let rates_rps = [0.2, 0.4, 0.0];
        let profile = Profile::BothWays { rates_rps, turn_rad: 2.0, rest: span(3.0), ramp: span(1.0) };
        // At 0.2 rad/s a move takes 10 + 1 s, at 0.4 5 + 1: 14, 28, 37, 46 s are the ends.
        let near = |at: f64, angle: f64, rate: f64| {
            let turn = profile.at(secs(at));
            let off = (turn.angle_rad - angle).abs().max((turn.rate_rps - rate).abs());
            assert!(off < 1e-12, "{at} s: {turn:?}");
        };
        near(2.9, 0.0, 0.0);
        near(8.5, 1.0, 0.2);
        near(14.5, 2.0, 0.0);
        near(22.5, 1.0, -0.2);
        near(34.0, 1.0, 0.4);
        near(43.0, 1.0, -0.4);
        near(100.0, 0.0, 0.0);
    }

    #[test]
    fn a_ramp_covers_the_mean_of_its_rates() {
        let ramp = |lasts| Profile::Ramp { from_rps: 0.1, to_rps: 0.5, begins: secs(2.0), lasts: span(lasts) };
        // 2 s at 0.1, 4 s at 0.3 in the mean, 4 s at 0.5.
        let end = ramp(4.0).at(secs(10.0));
        assert!((end.angle_rad - 3.4).abs() < 1e-12 && (end.rate_rps - 0.5).abs() < 1e-12);
        assert!((ramp(4.0).at(secs(4.0)).rate_rps - 0.3).abs() < 1e-12);
        // At once: 2 s at 0.1, 8 s at 0.5.
        assert!((ramp(0.0).at(secs(10.0)).angle_rad - 4.2).abs() < 1e-12);
    }

    #[test]
    fn a_swing_is_exact_after_hours() {
        let swing = Profile::Sinusoid { mean_rps: 0.0, amplitude_rad: 0.4, period: span(7.0) };
        // 10,000 periods and a quarter.
        let late = swing.at(RigNs(70_001_750_000_000));
        assert!((late.angle_rad - 0.4).abs() < 1e-15 && late.rate_rps.abs() < 1e-15);
        assert!((swing.at(RigNs(0)).rate_rps - 0.4 * TAU / 7.0).abs() < 1e-15);
    }
}

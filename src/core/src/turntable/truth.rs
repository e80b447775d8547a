//! Whether a turntable's angle may be called truth.

use super::sample::Reading;
use core::fmt;
use tumbled_model::RigNs;
use tumbled_serial::zaber::{PositionKind, Severity, Warning};

/// An encoder farther than this from where the stage was told to be has slipped, or the table has, rad (0.5°): a drive
/// follows its orders to less than 0.1°, and half a degree is what a measurement of attitude is worth.
const SLIP_RAD: f64 = 0.5 * core::f64::consts::PI / 180.0;
/// So many checks in a row: one of them may fall into a jolt.
const SLIP_CHECKS: u32 = 2;

/// Why an angle is no truth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Cause {
    /// The stage reports a fault.
    Fault(Warning),
    /// The encoder is elsewhere than the drive was told to be.
    Slip,
    /// There is no encoder.
    Commanded,
}

/// From when on, and why.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Doubt {
    /// The last instant at which nothing was wrong yet, or the first of all.
    pub(super) since: RigNs,
    pub(super) cause: Cause,
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fault(flag) => {
                let what = match *flag {
                    Warning::STALLED => "stalled",
                    Warning::ENCODER_ERROR => "encoder error",
                    Warning::DRIVER_OFF => "driver off",
                    Warning::LIMIT_ERROR => "limit error",
                    _ => "a fault",
                };
                write!(f, "the stage reports {flag} ({what})")
            }
            Self::Slip => write!(
                f,
                "encoder and drive are more than {:.1} degrees apart: the table slipped or was held; home the stage",
                SLIP_RAD.to_degrees()
            ),
            Self::Commanded => f.write_str("the stage has no encoder: it tells where it was told to be"),
        }
    }
}

/// What is known of it.
#[derive(Clone, Debug, Default)]
pub(super) struct Truth {
    /// When a reading without fault was last there.
    well: Option<RigNs>,
    faulty: Option<Doubt>,
    /// When encoder and drive last agreed.
    agreed: Option<RigNs>,
    /// Checks in a row in which they did not, and when the first was.
    apart: Option<(u32, RigNs)>,
    slipped: Option<Doubt>,
    referenced: Option<bool>,
}

impl Truth {
    /// The worst reason to doubt the angle; `None`: it is truth, as far as the stage can tell.
    pub(super) fn doubt(&self) -> Option<Doubt> {
        self.faulty.or(self.slipped)
    }

    /// Whether the counts are referred to the stage's zero; `None`: not known.
    pub(super) fn referenced(&self) -> Option<bool> {
        self.referenced
    }

    /// The device has begun anew.
    pub(super) fn begin(&mut self) {
        *self = Self::default();
    }

    /// A position came.
    pub(super) fn reading(&mut self, reading: &Reading) {
        let flag = reading.warning.unwrap_or(Warning::NONE);
        let cause = match (flag.severity(), reading.kind) {
            (Severity::Fault, _) => Some(Cause::Fault(flag)),
            (_, PositionKind::Commanded) => Some(Cause::Commanded),
            _ => None,
        };
        let Some(cause) = cause else {
            self.well = Some(reading.t);
            self.faulty = None;
            self.referenced = reading.warning.map(Warning::referenced);
            return;
        };
        let since = self.faulty.map(|doubt| doubt.since).or(self.well).unwrap_or(reading.t);
        self.faulty = Some(Doubt { since, cause });
    }

    /// The drive said at `at` how far its encoder is from where it was told to be.
    pub(super) fn following(&mut self, at: RigNs, error_rad: f64) {
        if error_rad.abs() <= SLIP_RAD {
            self.agreed = Some(at);
            (self.apart, self.slipped) = (None, None);
            return;
        }
        let (before, first) = self.apart.unwrap_or((0, at));
        self.apart = Some((before + 1, first));
        if before + 1 >= SLIP_CHECKS && self.slipped.is_none() {
            let since = self.agreed.unwrap_or(first);
            self.slipped = Some(Doubt { since, cause: Cause::Slip });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tumbled_model::Span;

    fn ms(ms: i64) -> RigNs {
        RigNs(1_000_000 * ms)
    }

    fn reading(at: i64, warning: Warning, kind: PositionKind) -> Reading {
        let (t, t_sigma) = (ms(at), Span(0));
        Reading { t, half_rtt: None, t_sigma, counts: 0, kind, moving: None, warning: Some(warning) }
    }

    #[test]
    fn a_stall_is_no_truth_from_the_last_reading_without_it_until_the_flag_is_gone() {
        let mut truth = Truth::default();
        let mut take = |at, flag| {
            truth.reading(&reading(at, flag, PositionKind::Encoder));
            truth.doubt()
        };
        assert_eq!((take(0, Warning::NONE), take(20, Warning::NOT_HOMED)), (None, None));
        let doubt = Doubt { since: ms(20), cause: Cause::Fault(Warning::STALLED) };
        assert_eq!((take(40, Warning::STALLED), take(60, Warning::STALLED)), (Some(doubt), Some(doubt)));
        assert_eq!(take(80, Warning::NONE), None);
        assert!(doubt.cause.to_string().contains("FS (stalled)"));
        assert_eq!(truth.referenced(), Some(true));
    }

    #[test]
    fn a_slip_is_no_truth_from_the_last_check_without_it_until_encoder_and_drive_agree() {
        let mut truth = Truth::default();
        let degrees = |degrees: f64| degrees.to_radians();
        truth.following(ms(500), degrees(0.1));
        truth.following(ms(1_000), degrees(-3.0));
        assert_eq!(truth.doubt(), None, "one check may fall into a jolt");
        truth.following(ms(1_500), degrees(-3.0));
        assert_eq!(truth.doubt(), Some(Doubt { since: ms(500), cause: Cause::Slip }));
        truth.following(ms(2_000), degrees(0.4));
        assert_eq!(truth.doubt(), None);
    }

    #[test]
    fn a_commanded_position_never_is() {
        let mut truth = Truth::default();
        truth.reading(&reading(0, Warning::NONE, PositionKind::Commanded));
        assert_eq!(truth.doubt().map(|doubt| doubt.cause), Some(Cause::Commanded));
    }
}

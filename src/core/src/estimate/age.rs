//! For how long a state is good without a measurement: the one rule for epochs and for predictions between them.

use super::state::{StateReason, Validity};
use tumbled_model::Span;

/// Without a measurement for so long a target counts as tracked between epochs: three turns of a LiDAR at 10 Hz.
const FRESH: Span = Span(300_000_000);
/// Without a measurement for so long a prediction is no longer good.
const GOOD_PREDICTION: Span = Span(1_000_000_000);
/// Without a measurement for so long the target is lost.
const LOST_AFTER: Span = Span(3_000_000_000);

/// How old the newest measurement is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Age {
    /// The sensors follow the target.
    Fresh,
    /// The motion is known well enough to do without them.
    Predicted,
    /// Nobody knows whether the target still moves so.
    Stale,
    /// It has to be looked for.
    Lost,
}

impl Age {
    /// So long after a measurement.
    pub(super) fn of(since: Span) -> Self {
        match since {
            since if since > LOST_AFTER => Self::Lost,
            since if since > GOOD_PREDICTION => Self::Stale,
            since if since > FRESH => Self::Predicted,
            _ => Self::Fresh,
        }
    }

    /// The most that a state of this age may be trusted, and why not more.
    pub(super) fn trust(self) -> (Validity, Option<StateReason>) {
        match self {
            Self::Fresh | Self::Predicted => (Validity::Ok, None),
            Self::Stale | Self::Lost => (Validity::Invalid, Some(StateReason::Stale)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_state_is_good_for_a_second_and_lost_after_three() {
        let of_ms = |ms: i64| Age::of(Span(ms * 1_000_000));
        assert_eq!([-5, 0, 300, 301].map(of_ms), [Age::Fresh, Age::Fresh, Age::Fresh, Age::Predicted]);
        assert_eq!([1_000, 1_001, 3_000, 3_001].map(of_ms), [Age::Predicted, Age::Stale, Age::Stale, Age::Lost]);
        assert_eq!(of_ms(1_000).trust(), (Validity::Ok, None));
        assert_eq!(of_ms(1_001).trust(), (Validity::Invalid, Some(StateReason::Stale)));
    }
}

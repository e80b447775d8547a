//! Since when it stands as it does with the target: what an operator asks who comes to the rig.

use tumbled_model::RigNs;

use super::state::{Mode, StateReason, TargetState};

/// A mode, and since when. A prediction over less than a second still rests on measurements: it does not end tracking.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Standing(Option<(Mode, RigNs)>);

impl Standing {
    /// The next epoch's state.
    pub(crate) fn take(&mut self, state: &TargetState) {
        let is_short = state.mode == Mode::Predicted && !state.reasons.contains(&StateReason::Stale);
        let mode = if is_short { Mode::Tracking } else { state.mode };
        if self.0.is_none_or(|(before, _)| before != mode) {
            self.0 = Some((mode, state.t));
        }
    }

    /// Since when it is so; `None`: no epoch yet.
    pub(crate) fn since(&self) -> Option<RigNs> {
        self.0.map(|(_, since)| since)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::estimate::{StateInputs, Validity};

    fn state(at_ms: i64, mode: Mode, reasons: &[StateReason]) -> TargetState {
        TargetState {
            epoch: 0,
            t: RigNs(at_ms * 1_000_000),
            sensor: "near".into(),
            mode,
            validity: Validity::Ok,
            reasons: reasons.to_vec(),
            motion: None,
            nis: None,
            inputs: StateInputs::default(),
            alternatives: 0,
        }
    }

    #[test]
    fn a_short_prediction_does_not_end_tracking_and_a_stale_one_does() {
        let mut standing = Standing::default();
        assert_eq!(standing.since(), None);
        let mut since_ms = |at_ms, mode, reasons: &[StateReason]| {
            standing.take(&state(at_ms, mode, reasons));
            standing.since().map(|since| since.0 / 1_000_000)
        };
        assert_eq!(since_ms(100, Mode::Acquiring, &[StateReason::Settling]), Some(100));
        assert_eq!(since_ms(900, Mode::Tracking, &[]), Some(900));
        assert_eq!(since_ms(1_300, Mode::Predicted, &[]), Some(900));
        assert_eq!(since_ms(1_400, Mode::Tracking, &[]), Some(900));
        assert_eq!(since_ms(2_500, Mode::Predicted, &[StateReason::Stale]), Some(2_500));
        assert_eq!(since_ms(2_600, Mode::Tracking, &[]), Some(2_600));
    }
}

//! A state as a datagram.

use tumbled_core::estimate::{Mode, StateReason, TargetState, Validity};
use tumbled_model::UnixNs;

use super::datagram::{Telemetry, reason_bits};

impl Telemetry {
    /// Of an epoch's state; `unix` is the wall time of its time. Origin, session and sequence are the sender's.
    pub fn of_epoch(state: &TargetState, unix: UnixNs) -> Self {
        Self::of_state(1, state, unix)
    }

    /// Of a state predicted to `state.t`, of which `unix` is the wall time.
    pub fn of_prediction(state: &TargetState, unix: UnixNs) -> Self {
        Self::of_state(2, state, unix)
    }

    fn of_state(kind: u8, state: &TargetState, unix: UnixNs) -> Self {
        let mut datagram = Self::nothing_known(state.t.0, unix.0);
        datagram.kind = kind;
        datagram.epoch = state.epoch;
        datagram.mode = match state.mode {
            Mode::NoTarget => 0,
            Mode::Acquiring => 1,
            Mode::Tracking => 2,
            Mode::Predicted => 3,
            Mode::Lost => 4,
        };
        datagram.validity = match state.validity {
            Validity::Invalid => 0,
            Validity::Degraded => 1,
            Validity::Ok => 2,
        };
        datagram.reasons = reason_bits(state.reasons.iter().copied().map(StateReason::name));
        let Some(motion) = &state.motion else { return datagram };
        datagram.position_m = motion.t_rig_target.translation.vector.into();
        datagram.rotation_xyzw = motion.t_rig_target.rotation.coords.into();
        datagram.velocity_mps = motion.velocity_mps.into();
        datagram.angular_velocity_rps = motion.angular_velocity_rps.into();
        if let Some(spin) = &motion.spin {
            datagram.spin_axis = spin.axis.into();
            datagram.spin_rate_rps = spin.rate_rps;
        }
        datagram.sigma = core::array::from_fn(|state| motion.covariance[(state, state)].sqrt());
        datagram
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, SMatrix, Vector3};
    use tumbled_core::estimate::{StateInputs, TargetMotion};
    use tumbled_model::{RigNs, SensorId};

    use super::*;
    use crate::telemetry::datagram::OTHER_REASON;

    fn state(motion: Option<TargetMotion>) -> TargetState {
        TargetState {
            epoch: 9,
            t: RigNs(5),
            sensor: SensorId::from("near"),
            mode: Mode::Predicted,
            validity: Validity::Degraded,
            reasons: vec![StateReason::Rejected, StateReason::Manoeuvre],
            motion,
            nis: None,
            inputs: StateInputs::default(),
            alternatives: 0,
        }
    }

    #[test]
    fn a_state_keeps_its_numbers() {
        let motion = TargetMotion {
            t_rig_target: Isometry3::translation(1.0, 2.0, 3.0),
            velocity_mps: Vector3::new(0.1, 0.2, 0.3),
            angular_velocity_rps: Vector3::new(0.0, 0.0, 0.5),
            covariance: SMatrix::identity() * 4.0,
            spin: None,
            momentum: None,
        };
        let datagram = Telemetry::of_epoch(&state(Some(motion)), UnixNs(7));
        assert_eq!((datagram.t_ns, datagram.unix_ns, datagram.epoch, datagram.kind), (5, 7, 9, 1));
        assert_eq!((datagram.mode, datagram.validity), (3, 1));
        assert_eq!((datagram.position_m, datagram.sigma), ([1.0, 2.0, 3.0], [2.0; 12]));
        assert!(datagram.spin_rate_rps.is_nan());
    }

    #[test]
    fn every_reason_has_a_bit_of_its_own() {
        for reason in StateReason::ALL {
            assert_eq!(reason_bits([reason.name()]).count_ones(), 1, "{}", reason.name());
            assert_ne!(reason_bits([reason.name()]), OTHER_REASON, "{}", reason.name());
        }
        let unknown = Telemetry::of_epoch(&state(None), UnixNs(7));
        assert!(unknown.position_m.iter().all(|value| value.is_nan()));
    }
}

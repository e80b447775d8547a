//! A motion that starts over.

use super::{BodyState, Motion};
use std::sync::Arc;
use tumbled_model::{RigNs, Span};

/// A motion that starts over after a while: at its end the body is at once where it was at the start.
#[derive(Clone, Debug)]
pub struct Repeated {
    /// The motion.
    pub motion: Arc<dyn Motion>,
    /// How much of it is repeated, from the session's start on; 1 ns at least.
    pub period: Span,
}

impl Motion for Repeated {
    fn state(&self, t: RigNs) -> BodyState {
        self.motion.state(RigNs(t.0.rem_euclid(self.period.0.max(1))))
    }
}

#[cfg(test)]
mod tests {
    use super::super::path::Drifting;
    use super::*;
    use nalgebra::{Isometry3, Vector3};

    #[test]
    fn after_each_period_the_body_is_where_it_was_at_the_start() {
        let velocity_mps = Vector3::new(1.0, 0.0, 0.0);
        let motion = Arc::new(Drifting { start: Isometry3::identity(), velocity_mps });
        let repeated = Repeated { motion, period: Span(3_000_000_000) };
        let x = |s: i64| repeated.state(RigNs(s * 1_000_000_000)).t_rig_body.translation.x;
        assert_eq!([0, 2, 3, 5, 301].map(x), [0.0, 2.0, 0.0, 2.0, 1.0]);
    }
}

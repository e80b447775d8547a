//! The frames of a session that its target's model is made of.

use std::collections::BTreeMap;

use nalgebra::Isometry3;
use tumbled_core::estimate::KeptFrame;
use tumbled_model::se3::angle_between;
use tumbled_model::{RigNs, Span};

use crate::cli::Failure;
use crate::session::Step;
use crate::session::play::Listener;

/// Of each sensor a frame is kept when the target has turned by this since the last one, rad: 3°; or moved by this, m; or, where it
/// rests, after this time.
const TURN_RAD: f64 = 0.052;
const MOVE_M: f64 = 0.02;
const REST: Span = Span(1_000_000_000);
/// Frames kept at most: 0.3 MB each.
const MOST: usize = 1_500;

/// What is kept.
#[derive(Debug, Default)]
pub struct Frames {
    /// The frames, in their order.
    pub frames: Vec<KeptFrame>,
    /// Frames beyond what is kept.
    pub beyond: u64,
    last: BTreeMap<(u32, usize), (RigNs, Isometry3<f64>)>,
}

impl Frames {
    fn take(&mut self, kept: &KeptFrame) {
        let shot = kept.frame.shot();
        let (pose, key) = (&kept.t_rig_target, (kept.target, shot.sensor));
        let is_due = self.last.get(&key).is_none_or(|(t, last)| {
            let moved = (pose.translation.vector - last.translation.vector).norm();
            angle_between(&last.rotation, &pose.rotation) >= TURN_RAD || moved >= MOVE_M || shot.t - *t >= REST
        });
        if !is_due {
            return;
        }
        if self.frames.len() >= MOST {
            self.beyond += 1;
            return;
        }
        self.last.insert(key, (shot.t, *pose));
        self.frames.push(kept.clone());
    }
}

impl Listener for Frames {
    fn step(&mut self, step: &Step<'_>) -> Result<(), Failure> {
        step.outputs.kept.iter().for_each(|kept| self.take(kept));
        Ok(())
    }
}

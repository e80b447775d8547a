//! An angle for every instant, and what goes wrong with it.

use std::sync::Arc;
use tumbled_model::RigNs;

/// A stage at an instant.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StageState {
    /// Angle from the reference, rad, not wrapped; positive as the stage counts.
    pub angle_rad: f64,
    /// Its rate, rad/s; exactly 0 where the stage stands.
    pub rate_rps: f64,
}

/// The angle as a function of time.
pub type StageMotion = Arc<dyn Fn(RigNs) -> StageState + Send + Sync>;

/// Something that goes wrong with the drive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StageFault {
    /// The table is held from one instant to another. The stage notices (`FS`), and goes on behind by what it lost.
    Stall {
        /// From then on.
        from: RigNs,
        /// Until then.
        until: RigNs,
    },
    /// The table slips. The stage does not notice: only the encoder differs from what was commanded.
    Slip {
        /// When.
        at: RigNs,
        /// By how much it falls behind, rad.
        angle_rad: f64,
    },
}

/// A stage that follows a script, whatever it is told.
#[derive(Clone)]
pub struct ScriptedStage {
    motion: StageMotion,
    faults: Vec<StageFault>,
}

impl core::fmt::Debug for ScriptedStage {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("ScriptedStage").field("faults", &self.faults).finish_non_exhaustive()
    }
}

impl ScriptedStage {
    /// A stage that follows `motion` except for the faults. Stalls must not overlap: where they do, the table falls back
    /// by the common part twice.
    pub fn new(motion: StageMotion, faults: Vec<StageFault>) -> Self {
        Self { motion, faults }
    }

    /// Where the controller believes the table to be.
    pub fn commanded(&self, t: RigNs) -> StageState {
        (self.motion)(t)
    }

    /// Where the table is, and what stands on it.
    pub fn table(&self, t: RigNs) -> StageState {
        let commanded = self.commanded(t);
        let lost: f64 = self.faults.iter().map(|fault| self.lost(fault, t)).sum();
        let rate_rps = if self.stalled(t) { 0.0 } else { commanded.rate_rps };
        StageState { angle_rad: commanded.angle_rad - lost, rate_rps }
    }

    /// Whether the table is held at an instant.
    pub fn stalled(&self, t: RigNs) -> bool {
        self.faults
            .iter()
            .any(|fault| matches!(fault, StageFault::Stall { from, until } if (*from..*until).contains(&t)))
    }

    fn lost(&self, fault: &StageFault, t: RigNs) -> f64 {
        match *fault {
            StageFault::Stall { from, until } if t > from => {
                self.commanded(t.min(until.max(from))).angle_rad - self.commanded(from).angle_rad
            }
            StageFault::Slip { at, angle_rad } if t >= at => angle_rad,
            StageFault::Stall { .. } | StageFault::Slip { .. } => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stall_holds_the_table_and_a_slip_sets_it_back() {
        let motion: StageMotion = Arc::new(|t| StageState { angle_rad: 1e-9 * t.0 as f64, rate_rps: 1.0 });
        let s = |seconds: i64| RigNs(1_000_000_000 * seconds);
        let stall = StageFault::Stall { from: s(2), until: s(5) };
        let slip = StageFault::Slip { at: s(7), angle_rad: 0.25 };
        let stage = ScriptedStage::new(motion, vec![stall, slip]);
        let table = [1, 3, 4, 6, 8].map(|seconds| stage.table(s(seconds)));
        // Held at 2 rad for 3 s, so 3 rad behind after it; then 0.25 more.
        let expected = [1.0, 2.0, 2.0, 3.0, 4.75];
        assert!(table.iter().zip(expected).all(|(table, angle)| (table.angle_rad - angle).abs() < 1e-12), "{table:?}");
        assert_eq!(table.map(|table| table.rate_rps), [1.0, 0.0, 0.0, 1.0, 1.0]);
        assert_eq!(stage.commanded(s(8)).angle_rad, 8.0);
    }
}

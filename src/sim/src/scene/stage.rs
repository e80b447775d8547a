//! The turntable of a scene: what it does, what its line says.

use super::bodies::{span, turntable};
use super::build::Scene;
use super::config::{SceneConfig, SceneMotion, SceneStage};
use super::error::SceneError;
use crate::motion::Motion;
use crate::motion::turntable::{FaultyTurntable, Turntable};
use crate::turntable::{
    Conversation, EmulatorSettings, LineLogSettings, Mishaps, ScriptedStage, Stage, StageFault, StageState,
    ZaberEmulator,
};
use std::sync::Arc;
use tumbled_model::RigNs;

impl Scene {
    /// The stage under the target with everything that goes wrong with it, if there is one. The target follows its
    /// [`ScriptedStage::table`].
    pub fn scripted_stage(&self) -> Option<ScriptedStage> {
        Some(scripted(self.stage()?, &stage_of(&self.config)))
    }

    /// The stage behind its serial line.
    pub fn emulator(&self) -> Option<ZaberEmulator> {
        let noise_counts = stage_of(&self.config).noise_counts;
        let settings = EmulatorSettings { noise_counts, ..EmulatorSettings::usual(self.config.seed) };
        Some(ZaberEmulator::new(settings, Stage::Scripted(self.scripted_stage()?)))
    }

    /// What a host that polls it and the stage say to each other, from the scene's start to its end.
    pub fn conversation(&self) -> Option<Conversation> {
        let seed = self.config.seed;
        let mishaps = Mishaps { chance: stage_of(&self.config).mishap_probability, seed };
        let settings = LineLogSettings { mishaps, ..LineLogSettings::usual(RigNs(self.duration().0), seed) };
        Some(Conversation::new(self.emulator()?, settings))
    }
}

/// How the target moves on a stage with faults; `None`: its motion has none.
pub(super) fn faulty_motion(config: &SceneConfig) -> Result<Option<Arc<dyn Motion>>, SceneError> {
    let Some(stage) = &config.stage else { return Ok(None) };
    let SceneMotion::Turntable { axis, center_m, mount, profile } = &config.motion else {
        return Err(SceneError::NoTurntable);
    };
    check(stage)?;
    let turntable = turntable(axis, center_m, mount, profile)?;
    Ok(Some(Arc::new(FaultyTurntable { turntable, stage: scripted(turntable, stage) })))
}

fn stage_of(config: &SceneConfig) -> SceneStage {
    config.stage.clone().unwrap_or_default()
}

fn scripted(turntable: Turntable, stage: &SceneStage) -> ScriptedStage {
    let told = move |t: RigNs| {
        let turn = turntable.stage(t);
        StageState { angle_rad: turn.angle_rad, rate_rps: turn.rate_rps }
    };
    let at = |seconds: f64| RigNs(span(seconds).0);
    let stalls = stage.stall.iter().map(|stall| StageFault::Stall { from: at(stall.from_s), until: at(stall.until_s) });
    let slips =
        stage.slip.iter().map(|slip| StageFault::Slip { at: at(slip.at_s), angle_rad: slip.angle_deg.to_radians() });
    ScriptedStage::new(Arc::new(told), stalls.chain(slips).collect())
}

/// Looks for numbers that mean nothing.
fn check(stage: &SceneStage) -> Result<(), SceneError> {
    let number = |key, found: f64, fits: bool, expected| {
        if fits && found.is_finite() { Ok(()) } else { Err(SceneError::Number { key, found, expected }) }
    };
    let SceneStage { noise_counts, mishap_probability, stall, slip } = stage;
    number("stage.noise_counts", *noise_counts, *noise_counts >= 0.0, "0 or more")?;
    let chance = (0.0..=1.0).contains(mishap_probability);
    number("stage.mishap_probability", *mishap_probability, chance, "0 to 1")?;
    let mut free_from = 0.0;
    for stall in stall {
        let expected = "0 s or later, and not before the end of the stall before it";
        number("stage.stall.from_s", stall.from_s, stall.from_s >= free_from, expected)?;
        number("stage.stall.until_s", stall.until_s, stall.until_s >= stall.from_s, "not before from_s")?;
        free_from = stall.until_s;
    }
    for slip in slip {
        number("stage.slip.at_s", slip.at_s, slip.at_s >= 0.0, "0 s or later")?;
        number("stage.slip.angle_deg", slip.angle_deg, true, "a finite number")?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::config::{SceneSlip, SceneStall};
    use super::*;

    #[test]
    fn numbers_that_no_stage_has_are_named() {
        let refused = |stage: SceneStage| check(&stage).expect_err("refused").to_string();
        let noise = SceneStage { noise_counts: -1.0, ..SceneStage::default() };
        assert_eq!(refused(noise), "stage.noise_counts is -1: expected 0 or more");
        let mishaps = SceneStage { mishap_probability: 1.5, ..SceneStage::default() };
        assert_eq!(refused(mishaps), "stage.mishap_probability is 1.5: expected 0 to 1");
        let stall = |from_s, until_s| SceneStall { from_s, until_s };
        let overlapping = SceneStage { stall: vec![stall(1.0, 3.0), stall(2.0, 4.0)], ..SceneStage::default() };
        assert!(refused(overlapping).starts_with("stage.stall.from_s is 2: "));
        let slip = vec![SceneSlip { at_s: 1.0, angle_deg: f64::NAN }];
        let slipping = SceneStage { slip, ..SceneStage::default() };
        assert_eq!(refused(slipping), "stage.slip.angle_deg is NaN: expected a finite number");
        let fine = SceneStage { stall: vec![stall(1.0, 3.0), stall(3.0, 4.0)], ..SceneStage::default() };
        assert!(check(&fine).is_ok());
    }
}

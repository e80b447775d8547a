//! A pose campaign's file.

use std::collections::{BTreeMap, BTreeSet};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_model::RigNs;
use tumbled_sim::scene::Scene;

use super::changes::SceneChanges;
use super::figure::PoseFigure;
use crate::cli::Failure;
use crate::evaluation::score::From;
use crate::experiment::campaign::claims::Limits;
use crate::experiment::lanes::Lane;
use crate::simulation::rig::{Sensors, View};
use crate::simulation::scenes;

/// What a campaign's file says it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// Pose and spin over simulated scenes.
    Pose,
}

/// What is measured, and what it must reach.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled pose campaign file")]
pub struct PoseCampaignFile {
    /// `pose`.
    pub kind: Kind,
    /// Its name.
    pub name: String,
    /// What it is for, one line.
    pub about: String,
    /// The first seed; of every scene the same ones are used, so that scenes that differ in one thing differ in that alone.
    pub seed: u64,
    /// Configs that scenes are replayed with.
    pub config: Vec<ConfigEntry>,
    /// Scenes.
    pub scene: Vec<SceneEntry>,
    /// What is claimed of them.
    pub claim: Vec<PoseClaim>,
}

/// A config of a scene's rig.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ConfigEntry {
    /// Its name.
    pub id: String,
    /// As an operator would have it (`rig.toml`), or as it is (`rig-true.toml`).
    #[serde(default)]
    pub view: View,
    /// Which sensors it has.
    #[serde(default)]
    pub sensors: Sensors,
    /// Settings as after `--set`.
    #[serde(default)]
    pub set: Vec<String>,
}

/// A scene over seeds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneEntry {
    /// Its name, for claims.
    pub id: String,
    /// A scene of the program's, or a file.
    pub scene: String,
    /// How many seeds.
    pub seeds: u64,
    /// How long it lasts, s.
    pub duration_s: f64,
    /// The configs that each session is replayed with.
    pub configs: Vec<String>,
    /// What is other than in the scene's file.
    #[serde(default)]
    pub change: SceneChanges,
    /// Over what is scored, by name; left out: `settled`, from the end of the first revolution on.
    #[serde(default = "settled")]
    pub interval: BTreeMap<String, IntervalEntry>,
    /// When a target that was out of sight is back, s: from there on re-acquisition is timed.
    #[serde(default)]
    pub returns_s: Option<f64>,
}

/// The interval that is scored if nothing else is said.
pub const SETTLED: &str = "settled";

fn settled() -> BTreeMap<String, IntervalEntry> {
    BTreeMap::from([(SETTLED.to_owned(), IntervalEntry { from_turns: Some(1.0), ..IntervalEntry::default() })])
}

/// From when until when states are scored; without a beginning from the first tracked state, without an end to the last.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct IntervalEntry {
    /// From this session time on, s.
    pub from_s: Option<f64>,
    /// From so many turns of the target on since it was first tracked.
    pub from_turns: Option<f64>,
    /// Until this session time, s.
    pub until_s: Option<f64>,
    /// Until so many turns of the target since it was first tracked.
    pub until_turns: Option<f64>,
}

impl IntervalEntry {
    /// The beginning.
    pub fn from(&self) -> From {
        Self::bound(self.from_s, self.from_turns).unwrap_or(From::Turns(0.0))
    }

    /// The end.
    pub fn until(&self) -> Option<From> {
        Self::bound(self.until_s, self.until_turns)
    }

    fn bound(seconds: Option<f64>, turns: Option<f64>) -> Option<From> {
        let at = seconds.map(|seconds| From::At(RigNs((seconds * 1e9) as i64)));
        at.or_else(|| turns.map(From::Turns))
    }
}

/// A claim about runs: the trials of a scene with a config.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PoseClaim {
    /// In words.
    pub about: String,
    /// Which runs, `scene/config`, taken together.
    pub runs: Vec<String>,
    /// Over which interval.
    #[serde(default = "settled_name")]
    pub interval: String,
    /// Which figure.
    pub figure: PoseFigure,
    /// Divided by the same figure of other runs; left out: as it is.
    #[serde(default)]
    pub against: Option<Against>,
    /// What it has to be.
    pub must: Limits,
    /// What it should be; left out: the same.
    #[serde(default)]
    pub aim: Option<Limits>,
}

fn settled_name() -> String {
    SETTLED.to_owned()
}

/// What a figure is divided by: the smallest one among some runs, of the same seeds.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Against {
    /// The runs, `scene/config`, each by itself.
    pub runs: Vec<String>,
    /// Over which interval; left out: the claim's.
    #[serde(default)]
    pub interval: Option<String>,
}

/// The most seeds and the longest scene, s: more is a slip of the pen.
const MOST: u64 = 10_000;
const LONGEST_S: f64 = 3_600.0;

impl PoseCampaignFile {
    /// The campaign of a text.
    ///
    /// # Errors
    /// A text that is no campaign, in words.
    pub fn parse(text: &str) -> Result<Self, String> {
        let file: Self = toml::from_str(text).map_err(|error| error.to_string())?;
        file.check()?;
        Ok(file)
    }

    fn check(&self) -> Result<(), String> {
        let twice = |mut ids: Box<dyn Iterator<Item = &String> + '_>| {
            let mut seen = BTreeSet::new();
            ids.find_map(|id| (!seen.insert(id.clone())).then(|| id.clone()))
        };
        if let Some(id) = twice(Box::new(self.config.iter().map(|config| &config.id))) {
            return Err(format!("two configs are called {id}: names of their own expected"));
        }
        if let Some(id) = twice(Box::new(self.scene.iter().map(|scene| &scene.id))) {
            return Err(format!("two scenes are called {id}: names of their own expected"));
        }
        self.scene
            .iter()
            .try_for_each(|scene| self.check_scene(scene).map_err(|e| format!("scene {}: {e}", scene.id)))?;
        self.claim
            .iter()
            .try_for_each(|claim| self.check_claim(claim).map_err(|e| format!("claim `{}`: {e}", claim.about)))
    }

    fn check_scene(&self, scene: &SceneEntry) -> Result<(), String> {
        if !(1..=MOST).contains(&scene.seeds) {
            return Err(format!("seeds = {}, 1 to {MOST} expected", scene.seeds));
        }
        if !(scene.duration_s > 0.0 && scene.duration_s <= LONGEST_S) {
            return Err(format!("duration_s = {}, up to {LONGEST_S} expected", scene.duration_s));
        }
        if scene.configs.is_empty() || scene.interval.is_empty() {
            return Err("at least one config and one interval expected".to_owned());
        }
        if let Some(id) = scene.configs.iter().find(|id| self.config_of(id).is_none()) {
            let known: Vec<&str> = self.config.iter().map(|config| config.id.as_str()).collect();
            return Err(format!("there is no config {id}; the campaign's are {}", known.join(", ")));
        }
        for (name, IntervalEntry { from_s, from_turns, until_s, until_turns }) in &scene.interval {
            let twice = from_s.is_some() && from_turns.is_some() || until_s.is_some() && until_turns.is_some();
            let numbers = [from_s, from_turns, until_s, until_turns].into_iter().flatten();
            if twice || numbers.into_iter().any(|number| !(0.0..=LONGEST_S).contains(number)) {
                return Err(format!(
                    "interval {name}: a beginning and an end at most, each in seconds or in turns, expected"
                ));
            }
        }
        Ok(())
    }

    fn check_claim(&self, claim: &PoseClaim) -> Result<(), String> {
        let against = claim.against.iter();
        let against = against.flat_map(|against| {
            let interval = against.interval.as_ref().unwrap_or(&claim.interval);
            against.runs.iter().map(move |run| (run, interval))
        });
        if claim.runs.is_empty() || claim.against.as_ref().is_some_and(|against| against.runs.is_empty()) {
            return Err("at least one run expected".to_owned());
        }
        for (run, interval) in claim.runs.iter().map(|run| (run, &claim.interval)).chain(against) {
            let scene = run.split_once('/').and_then(|(scene, config)| {
                let scene = self.scene.iter().find(|entry| entry.id == scene)?;
                scene.configs.iter().any(|id| id == config).then_some(scene)
            });
            let scene = scene
                .ok_or_else(|| format!("there is no run {run}: `scene/config` expected, of a scene that has it"))?;
            if !scene.interval.contains_key(interval) {
                return Err(format!("scene {} has no interval {interval}", scene.id));
            }
        }
        if claim.against.is_some() && !claim.figure.has_ratio() {
            return Err(format!("{} cannot be held against another run", claim.figure.name()));
        }
        Ok(())
    }

    /// A config by its name.
    pub fn config_of(&self, id: &str) -> Option<&ConfigEntry> {
        self.config.iter().find(|config| config.id == id)
    }

    /// Builds every scene once and loads every config: what is wrong with them is told before anything is measured.
    ///
    /// # Errors
    /// Exit code 2.
    pub fn rehearse(&self) -> Result<(), Failure> {
        for entry in &self.scene {
            let scene = entry.build(self.seed)?;
            for config in entry.configs.iter().filter_map(|id| self.config_of(id)) {
                let name = format!("{}/{}", entry.id, config.id);
                Lane::new(&scene, (config.view, config.sensors), &config.set, &name, super::watch::Watch::default())?;
            }
        }
        Ok(())
    }
}

impl SceneEntry {
    /// The scene of a seed.
    ///
    /// # Errors
    /// A scene that is none, or has not what would be changed: exit code 2.
    pub fn build(&self, seed: u64) -> Result<Scene, Failure> {
        let mut changed = Ok(());
        let scene = scenes::load_changed(&self.scene, |config| {
            (config.seed, config.duration_s) = (seed, self.duration_s);
            changed = self.change.make(config);
        })?;
        changed.map_err(|error| Failure::input(format!("scene {} of the campaign: {error}", self.id)))?;
        Ok(scene)
    }
}

//! A campaign's file.

use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::register::Method;
use tumbled_sim::target::TargetKind;

use super::claims::{Figure, Limits};
use super::pose::PoseCampaignFile;
use crate::cli::Failure;
use crate::experiment::pairs::{Attitudes, PairSpec, PointCounts};
use crate::experiment::registration::Set;
use crate::experiment::trial::{Start, method_named};

/// The campaigns that come with the program: name and text.
const CAMPAIGNS: [(&str, &str); 2] = [
    ("pose", include_str!("../../../../config/campaigns/pose.toml")),
    ("registration", include_str!("../../../../config/campaigns/registration.toml")),
];

/// A campaign of either kind.
#[derive(Clone, Debug, PartialEq)]
pub enum Campaign {
    /// Pairs of clouds.
    Registration(CampaignFile),
    /// Whole sessions: a file with `kind = "pose"`.
    Pose(PoseCampaignFile),
}

/// What is measured, and what it must reach.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled campaign file")]
pub struct CampaignFile {
    /// Its name.
    pub name: String,
    /// What it is for, one line.
    pub about: String,
    /// Everything random follows from it.
    pub seed: u64,
    /// Sets of pairs.
    pub set: Vec<SetEntry>,
    /// What is claimed of them.
    pub claim: Vec<ClaimEntry>,
}

/// A set of pairs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SetEntry {
    /// Its name, for claims.
    pub id: String,
    /// What is seen.
    pub target: TargetKind,
    /// Points of the Kinect's cloud and of the LiDAR's.
    pub points: [usize; 2],
    /// Least and greatest angle between the sights, degrees.
    pub sights_deg: [f64; 2],
    /// Least and greatest overlap.
    #[serde(default = "any_overlap")]
    pub overlap: [f64; 2],
    /// The target's attitudes.
    #[serde(default)]
    pub attitudes: Attitudes,
    /// With the images and their misses; otherwise points alone.
    #[serde(default)]
    pub organised: bool,
    /// What registration begins with.
    #[serde(default)]
    pub start: Start,
    /// The methods, by name.
    pub methods: Vec<String>,
    /// How many pairs.
    pub pairs: u64,
}

const fn any_overlap() -> [f64; 2] {
    [0.0, 1.0]
}

/// A claim about the trials of some sets by one method, taken together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ClaimEntry {
    /// In words.
    pub about: String,
    /// Which sets.
    pub sets: Vec<String>,
    /// Which method.
    pub method: String,
    /// Which figure.
    pub figure: Figure,
    /// What it has to be.
    pub must: Limits,
    /// What it should be; left out: the same.
    #[serde(default)]
    pub aim: Option<Limits>,
}

impl Campaign {
    /// Reads a campaign: one that comes with the program, by its name, or a file.
    ///
    /// # Errors
    /// A name that is none, a file that is no campaign: exit code 2.
    pub fn read(name: &Path) -> Result<Self, Failure> {
        let of_program =
            CAMPAIGNS.iter().find(|(known, _)| name == Path::new(known)).map(|(_, text)| (*text).to_owned());
        let text = match of_program {
            Some(text) => text,
            None => std::fs::read_to_string(name).map_err(|error| {
                let names: Vec<&str> = CAMPAIGNS.iter().map(|(name, _)| *name).collect();
                Failure::input(format!("{}: {error}", name.display()))
                    .with_help(format!("the program's own campaigns are {}", names.join(", ")))
            })?,
        };
        Self::parse(&text).map_err(|problem| Failure::input(format!("{}: {problem}", name.display())))
    }

    fn parse(text: &str) -> Result<Self, String> {
        let table: toml::Table = toml::from_str(text).map_err(|error| error.to_string())?;
        if table.contains_key("kind") {
            return PoseCampaignFile::parse(text).map(Self::Pose);
        }
        let file: CampaignFile = toml::from_str(text).map_err(|error| error.to_string())?;
        file.check()?;
        Ok(Self::Registration(file))
    }
}

impl CampaignFile {
    fn check(&self) -> Result<(), String> {
        for set in &self.set {
            let id = &set.id;
            if self.set.iter().filter(|other| other.id == *id).count() > 1 {
                return Err(format!("two sets are called {id}: names of their own expected"));
            }
            let [kinect, lidar] = set.points;
            if !((10..=50_000).contains(&kinect) && (10..=5_000).contains(&lidar)) {
                return Err(format!("set {id}: points = {:?}, 10 to 50000 and 10 to 5000 expected", set.points));
            }
            let between = |[low, high]: [f64; 2], most: f64| low >= 0.0 && low <= high && high <= most;
            if !between(set.sights_deg, 180.0) || !between(set.overlap, 1.0) {
                return Err(format!(
                    "set {id}: sights_deg within 0..180 and overlap within 0..1 expected, the least first"
                ));
            }
            if set.pairs == 0 || set.pairs > 1_000_000 {
                return Err(format!("set {id}: pairs = {}, 1 to 1000000 expected", set.pairs));
            }
            for method in &set.methods {
                method_of(method).map_err(|error| format!("set {id}: {error}"))?;
            }
        }
        for claim in &self.claim {
            for id in &claim.sets {
                let set = self.set.iter().find(|set| set.id == *id);
                let set = set.ok_or_else(|| format!("claim `{}`: there is no set {id}", claim.about))?;
                if !set.methods.contains(&claim.method) {
                    return Err(format!("claim `{}`: set {id} is not registered by {}", claim.about, claim.method));
                }
            }
        }
        Ok(())
    }

    /// The sets; with another number of pairs if one is given.
    pub fn sets(&self, pairs: Option<u64>) -> Vec<Set> {
        let set = |(entry, n): (&SetEntry, u64)| Set {
            name: entry.id.clone(),
            spec: PairSpec {
                target: entry.target,
                points: PointCounts { kinect: entry.points[0], lidar: entry.points[1] },
                sights_deg: entry.sights_deg,
                overlap: entry.overlap,
                attitudes: entry.attitudes,
                organised: entry.organised,
            },
            pairs: pairs.unwrap_or(entry.pairs),
            // Sets of one kind would otherwise be the same pairs.
            seed: self.seed.wrapping_mul(1000).wrapping_add(n),
            runs: entry.methods.iter().filter_map(|name| Some((Method::of_name(name)?, entry.start))).collect(),
        };
        self.set.iter().zip(0..).map(set).collect()
    }
}

fn method_of(name: &str) -> Result<Method, String> {
    method_named(name).map_err(|expected| format!("method {name:?}: {expected}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_programs_campaign_is_one_and_has_a_hundred_pairs_of_each_kind() {
        let Ok(Campaign::Registration(file)) = Campaign::read(Path::new("registration")) else { panic!("a campaign") };
        assert!(file.set.iter().all(|set| set.pairs >= 100), "issue 6: at least 100 per row");
        let claimed = |set: &SetEntry| file.claim.iter().any(|claim| claim.sets.contains(&set.id));
        assert!(file.set.iter().all(claimed));
        let seeds: std::collections::BTreeSet<u64> = file.sets(None).iter().map(|set| set.seed).collect();
        assert_eq!(seeds.len(), file.set.len());
    }

    #[test]
    fn what_is_no_campaign_is_told() {
        let head = "name = 'x'\nabout = 'y'\nseed = 1\n";
        let set = "[[set]]\nid = 'a'\ntarget = 'box_bus'\npoints = [100, 50]\nsights_deg = [5, 40]\nmethods = ['gicp']\npairs = 1\n";
        let claim =
            "[[claim]]\nabout = 'c'\nsets = ['a']\nmethod = 'gicp'\nfigure = 'right'\nmust = { at_least = 0.5 }\n";
        let problem = |text: String| match toml::from_str::<CampaignFile>(&text) {
            Ok(file) => file.check().expect_err("wrong"),
            Err(error) => error.to_string(),
        };
        let good: CampaignFile = toml::from_str(&format!("{head}{set}{claim}")).expect("a campaign");
        assert_eq!(good.check(), Ok(()));
        assert!(problem(format!("{head}{set}{set}{claim}")).contains("two sets are called a"));
        assert!(problem(format!("{head}{set}{}", claim.replace("'a'", "'b'"))).contains("there is no set b"));
        assert!(problem(format!("{head}{set}{}", claim.replace("gicp", "icp"))).contains("not registered by icp"));
        assert!(problem(format!("{head}{}{claim}", set.replace("gicp", "fmr"))).contains("fmr"));
        assert!(problem(format!("{head}{}{claim}", set.replace("[5, 40]", "[40, 5]"))).contains("the least first"));
        assert!(problem(format!("{head}{}{claim}", set.replace("pairs", "pear"))).contains("pear"));
    }
}

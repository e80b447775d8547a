//! What a pose campaign found.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::figure::{PoseFigure, Value};
use super::file::PoseCampaignFile;
use super::trial::PoseTrial;
use super::verdict::{PoseVerdict, cell, trials_of};
use crate::experiment::bounds::Share;
use crate::experiment::machine::Machine;
use crate::experiment::page;
use crate::experiment::plot::{Line, Plot, escaped};
use crate::experiment::text;

/// What `tumbled campaign` of kind `pose` measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled campaign pose --json")]
pub struct PoseCampaignReport {
    /// The campaign.
    pub name: String,
    /// The program's version and commit.
    pub program: String,
    /// Where it ran.
    pub machine: Machine,
    /// The first seed.
    pub seed: u64,
    /// Whether the file's numbers of seeds were used: otherwise it is a rehearsal.
    pub whole: bool,
    /// Every claim holds.
    pub holds: bool,
    /// The claims.
    pub claims: Vec<PoseVerdict>,
    /// A line for each scene, config and interval.
    pub rows: Vec<PoseRow>,
}

/// The trials of a scene with a config over an interval, taken together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PoseRow {
    /// The scene of the campaign.
    pub scene: String,
    /// The config.
    pub config: String,
    /// The interval.
    pub interval: String,
    /// Trials: seeds.
    pub trials: u64,
    /// Of these could not be scored; figures of errors are then null.
    pub unscored: u64,
    /// States `tracking`, `ok` and more than 10° off, with their 95 % interval.
    pub wrong: Share,
    /// The figures.
    pub figures: Vec<RowFigure>,
}

/// A figure of a row.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RowFigure {
    /// Which.
    pub figure: PoseFigure,
    /// Its value; null: there is none.
    pub value: Option<Value>,
}

/// A row's cells, and its trials.
struct Cells<'a> {
    row: &'a PoseRow,
    trials: Vec<&'a PoseTrial>,
}

impl PoseCampaignReport {
    /// Of a campaign's trials.
    pub fn new(file: &PoseCampaignFile, trials: &[PoseTrial], program: &str, whole: bool) -> Self {
        let claims: Vec<PoseVerdict> = file.claim.iter().map(|claim| PoseVerdict::of(claim, trials)).collect();
        let mut rows = Vec::new();
        for scene in &file.scene {
            for config in &scene.configs {
                for interval in scene.interval.keys() {
                    let of = trials_of(trials, &format!("{}/{config}", scene.id), interval);
                    let figures = PoseFigure::COLUMNS.iter().chain(&PoseFigure::OTHERS);
                    rows.push(PoseRow {
                        scene: scene.id.clone(),
                        config: config.clone(),
                        interval: interval.clone(),
                        trials: of.len() as u64,
                        unscored: of.iter().filter(|trial| trial.errors.is_none()).count() as u64,
                        wrong: PoseFigure::Wrong.share(&of).unwrap_or(Share::new(0, 0)),
                        figures: figures.map(|figure| RowFigure { figure: *figure, value: figure.of(&of) }).collect(),
                    });
                }
            }
        }
        Self {
            name: file.name.clone(),
            program: program.to_owned(),
            machine: Machine::this(),
            seed: file.seed,
            whole,
            holds: claims.iter().all(|claim| claim.holds),
            claims,
            rows,
        }
    }

    fn cells<'a>(&'a self, trials: &'a [PoseTrial]) -> impl Iterator<Item = Cells<'a>> {
        self.rows.iter().map(|row| Cells {
            row,
            trials: trials_of(trials, &format!("{}/{}", row.scene, row.config), &row.interval),
        })
    }

    fn columns() -> Vec<&'static str> {
        let figures = PoseFigure::COLUMNS.iter().map(|figure| figure.name());
        ["scene", "config", "interval", "seeds"].into_iter().chain(figures).collect()
    }

    /// For a terminal.
    pub fn text(&self, trials: &[PoseTrial]) -> String {
        let claims: Vec<Vec<String>> = self
            .claims
            .iter()
            .map(|verdict| {
                let must = verdict.claim.must.written_as(|value| verdict.written(value));
                vec![verdict.about(), verdict.found(), must, verdict.status().to_owned()]
            })
            .collect();
        let rows: Vec<Vec<String>> = self.cells(trials).map(|cells| cells.text()).collect();
        let rehearsal = if self.whole { "" } else { "a rehearsal with other seeds than the campaign has\n" };
        format!(
            "{} on {}\n{rehearsal}\n{}\n{}",
            self.program,
            self.machine.line(),
            text::table(&["claim", "found", "must", "reached"], &claims),
            text::table(&Self::columns(), &rows)
        )
    }

    /// For the documentation: the claims, and all rows.
    pub fn markdown(&self, trials: &[PoseTrial]) -> String {
        let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        let head = |cells: &[&str]| {
            line(&cells.iter().map(|cell| (*cell).to_owned()).collect::<Vec<_>>())
                + &"| --- ".repeat(cells.len())
                + "|\n"
        };
        let verdict = |verdict: &PoseVerdict| {
            let limits = |limits: &crate::experiment::campaign::claims::Limits| {
                limits.written_as(|value| verdict.written(value))
            };
            let aim = verdict.claim.aim.as_ref().map_or_else(String::new, limits);
            let found = verdict.found();
            let found = if verdict.holds { found } else { format!("**{found}**") };
            let (about, figure) = (verdict.claim.about.clone(), verdict.claim.figure.name().to_owned());
            line(&[about, figure, limits(&verdict.claim.must), aim, found])
        };
        let rehearsal = if self.whole { "" } else { " A rehearsal with fewer seeds: no published figures." };
        format!(
            "`tumbled campaign {}`, {}, {}, seeds from {} on.{rehearsal}\n\n{}{}\n{}{}",
            self.name,
            self.program,
            self.machine.line(),
            self.seed,
            head(&["claim", "figure", "must", "aim", "found"]),
            self.claims.iter().map(verdict).collect::<String>(),
            head(&Self::columns()),
            self.cells(trials).map(|cells| line(&cells.text())).collect::<String>()
        )
    }

    /// As a page: the claims, the rows, and a plot for each scene and interval.
    pub fn page(&self, trials: &[PoseTrial]) -> String {
        let line = |verdict: &PoseVerdict| {
            let class = if verdict.holds { "good" } else { "bad" };
            let limits = |limits: &crate::experiment::campaign::claims::Limits| {
                limits.written_as(|value| verdict.written(value))
            };
            vec![
                format!("<td class=\"wrap\">{}</td>", escaped(&verdict.claim.about)),
                format!("<td class=\"wrap\">{}</td>", escaped(verdict.claim.figure.name())),
                limits(&verdict.claim.must),
                verdict.claim.aim.as_ref().map_or_else(|| "-".to_owned(), limits),
                verdict.found(),
                format!("<td class=\"{class}\">{}</td>", verdict.status()),
            ]
        };
        let claims: Vec<Vec<String>> = self.claims.iter().map(line).collect();
        let rows: Vec<Vec<String>> = self.cells(trials).map(|cells| cells.text()).collect();
        let rehearsal =
            if self.whole { "" } else { "<p class=\"bad\">A rehearsal with other seeds than the campaign has.</p>" };
        let body = format!(
            "<h1>Campaign {}</h1><p>{} on {}, seeds from {} on. Errors are r.m.s. over the interval and over the seeds; poses \
            gauge-free; known frame: with the calibration's error kept in. 95 %: Clopper and Pearson's bounds.</p>{rehearsal}\
            <h2>Claims</h2>{}<h2>Seed by seed</h2><div class=\"plots\">{}</div><h2>Rows</h2>{}",
            escaped(&self.name),
            escaped(&self.program),
            escaped(&self.machine.line()),
            self.seed,
            page::table(&["claim", "figure", "must", "aim", "found", "reached"], &claims),
            self.plots(trials),
            page::table(&Self::columns(), &rows)
        );
        page::page(&format!("tumbled: campaign {}", self.name), &body)
    }

    fn plots(&self, trials: &[PoseTrial]) -> String {
        let cells: Vec<Cells<'_>> = self.cells(trials).collect();
        let mut keys: Vec<(&str, &str)> = Vec::new();
        for Cells { row, .. } in &cells {
            let key = (row.scene.as_str(), row.interval.as_str());
            if !keys.contains(&key) {
                keys.push(key);
            }
        }
        let plot = |(scene, interval): &(&str, &str)| {
            let of = cells.iter().filter(|Cells { row, .. }| row.scene == *scene && row.interval == *interval);
            let lines = of.map(|Cells { row, trials }| {
                let errors =
                    trials.iter().filter_map(|trial| Some((trial.seed as f64, trial.errors.as_ref()?.attitude_deg)));
                Line { name: row.config.clone(), points: errors.collect() }
            });
            let title = format!("{scene}, {interval}: attitude, degrees");
            Plot {
                title,
                x: "seed".to_owned(),
                y: String::new(),
                logarithmic: false,
                y_to: 0.0,
                lines: lines.collect(),
            }
            .svg()
        };
        keys.iter().map(plot).collect()
    }
}

impl Cells<'_> {
    fn text(&self) -> Vec<String> {
        let seeds = match self.row.unscored {
            0 => self.row.trials.to_string(),
            unscored => format!("{} ({unscored} not scored)", self.row.trials),
        };
        let mut cells = vec![self.row.scene.clone(), self.row.config.clone(), self.row.interval.clone(), seeds];
        cells.extend(PoseFigure::COLUMNS.iter().map(|figure| match figure {
            PoseFigure::Wrong => format!("{}/{}", self.row.wrong.count, self.row.wrong.of),
            figure => cell(*figure, &self.trials),
        }));
        cells
    }
}

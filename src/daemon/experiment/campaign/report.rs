//! What a campaign found.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::claims::Verdict;
use super::file::CampaignFile;
use crate::experiment::machine::Machine;
use crate::experiment::page;
use crate::experiment::plot::escaped;
use crate::experiment::registration::{Row, Set};
use crate::experiment::text::{self, COLUMNS};
use crate::experiment::trial::Trial;

/// What `tumbled campaign` measured.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled campaign --json")]
pub struct CampaignReport {
    /// The campaign.
    pub name: String,
    /// The program's version and commit.
    pub program: String,
    /// Where it ran.
    pub machine: Machine,
    /// The seed.
    pub seed: u64,
    /// Registrations at a time: with more than one, times are those of a shared machine.
    pub threads: u64,
    /// Whether the file's numbers of pairs were used: otherwise it is a rehearsal.
    pub whole: bool,
    /// Every claim holds.
    pub holds: bool,
    /// The claims.
    pub claims: Vec<Verdict>,
    /// A line for each set and method.
    pub rows: Vec<Row>,
}

/// Trials of a set, run by run.
pub type SetTrials = Vec<Vec<Trial>>;

impl CampaignReport {
    /// Of a campaign's sets, each with its trials.
    pub fn new(file: &CampaignFile, sets: &[(Set, SetTrials)], program: &str, threads: u64, whole: bool) -> Self {
        let pooled = |claim: &super::file::ClaimEntry| -> Vec<Trial> {
            let claimed = sets.iter().filter(|(set, _)| claim.sets.contains(&set.name));
            let runs = claimed.flat_map(|(set, trials)| set.runs.iter().zip(trials));
            runs.filter(|((method, _), _)| method.name() == claim.method)
                .flat_map(|(_, trials)| trials.clone())
                .collect()
        };
        let claims: Vec<Verdict> = file.claim.iter().map(|claim| Verdict::of(claim, &pooled(claim))).collect();
        Self {
            name: file.name.clone(),
            program: program.to_owned(),
            machine: Machine::this(),
            seed: file.seed,
            threads,
            whole,
            holds: claims.iter().all(|claim| claim.holds),
            rows: sets.iter().flat_map(|(set, trials)| set.rows(trials)).collect(),
            claims,
        }
    }

    fn status(verdict: &Verdict) -> &'static str {
        match (verdict.holds, verdict.reaches_aim) {
            (_, true) => "aim",
            (true, false) => "must",
            (false, false) => "MISSED",
        }
    }

    /// For a terminal.
    pub fn text(&self) -> String {
        let line = |verdict: &Verdict| {
            let claim = &verdict.claim;
            let what = format!("{}: {}", claim.about, claim.figure.name());
            vec![what, verdict.found(), claim.must.written(claim.figure), Self::status(verdict).to_owned()]
        };
        let lines: Vec<Vec<String>> = self.claims.iter().map(line).collect();
        let rows: Vec<Vec<String>> = self.rows.iter().map(|row| self.cells(row)).collect();
        let rehearsal = if self.whole { "" } else { "a rehearsal with other numbers of pairs than the campaign has\n" };
        format!(
            "{} on {}\n{rehearsal}\n{}\n{}",
            self.program,
            self.machine.line(),
            text::table(&["claim", "found", "must", "reached"], &lines),
            text::table(&Self::columns(), &rows)
        )
    }

    fn columns() -> Vec<&'static str> {
        ["set", "pairs", "points", "overlap"].into_iter().chain(COLUMNS).collect()
    }

    fn cells(&self, row: &Row) -> Vec<String> {
        let overlap = row.figures.overlap.map_or_else(|| "-".to_owned(), |overlap| format!("{:.2}", overlap.median));
        let mut cells = vec![
            row.set.clone(),
            row.figures.accepted.of.to_string(),
            format!("{}/{}", row.kinect_points, row.lidar_points),
            overlap,
        ];
        cells.extend(text::cells(&row.method, &row.start.name(), &row.figures));
        cells
    }

    /// For the documentation: the claims, and all rows.
    pub fn markdown(&self) -> String {
        let line = |cells: &[String]| format!("| {} |\n", cells.join(" | "));
        let head = |cells: &[&str]| {
            line(&cells.iter().map(|cell| (*cell).to_owned()).collect::<Vec<_>>())
                + &"| --- ".repeat(cells.len())
                + "|\n"
        };
        let verdict = |verdict: &Verdict| {
            let claim = &verdict.claim;
            let aim = claim.aim.map_or_else(String::new, |aim| aim.written(claim.figure));
            let found = verdict.found();
            let found = if verdict.holds { found } else { format!("**{found}**") };
            line(&[claim.about.clone(), claim.figure.name().to_owned(), claim.must.written(claim.figure), aim, found])
        };
        let rehearsal = if self.whole { "" } else { " A rehearsal with fewer pairs: no published figures." };
        format!(
            "`tumbled campaign {}`, {}, {}, {} at a time.{rehearsal}\n\n{}{}\n{}{}",
            self.name,
            self.program,
            self.machine.line(),
            self.threads,
            head(&["claim", "figure", "must", "aim", "found"]),
            self.claims.iter().map(verdict).collect::<String>(),
            head(&Self::columns()),
            self.rows.iter().map(|row| line(&self.cells(row))).collect::<String>()
        )
    }

    /// As a page.
    pub fn page(&self) -> String {
        let line = |verdict: &Verdict| {
            let claim = &verdict.claim;
            let class = if verdict.holds { "good" } else { "bad" };
            let wrap = |text: &str| format!("<td class=\"wrap\">{}</td>", escaped(text));
            vec![
                wrap(&claim.about),
                wrap(claim.figure.name()),
                claim.must.written(claim.figure),
                claim.aim.map_or_else(|| "-".to_owned(), |aim| aim.written(claim.figure)),
                verdict.found(),
                format!("<td class=\"{class}\">{}</td>", Self::status(verdict)),
            ]
        };
        let claims: Vec<Vec<String>> = self.claims.iter().map(line).collect();
        let rows: Vec<Vec<String>> = self.rows.iter().map(|row| self.cells(row)).collect();
        let rehearsal =
            if self.whole { "" } else { "<p class=\"bad\">A rehearsal with fewer pairs than the campaign has.</p>" };
        let body = format!(
            "<h1>Campaign {}</h1><p>{} on {}, seed {}, {} at a time. Right: within 5° and 5 cm at the moving cloud's centroid. \
            Errors and NEES are of the right ones, times of all; 95 %: Clopper and Pearson's bounds.</p>{rehearsal}\
            <h2>Claims</h2>{}<h2>Sets</h2>{}",
            escaped(&self.name),
            escaped(&self.program),
            escaped(&self.machine.line()),
            self.seed,
            self.threads,
            page::table(&["claim", "figure", "must", "aim", "found", "reached"], &claims),
            page::table(&Self::columns(), &rows)
        );
        page::page(&format!("tumbled: campaign {}", self.name), &body)
    }
}

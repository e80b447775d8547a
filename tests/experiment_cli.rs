//! `tumbled experiment` and `tumbled campaign`: what they measure is reproducible, and what they write is whole.

use serde_json::Value;
use tumbled::experiment::campaign::CampaignReport;
use tumbled::experiment::registration::ExperimentReport;

use crate::support::Workbench;

/// A report without what is measured by a clock.
fn without_times(mut report: Value) -> Value {
    fn strip(value: &mut Value) {
        match value {
            Value::Object(entries) => {
                entries.remove("time_ms");
                entries.values_mut().for_each(strip);
            }
            Value::Array(values) => values.iter_mut().for_each(strip),
            _ => {}
        }
    }
    strip(&mut report);
    report
}

fn lines(text: &str) -> Vec<Value> {
    text.lines().map(|line| without_times(serde_json::from_str(line).expect("a line of JSON"))).collect()
}

#[test]
fn an_experiment_is_the_same_for_a_seed_on_any_number_of_threads_and_writes_its_report() {
    let bench = Workbench::new();
    let run = |folder: &str, threads: &str, seed: &str| {
        let arguments = ["--points", "1239/126", "--pairs", "2", "--method", "gicp,cga-paper"];
        let more = ["--seed", seed, "--threads", threads, "-o", folder, "--json"];
        let done = bench.run(&[&["experiment", "registration"], &arguments[..], &more].concat());
        assert_eq!(done.code, 0, "{}", done.stderr);
        assert_eq!(bench.read(&format!("{folder}/report.json")), done.stdout);
        done
    };
    let (one, two, other) = (run("one", "1", "4"), run("two", "2", "4"), run("other", "1", "5"));
    let rows = |done: &crate::support::Done| without_times(done.json::<Value>())["rows"].clone();
    assert_eq!(rows(&one), rows(&two));
    assert_ne!(rows(&one), rows(&other));
    assert_eq!(lines(&bench.read("one/trials.jsonl")), lines(&bench.read("two/trials.jsonl")));
    // Two sets; gicp without and with a prior, cga-paper without.
    let report: ExperimentReport = one.json();
    let kinds: Vec<(&str, &str, String)> =
        report.rows.iter().map(|row| (row.set.as_str(), row.method.as_str(), row.start.name())).collect();
    let of = |set, method, start: &str| (set, method, start.to_owned());
    let runs = |set| [of(set, "gicp", "global"), of(set, "cga-paper", "global"), of(set, "gicp", "10 deg / 10 cm")];
    assert_eq!(kinds, [runs("views"), runs("low-overlap")].concat());
    assert!(report.rows.iter().all(|row| row.figures.right.of == 2 && row.figures.time_ms.is_some()));
    assert_eq!(lines(&bench.read("one/trials.jsonl")).len(), 6 * 2);
    let page = bench.read("one/report.html");
    assert!(page.contains("cga-paper") && page.contains("low-overlap") && !page.contains("http"));
}

#[test]
fn a_sweep_has_a_point_for_every_value_of_the_parameters_asked_for() {
    let bench = Workbench::new();
    let done = bench.run(&[
        "experiment",
        "registration",
        "--sweep",
        "m,epsilon",
        "--points",
        "1239/126",
        "--pairs",
        "1",
        "-o",
        "out",
        "--json",
    ]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let report: ExperimentReport = done.json();
    let count = |name: &str| report.sweep.iter().filter(|point| point.parameter.name() == name).count();
    assert_eq!((count("m"), count("epsilon"), report.sweep.len(), report.rows.len()), (9, 7, 16, 0));
    // Success, error and time of either parameter.
    assert_eq!(bench.read("out/report.html").matches("<svg").count(), 6);
    let wrong = bench.run(&["experiment", "registration", "--sweep", "k"]);
    assert_eq!(wrong.code, 2);
    assert!(wrong.stderr.contains("rho"), "{}", wrong.stderr);
}

#[test]
fn stored_pairs_are_registered_by_the_command_as_by_the_experiment() {
    let bench = Workbench::new();
    let arguments = ["--points", "1239/126", "--pairs", "1", "--method", "gicp", "-o", "out", "--store"];
    let done = bench.run(&[&["experiment", "registration"], &arguments[..]].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    let pair = |what: &str| format!("out/pairs/views-1239-126/0000-{what}");
    let (moving, reference) = (pair("kinect.ply"), pair("lidar.ply"));
    let done = bench.run(&["register", &moving, &reference, "--method", "gicp", "--json"]);
    let (found, first) = (done.json::<Value>(), lines(&bench.read("out/trials.jsonl"))[0].clone());
    assert_eq!([&found["score"], &found["rmse_m"]], [&first["score"], &first["rmse_m"]]);
    // What the pair's truth is called is what a guess is called.
    let guess = bench.run(&["register", &moving, &reference, "--init", &pair("truth.json"), "--json"]);
    assert_eq!(guess.code, 0, "{}", guess.stderr);
    // The prior that is stored is the one that the experiment began with; its quaternion is made of length 1 anew.
    let done =
        bench.run(&["register", &moving, &reference, "--method", "gicp", "--init", &pair("prior.json"), "--json"]);
    let (found, second) = (done.json::<Value>(), lines(&bench.read("out/trials.jsonl"))[1].clone());
    let score = |of: &Value| of["score"].as_f64().expect("a score");
    assert!((score(&found) - score(&second)).abs() < 1e-9, "{} {}", score(&found), score(&second));
    assert!((score(&found) - score(&first)).abs() > 1e-9, "the prior made no difference");
}

#[test]
fn a_scenes_crossings_are_registered_with_its_frames_and_held_against_its_truth() {
    let bench = Workbench::new();
    let arguments = ["--from", "sim:demo", "--pairs", "3", "--points", "1239/126", "--method", "gicp", "--json"];
    let done = bench.run(&[&["experiment", "registration"], &arguments[..]].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    let report: ExperimentReport = done.json();
    assert_eq!((report.truth.as_str(), report.rows.len()), ("scene", 2));
    // From 10 degrees and 10 cm beside the truth at least one of three comes back: clouds, frames and truth are of one
    // target.
    let prior = &report.rows[1];
    assert_eq!((prior.start.name().as_str(), prior.figures.right.of), ("10 deg / 10 cm", 3));
    assert!(prior.figures.right.count >= 1, "{:?}", prior.figures);
}

const CAMPAIGN: &str = "name = 'small'\nabout = 'a test'\nseed = 2\n\
    [[set]]\nid = 'near'\ntarget = 'box_bus'\npoints = [1239, 126]\nsights_deg = [0, 10]\nmethods = ['gicp', 'icp']\n\
    start = { prior = { rotation_deg = 1.0, translation_m = 0.01 } }\npairs = 2\n\
    [[claim]]\nabout = 'from next to the truth'\nsets = ['near']\nmethod = 'gicp'\nfigure = 'right'\nmust = { at_least = 0.5 }\n";

#[test]
fn a_campaign_says_what_holds_and_ends_with_3_where_something_does_not() {
    let bench = Workbench::new();
    let never =
        "[[claim]]\nabout = 'never'\nsets = ['near']\nmethod = 'icp'\nfigure = 'right'\nmust = { at_least = 1.5 }\n";
    bench.file("holds.toml", CAMPAIGN);
    bench.file("misses.toml", format!("{CAMPAIGN}{never}"));
    let done = bench.run(&["campaign", "holds.toml", "-o", "a", "--json"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let report: CampaignReport = done.json();
    assert!(report.holds && report.whole && report.claims.len() == 1 && report.rows.len() == 2);
    let done = bench.run(&["campaign", "misses.toml", "-o", "b", "--threads", "2"]);
    assert_eq!(done.code, 3, "{}", done.stderr);
    assert!(done.stdout.contains("MISSED"), "{}", done.stdout);
    let rows = |folder: &str| {
        let report = bench.read(&format!("{folder}/campaign.json"));
        without_times(serde_json::from_str(&report).expect("JSON"))["rows"].clone()
    };
    assert_eq!(rows("a"), rows("b"));
    let markdown = bench.read("b/campaign.md");
    assert!(markdown.contains("| never | right |") && markdown.contains("**"), "{markdown}");
    assert!(bench.read("b/campaign.html").contains("never"));
    assert_eq!(bench.read("a/trials.jsonl").lines().count(), 4);
}

#[test]
fn what_is_no_campaign_is_refused_before_anything_is_measured() {
    let bench = Workbench::new();
    let missing = bench.run(&["campaign", "nothing.toml", "-o", "out"]);
    assert_eq!(missing.code, 2);
    assert!(missing.stderr.contains("nothing.toml") && missing.stderr.contains("registration"), "{}", missing.stderr);
    bench.file("wrong.toml", CAMPAIGN.replace("'gicp', 'icp'", "'fmr'"));
    let wrong = bench.run(&["campaign", "wrong.toml", "-o", "out"]);
    assert_eq!(wrong.code, 2);
    assert!(wrong.stderr.contains("fmr") && !bench.path("out").exists(), "{}", wrong.stderr);
}

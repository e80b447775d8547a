//! The methods that ours is compared with, against small_gicp 1.0.1 and Open3D 0.20.0 of PyPI, on the same pairs from the same
//! start with the same settings.
//!
//! Wants `TUMBLED_FOREIGN_PYTHON`, a Python that has both: `python3 -m venv venv && venv/bin/pip install small-gicp==1.0.1
//! open3d==0.20.0`, then
//! `TUMBLED_FOREIGN_PYTHON=venv/bin/python cargo test --test main foreign_registration -- --nocapture`, and with
//! `--release` and `--include-ignored` for the denser pairs. Without it the tests print that they were skipped.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use nalgebra::{Isometry3, Matrix4, Rotation3, Translation3, UnitQuaternion};
use rayon::prelude::*;
use serde::Deserialize;
use serde_json::{Value, json};
use tumbled::experiment::figures::Spread;
use tumbled::experiment::trial::{RIGHT_DEG, RIGHT_M, centroid};
use tumbled::experiment::{Attitudes, Pair, PairSpec, PointCounts, Stand, Start, stored};
use tumbled_core::Workers;
use tumbled_core::register::baseline::{IterationOptions, Target};
use tumbled_core::register::{Method, MethodOptions, register};
use tumbled_sim::target::TargetKind;

use crate::support::{Workbench, repository};

/// Pairs of a set. A median of 60 moves by a tenth with one or two of them.
const PAIRS: u64 = 150;
const SEED: u64 = 5;

/// How far results may be from each other: two cases of every 50 pairs, and a tenth of the medians of the right ones.
const CASES: usize = 2 * PAIRS as usize / 50;
const SHARE: f64 = 0.1;
/// Where some thirty of the 150 are right: a median of so few is known to a fifth.
const SHARE_OF_FEW: f64 = 0.2;

/// The methods, their peers, and whether a method is held to that one. Open3D ends where its error ceases to change, and not by
/// the size of a step; small_gicp's residual to a plane is weighed component by component with the normal's, which is not the
/// distance from the plane: point to plane is held to Open3D's.
const PEERS: [(Method, &str, bool); 5] = [
    (Method::Icp, "small_gicp ICP", true),
    (Method::Icp, "Open3D point to point", false),
    (Method::PlaneIcp, "Open3D point to plane", true),
    (Method::PlaneIcp, "small_gicp PLANE_ICP", false),
    (Method::Gicp, "small_gicp GICP", true),
];

fn python() -> Option<PathBuf> {
    crate::support::foreign::python("numpy, open3d, small_gicp", "small_gicp and open3d")
}

/// A line of what the script writes.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Line {
    pair: u64,
    method: String,
    peer: String,
    t_reference_moving: [[f64; 4]; 4],
}

impl Line {
    fn pose(&self) -> Isometry3<f64> {
        let matrix = Matrix4::from(self.t_reference_moving).transpose();
        let rotation = Rotation3::from_matrix_unchecked(matrix.fixed_view::<3, 3>(0, 0).into_owned());
        let translation = Translation3::new(matrix.m14, matrix.m24, matrix.m34);
        Isometry3::from_parts(translation, UnitQuaternion::from_rotation_matrix(&rotation))
    }
}

/// How far two poses are from each other: degrees, and m at the moving cloud's centroid.
fn apart(pair: &Pair, a: &Isometry3<f64>, b: &Isometry3<f64>) -> (f64, f64) {
    let centre = centroid(&pair.moving);
    (a.rotation.angle_to(&b.rotation).to_degrees(), (a * centre - b * centre).norm())
}

fn is_right(pair: &Pair, pose: &Isometry3<f64>) -> bool {
    let (rotation_deg, translation_m) = apart(pair, pose, &pair.truth.expect("simulated"));
    rotation_deg < RIGHT_DEG && translation_m < RIGHT_M
}

/// How many of a method's poses are right, and the medians of their errors: degrees and mm.
fn figures(pairs: &[Pair], poses: &[Isometry3<f64>]) -> (usize, f64, f64) {
    let right = || pairs.iter().zip(poses).filter(|(pair, pose)| is_right(pair, pose));
    let errors = || right().map(|(pair, pose)| apart(pair, pose, &pair.truth.expect("simulated")));
    let median = |numbers: Vec<f64>| Spread::of(numbers.into_iter()).map_or(f64::NAN, |spread| spread.median);
    (
        right().count(),
        median(errors().map(|error| error.0).collect()),
        1e3 * median(errors().map(|error| error.1).collect()),
    )
}

fn pairs(points: PointCounts, sights_deg: [f64; 2]) -> Vec<Pair> {
    let spec = PairSpec {
        target: TargetKind::BoxBus,
        points,
        sights_deg,
        overlap: [0.0, 1.0],
        attitudes: Attitudes::Random,
        organised: false,
    };
    let stand = Stand::new(spec.target).expect("a stand");
    (0..PAIRS).into_par_iter().map(|number| stand.pair(&spec, SEED, number).expect("a pair")).collect()
}

/// What the script is told of a method.
fn settings(options: &IterationOptions) -> Value {
    let target = match options.target {
        Target::Denser => "denser",
        Target::Sparser => "sparser",
        Target::Reference => panic!("the script knows targets by their density"),
    };
    json!({
        "target": target,
        "max_distance_m": options.max_distance_m,
        "rotation_epsilon_rad": options.rotation_epsilon_rad,
        "translation_epsilon_m": options.translation_epsilon_m,
        "max_iterations": options.max_iterations,
        "neighbours": options.neighbours,
    })
}

/// What the others make of the pairs, by peer.
fn theirs(python: &Path, pairs: &[Pair], options: &MethodOptions) -> BTreeMap<String, Vec<Isometry3<f64>>> {
    let bench = Workbench::new();
    for pair in pairs {
        stored::write(pair, Start::PRIOR.prior(pair, SEED).as_ref(), &bench.path("")).expect("writes a pair");
    }
    let (points, planes) = (settings(&options.points), settings(&options.planes));
    bench.file("settings.json", json!({ "icp": points, "gicp": points, "plane-icp": planes }).to_string());
    let script = repository().join("tests/foreign/registration_peers.py");
    let poses = bench.path("poses.jsonl");
    let output = Command::new(python).arg(script).args([&bench.path(""), &poses]).output().expect("Python runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let mut found: BTreeMap<String, Vec<Isometry3<f64>>> = BTreeMap::new();
    for text in bench.read("poses.jsonl").lines() {
        let line: Line = serde_json::from_str(text).expect("a line");
        assert!(PEERS.iter().any(|(method, peer, _)| (method.name(), *peer) == (&line.method, &line.peer)), "{text}");
        let poses = found.entry(line.peer.clone()).or_default();
        assert_eq!(line.pair, poses.len() as u64, "pairs in their order");
        poses.push(line.pose());
    }
    found
}

/// Holds the methods to the peers whose algorithm is theirs, and prints a line for each of the others too.
fn assert_the_same(points: PointCounts, sights_deg: [f64; 2], share: f64) {
    let Some(python) = python() else { return };
    let (pairs, options) = (pairs(points, sights_deg), MethodOptions::default());
    let theirs = theirs(&python, &pairs, &options);
    let ours = |method: Method| -> Vec<Isometry3<f64>> {
        let pose = |pair: &Pair| {
            let prior = Start::PRIOR.prior(pair, SEED);
            let none = Workers::none();
            let found = register(&pair.moving, &pair.reference, method, prior.as_ref(), &options, &none);
            found.expect("clouds").t_reference_moving
        };
        pairs.iter().map(pose).collect()
    };
    let [low, high] = sights_deg;
    println!("{PAIRS} pairs of {points}, sights {low} to {high} degrees apart");
    println!("| method | right | deg | mm | peer | right | deg | mm | apart, deg | apart, mm |");
    println!("|---|---|---|---|---|---|---|---|---|---|");
    let mut missed = Vec::new();
    for (method, peer, is_held_to_it) in PEERS {
        let (ours, theirs) = (ours(method), &theirs[peer]);
        assert_eq!(theirs.len(), pairs.len(), "{peer}");
        let (our, their) = (figures(&pairs, &ours), figures(&pairs, theirs));
        let both =
            pairs.iter().zip(ours.iter().zip(theirs)).filter(|(pair, (a, b))| is_right(pair, a) && is_right(pair, b));
        let between: Vec<(f64, f64)> = both.map(|(pair, (a, b))| apart(pair, a, b)).collect();
        let median = |of: fn(&(f64, f64)) -> f64| Spread::of(between.iter().map(of)).map_or(f64::NAN, |s| s.median);
        println!(
            "| {} | {} | {:.2} | {:.1} | {peer} | {} | {:.2} | {:.1} | {:.3} | {:.2} |",
            method.name(),
            our.0,
            our.1,
            our.2,
            their.0,
            their.1,
            their.2,
            median(|between| between.0),
            1e3 * median(|between| between.1),
        );
        let within = |ours: f64, theirs: f64| (ours / theirs - 1.0).abs() <= share;
        let same = our.0.abs_diff(their.0) <= CASES && within(our.1, their.1) && within(our.2, their.2);
        if is_held_to_it && !same {
            missed.push(format!("{} {our:?}, {peer} {their:?}", method.name()));
        }
    }
    assert!(missed.is_empty(), "{points}, {sights_deg:?}: {missed:?}");
}

#[test]
fn baselines_do_as_their_peers_do() {
    assert_the_same(PointCounts { kinect: 1239, lidar: 126 }, [0.0, 40.0], SHARE);
}

#[test]
#[ignore = "minutes"]
fn baselines_do_as_their_peers_do_on_denser_clouds_and_with_sights_far_apart() {
    assert_the_same(PointCounts { kinect: 2653, lidar: 358 }, [0.0, 40.0], SHARE);
    assert_the_same(PointCounts { kinect: 8105, lidar: 828 }, [0.0, 40.0], SHARE);
    assert_the_same(PointCounts { kinect: 2653, lidar: 358 }, [40.0, 80.0], SHARE_OF_FEW);
}

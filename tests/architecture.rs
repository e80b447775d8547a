//! Who may import whom.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::Value;

use crate::support::repository;

/// The arrows: a member crate and the members it may import. The root may import everything.
const ARROWS: &[(&str, &[&str])] = &[
    ("tumbled-model", &[]),
    ("tumbled-velodyne", &["tumbled-model"]),
    ("tumbled-kinect", &["tumbled-model"]),
    ("tumbled-serial", &["tumbled-model"]),
    ("tumbled-calib", &["tumbled-model"]),
    ("tumbled-core", &["tumbled-model", "tumbled-velodyne", "tumbled-kinect", "tumbled-serial"]),
    ("tumbled-sim", &["tumbled-model", "tumbled-velodyne", "tumbled-kinect", "tumbled-serial"]),
    (
        "tumbled-io",
        &["tumbled-model", "tumbled-velodyne", "tumbled-kinect", "tumbled-serial", "tumbled-sim", "tumbled-freenect"],
    ),
    ("tumbled-freenect", &["freenect-sys", "tumbled-model"]),
    ("freenect-sys", &[]),
    ("fake-libusb", &["fake-libusb-control"]),
    ("fake-libusb-control", &[]),
];

/// What a crate's tests may import besides: the solvers are tried on encoded measurements, the simulated clocks with the
/// mapper that has to follow them; the Kinect's driver with the stand-in for libusb.
const TEST_ARROWS: &[(&str, &[&str])] = &[
    ("tumbled-calib", &["tumbled-velodyne", "tumbled-kinect"]),
    ("tumbled-sim", &["tumbled-core"]),
    ("fake-libusb", &["tumbled-kinect", "tumbled-model"]),
    ("tumbled-freenect", &["fake-libusb-control"]),
    ("tumbled-io", &["fake-libusb-control"]),
];

/// Crates without clock, file, socket, thread or `unsafe`.
const PURE: &[&str] = &[
    "tumbled-model",
    "tumbled-core",
    "tumbled-sim",
    "tumbled-calib",
    "tumbled-velodyne",
    "tumbled-kinect",
    "tumbled-serial",
];

/// Foreign crates that appear in exactly one member, tests included.
const AT_HOME: &[(&str, &str)] = &[
    ("serde_json", "tumbled"),
    ("toml", "tumbled"),
    ("clap", "tumbled"),
    ("axum", "tumbled"),
    ("foxglove", "tumbled"),
    ("mcap", "tumbled-io"),
];

/// What the vocabulary may be built on.
const MODEL_IMPORTS: &[&str] = &["bytes", "libm", "nalgebra", "serde", "thiserror"];

/// A member of the workspace.
struct Member {
    name: String,
    folder: PathBuf,
    /// (name, is a dev-dependency)
    imports: Vec<(String, bool)>,
}

fn members() -> Vec<Member> {
    let cargo = std::env::var("CARGO").unwrap_or_else(|_| "cargo".to_owned());
    let output = Command::new(cargo)
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline"])
        .current_dir(repository())
        .output()
        .expect("cargo metadata runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let metadata: Value = serde_json::from_slice(&output.stdout).expect("cargo metadata prints JSON");
    let packages = metadata["packages"].as_array().expect("packages");
    let members: Vec<Member> = packages.iter().map(member).collect();
    assert!(members.iter().any(|member| member.name == "tumbled"), "the root is a member");
    members
}

fn member(package: &Value) -> Member {
    let text = |value: &Value| value.as_str().expect("a text").to_owned();
    let imports = package["dependencies"].as_array().expect("dependencies").iter();
    Member {
        name: text(&package["name"]),
        folder: Path::new(&text(&package["manifest_path"])).parent().expect("a folder").to_path_buf(),
        imports: imports.map(|import| (text(&import["name"]), import["kind"] == "dev")).collect(),
    }
}

fn listed<'a>(table: &'a [(&str, &[&str])], name: &str) -> Option<&'a [&'a str]> {
    table.iter().find(|(member, _)| *member == name).map(|(_, allowed)| *allowed)
}

#[test]
fn arrows_never_turn_back() {
    let members = members();
    for member in members.iter().filter(|member| member.name != "tumbled") {
        let name = &member.name;
        let allowed = listed(ARROWS, name).unwrap_or_else(|| panic!("{name} is new: give it its arrows here"));
        let in_tests = listed(TEST_ARROWS, name).unwrap_or_default();
        for (import, dev) in &member.imports {
            let foreign = !members.iter().any(|other| other.name == *import);
            let fine = foreign || allowed.contains(&import.as_str()) || (*dev && in_tests.contains(&import.as_str()));
            assert!(fine, "{name} may not import {import}");
        }
    }
}

#[test]
fn encodings_and_arguments_stay_at_home() {
    let home: BTreeMap<&str, &str> = AT_HOME.iter().copied().collect();
    for member in members() {
        for (import, _) in &member.imports {
            let fine = home.get(import.as_str()).is_none_or(|home| *home == member.name);
            assert!(fine, "{} may not import {import}: it belongs in {}", member.name, home[import.as_str()]);
        }
    }
}

#[test]
fn the_vocabulary_is_built_on_little() {
    let members = members();
    let model = members.iter().find(|member| member.name == "tumbled-model").expect("the model");
    for (import, _) in model.imports.iter().filter(|(_, dev)| !dev) {
        assert!(MODEL_IMPORTS.contains(&import.as_str()), "tumbled-model may not import {import}");
    }
}

#[test]
fn pure_crates_forbid_unsafe_and_have_their_own_lints() {
    for member in members().iter().filter(|member| PURE.contains(&member.name.as_str())) {
        let root = fs::read_to_string(member.folder.join("src/lib.rs")).expect("src/lib.rs");
        assert!(root.contains("#![forbid(unsafe_code)]"), "{} does not forbid unsafe code", member.name);
        let lints = fs::read_to_string(member.folder.join("clippy.toml")).unwrap_or_default();
        for banned in ["std::time::Instant::now", "std::thread::spawn", "f64::sin", "std::collections::HashMap"] {
            assert!(lints.contains(banned), "{}: its clippy.toml does not ban {banned}", member.name);
        }
    }
}

/// Clippy bans single functions; whole modules of std are looked for in the text.
#[test]
fn pure_crates_touch_no_file_socket_thread_or_terminal() {
    let banned = ["std::fs", "std::net", "std::thread", "std::env", "std::process", "println!", "print!(", "dbg!"];
    for member in members().iter().filter(|member| PURE.contains(&member.name.as_str())) {
        for file in sources(&member.folder.join("src")) {
            let text = fs::read_to_string(&file).expect("a source");
            // Tests at the end of a file may read captures.
            let code = text.split("#[cfg(test)]").next().unwrap_or_default();
            let lines = code.lines().enumerate().filter(|(_, line)| !line.trim_start().starts_with("//"));
            for (number, line) in lines {
                let found = banned.iter().find(|word| line.contains(**word));
                assert!(found.is_none(), "{}:{}: {line}", file.display(), number + 1);
            }
        }
    }
}

/// The Rust files of a folder; files of tests alone are left out.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        if path.is_dir() && name != "tests" {
            found.extend(sources(&path));
        } else if name.ends_with(".rs") && !name.ends_with("tests.rs") {
            found.push(path);
        }
    }
    found
}

//! What holds for every command: help, version, exit codes, a reader that leaves.

use std::io::Read;
use std::process::{Command, Stdio};

use crate::support::Workbench;

#[test]
fn help_lists_exactly_the_commands_that_work() {
    let bench = Workbench::new();
    insta::assert_snapshot!("help", bench.run(&["--help"]).transcript());
    insta::assert_snapshot!("help_config", bench.run(&["config", "--help"]).transcript());
    insta::assert_snapshot!("help_config_check", bench.run(&["config", "check", "--help"]).transcript());
    insta::assert_snapshot!("help_config_show", bench.run(&["config", "show", "--help"]).transcript());
    insta::assert_snapshot!("help_config_init", bench.run(&["config", "init", "--help"]).transcript());
}

#[test]
fn version_is_the_packages_and_names_the_commit_if_known() {
    let done = Workbench::new().run(&["--version"]);
    let version = done.stdout.trim().strip_prefix("tumbled ").expect("name first").to_owned();
    let rest = version.strip_prefix(env!("CARGO_PKG_VERSION")).expect("the package's version");
    let commit = rest.strip_prefix(" (").and_then(|rest| rest.strip_suffix(')'));
    let hex = |commit: &str| commit.len() >= 12 && commit.chars().all(|c| c.is_ascii_hexdigit());
    assert!(rest.is_empty() || commit.is_some_and(hex), "{version}");
}

#[test]
fn bad_usage_is_exit_code_2_and_leaves_stdout_alone() {
    let bench = Workbench::new();
    for arguments in
        [&["confog"][..], &["config", "check", "--jsn"], &["config"], &[], &["-v", "-q", "config", "check"]]
    {
        let done = bench.run(arguments);
        assert_eq!((done.code, done.stdout.as_str()), (2, ""), "{arguments:?}: {}", done.stderr);
    }
}

#[test]
fn stderr_that_is_no_terminal_gets_no_colours() {
    let bench = Workbench::new();
    bench.file("rig.toml", "[rig]\nnam = 'x'\n");
    let done = bench.run(&["config", "check", "rig.toml"]);
    assert!(done.stderr.contains("nam") && !done.stderr.contains('\u{1b}'), "{}", done.stderr);
}

#[test]
fn a_reader_that_leaves_is_no_failure() {
    // The schema (about 20 kB) fits into a pipe (64 KiB), so the reader must be gone before the command writes: the
    // pipe's only read end is closed before the command starts.
    let (reader, writer) = std::io::pipe().expect("a pipe");
    drop(reader);
    let mut child = Command::new(assert_cmd::cargo::cargo_bin!("tumbled"))
        .args(["config", "schema"])
        .stdout(writer)
        .stderr(Stdio::piped())
        .spawn()
        .expect("tumbled starts");
    let status = child.wait().expect("tumbled ends");
    let mut stderr = String::new();
    child.stderr.take().expect("piped").read_to_string(&mut stderr).expect("UTF-8");
    assert_eq!((status.code(), stderr.as_str()), (Some(0), ""));
}

#[test]
fn an_output_that_cannot_be_written_is_exit_code_1() {
    // /dev/full takes nothing: every write ends with "no space left on device".
    let Ok(full) = std::fs::OpenOptions::new().write(true).open("/dev/full") else {
        println!("skipped: /dev/full is not there");
        return;
    };
    let output = Command::new(assert_cmd::cargo::cargo_bin!("tumbled"))
        .args(["config", "schema"])
        .stdout(full)
        .output()
        .expect("tumbled runs");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("cannot write to standard output"), "{stderr}");
}

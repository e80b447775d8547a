//! A fresh directory and the `tumbled` command in it.

pub(crate) mod browser;
pub(crate) mod daemon;
pub(crate) mod foreign;
pub(crate) mod ledger;
pub(crate) mod pcap;
pub(crate) mod real;
pub(crate) mod replaying;
pub(crate) mod rig;
pub(crate) mod stage;
pub(crate) mod states;
pub(crate) mod stream;
#[cfg(feature = "kinect-usb")]
pub(crate) mod usb;

use std::fs;
use std::path::{Path, PathBuf};

/// A directory of its own for one test; removed when dropped.
pub(crate) struct Workbench {
    directory: tempfile::TempDir,
}

/// What a command did.
#[derive(Debug)]
pub(crate) struct Done {
    /// Its exit code; -1 if a signal ended it.
    pub(crate) code: i32,
    /// What it wrote to stdout.
    pub(crate) stdout: String,
    /// What it wrote to stderr.
    pub(crate) stderr: String,
}

impl Workbench {
    pub(crate) fn new() -> Self {
        Self { directory: tempfile::tempdir().expect("a temporary directory") }
    }

    /// Writes a file, creating its directories.
    pub(crate) fn file(&self, name: &str, text: impl AsRef<[u8]>) -> PathBuf {
        let path = self.path(name);
        fs::create_dir_all(path.parent().expect("inside the workbench")).expect("creates directories");
        fs::write(&path, text).expect("writes a file");
        path
    }

    pub(crate) fn read(&self, name: &str) -> String {
        fs::read_to_string(self.path(name)).expect("reads a file")
    }

    pub(crate) fn read_bytes(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).expect("reads a file")
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.directory.path().join(name)
    }

    /// The command, not run yet, in this directory.
    pub(crate) fn command(&self) -> assert_cmd::Command {
        let mut command = assert_cmd::cargo::cargo_bin_cmd!("tumbled");
        command.current_dir(self.directory.path());
        command
    }

    /// The LiDAR points of an input, read with a config, as pts.
    pub(crate) fn points(&self, input: &str, config: &str) -> Vec<u8> {
        let output = ["--what", "lidar-points", "--format", "pts", "-o", "points.pts"];
        let done = self.run(&[&["export", input, "--config", config], &output[..]].concat());
        assert_eq!(done.code, 0, "{}", done.stderr);
        self.read_bytes("points.pts")
    }

    /// Runs `tumbled` with these arguments in this directory.
    pub(crate) fn run(&self, arguments: &[&str]) -> Done {
        let output = self.command().args(arguments).output().expect("tumbled runs");
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).expect("UTF-8");
        Done { code: output.status.code().unwrap_or(-1), stdout: text(output.stdout), stderr: text(output.stderr) }
    }
}

impl Done {
    /// Exit code, stdout and stderr in one text, for snapshots.
    pub(crate) fn transcript(&self) -> String {
        format!("exit code {}\n--- stdout\n{}--- stderr\n{}", self.code, self.stdout, self.stderr)
    }

    /// Stdout as JSON of a type; an unknown or missing field fails the test.
    pub(crate) fn json<T: serde::de::DeserializeOwned>(&self) -> T {
        serde_json::from_str(&self.stdout).unwrap_or_else(|error| panic!("{error} in {}", self.stdout))
    }
}

/// The root of the repository.
pub(crate) fn repository() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

//! Running `kinect-dump`, and reading what it prints.

#![allow(dead_code, reason = "each test binary uses its own part")]

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The first line of every recorded depth file.
pub(crate) const HEADER: &[u8] = b"P5 640 480 65535\n";

/// What a run printed, and how it ended.
#[derive(Debug)]
pub(crate) struct Dumped {
    pub(crate) lines: Vec<String>,
    pub(crate) code: Option<i32>,
}

impl Dumped {
    /// The first line that begins with this word, without it.
    pub(crate) fn said(&self, word: &str) -> &str {
        self.lines.iter().find_map(|line| line.strip_prefix(word)?.strip_prefix(' ')).unwrap_or_default()
    }

    /// The lines of frames.
    pub(crate) fn frames(&self) -> Vec<FrameLine> {
        self.lines.iter().filter_map(|line| FrameLine::parse(line)).collect()
    }
}

/// A frame as it was printed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct FrameLine {
    pub(crate) ticks: u32,
    pub(crate) encoding: String,
    pub(crate) missing: u32,
    pub(crate) lost: Vec<u16>,
    pub(crate) bytes: usize,
    pub(crate) digest: String,
}

impl FrameLine {
    fn parse(line: &str) -> Option<Self> {
        let field = |name: &str| line.split(' ').find_map(|word| word.strip_prefix(name)?.strip_prefix('='));
        line.strip_prefix("frame ")?;
        let lost = field("lost")?;
        let lost =
            if lost == "-" { Vec::new() } else { lost.split(',').map(|n| n.parse().expect("a packet")).collect() };
        Some(Self {
            ticks: field("ticks")?.parse().ok()?,
            encoding: field("encoding")?.to_owned(),
            missing: field("missing")?.parse().ok()?,
            lost,
            bytes: field("bytes")?.parse().ok()?,
            digest: field("digest")?.to_owned(),
        })
    }
}

/// Runs it with these variables in its environment.
pub(crate) fn dump<K: AsRef<OsStr>, V: AsRef<OsStr>>(environment: &[(K, V)], arguments: &[&str]) -> Dumped {
    let mut command = Command::new(env!("CARGO_BIN_EXE_kinect-dump"));
    command.args(arguments).env_remove("FAKENECT_PATH");
    for (name, value) in environment {
        command.env(name, value);
    }
    let Output { status, stdout, .. } = command.output().expect("kinect-dump runs");
    // The player writes to the same stream.
    let own = ["opened ", "frame ", "ended ", "stopped ", "error ", "warning ", "acceleration "];
    let text = String::from_utf8_lossy(&stdout).into_owned();
    let lines = text.lines().filter(|line| own.iter().any(|word| line.starts_with(word))).map(str::to_owned).collect();
    Dumped { lines, code: status.code() }
}

/// FNV-1a, 64 bits, as the dump prints it.
pub(crate) fn digest(bytes: &[u8]) -> String {
    let hash = bytes
        .iter()
        .fold(0xcbf2_9ce4_8422_2325u64, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3));
    format!("{hash:016x}")
}

/// The payload of a real recorded frame, 16-bit little-endian; `None`, and a printed line, where it is not.
pub(crate) fn real_frame() -> Option<Vec<u8>> {
    let real = "../shared/data/kinect/raw11/nyu_raw11_le.pgm";
    match std::fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(real)) {
        Ok(file) => Some(file.strip_prefix(HEADER).expect("its header").to_vec()),
        Err(_) => {
            println!("skipped: {real} is not there");
            None
        }
    }
}

/// Where the player's library lies: beside the real one, in a folder of its own.
pub(crate) fn player() -> Option<PathBuf> {
    let output = Command::new("pkg-config").args(["--variable=libdir", "libfreenect"]).output().ok()?;
    let folder = PathBuf::from(String::from_utf8(output.stdout).ok()?.trim()).join("fakenect");
    if folder.join("libfreenect.so.0.5").exists() {
        return Some(folder);
    }
    println!("skipped: no fakenect folder beside libfreenect");
    None
}

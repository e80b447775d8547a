//! Building the stand-in, setting it up for a child process, and talking to it.

use std::ffi::OsString;
use std::io::{self, BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use std::time::{Duration, Instant};
use std::{env, fs, thread};

use crate::journal::Journal;
use crate::script::VARIABLE;
use crate::truth::Truth;

/// How long a reply may take.
const REPLY: Duration = Duration::from_secs(20);

/// The stand-in's shared object, built if it is not up to date; the error is what cargo said.
pub fn library() -> Result<PathBuf, String> {
    static BUILT: OnceLock<Result<PathBuf, String>> = OnceLock::new();
    BUILT.get_or_init(build).clone()
}

fn build() -> Result<PathBuf, String> {
    let target = target_folder()?;
    let output = Command::new(env!("CARGO"))
        .args(["build", "--quiet", "--package", "fake-libusb", "--target-dir"])
        .arg(&target)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        // The caller may itself run under the stand-in or another preloaded library.
        .env_remove("LD_PRELOAD")
        .output()
        .map_err(|error| format!("cargo does not run: {error}"))?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).into_owned());
    }
    let library = target.join("debug").join("libfake_libusb.so");
    if library.is_file() { Ok(library) } else { Err(format!("cargo built no {}", library.display())) }
}

/// The folder this test was built into: the first ancestor of the executable that cargo marked as its own.
fn target_folder() -> Result<PathBuf, String> {
    let program = env::current_exe().map_err(|error| format!("this program has no path: {error}"))?;
    let marked = program.ancestors().filter(|folder| folder.join("CACHEDIR.TAG").is_file()).last();
    marked.map(Path::to_path_buf).ok_or_else(|| format!("{} lies in no target folder", program.display()))
}

/// A stand-in set up in a folder, for one child process at a time.
#[derive(Clone, Debug)]
pub struct Standin {
    folder: PathBuf,
    library: PathBuf,
}

impl Standin {
    /// Builds the stand-in and writes `script` to the folder, with control, log and truth in the folder too.
    pub fn new(folder: &Path, script: &str) -> io::Result<Self> {
        let library = library().map_err(io::Error::other)?;
        let text = format!("{}\ncontrol usb.sock\nlog usb.log\ntruth usb.truth\n", script.trim_end());
        fs::write(folder.join("usb.script"), text)?;
        Ok(Self { folder: folder.to_path_buf(), library })
    }

    /// What the child's environment needs.
    pub fn environment(&self) -> [(OsString, OsString); 2] {
        [
            ("LD_PRELOAD".into(), self.library.clone().into_os_string()),
            (VARIABLE.into(), self.folder.join("usb.script").into_os_string()),
        ]
    }

    /// Connects to the stand-in within a running child, waiting for its first `libusb_init` as long as `within`.
    pub fn connect(&self, within: Duration) -> io::Result<Control> {
        let until = Instant::now() + within;
        loop {
            match UnixStream::connect(self.folder.join("usb.sock")) {
                Ok(stream) => return Control::new(stream),
                Err(error) if Instant::now() >= until => return Err(error),
                Err(_) => thread::sleep(Duration::from_millis(10)),
            }
        }
    }

    /// What the library did so far.
    pub fn journal(&self) -> io::Result<Journal> {
        Journal::read(&self.folder.join("usb.log"))
    }

    /// What the devices sent so far.
    pub fn truth(&self) -> io::Result<Truth> {
        Truth::read(&self.folder.join("usb.truth"))
    }
}

/// A connection to a running stand-in.
#[derive(Debug)]
pub struct Control {
    stream: BufReader<UnixStream>,
}

impl Control {
    fn new(stream: UnixStream) -> io::Result<Self> {
        stream.set_read_timeout(Some(REPLY))?;
        stream.set_write_timeout(Some(REPLY))?;
        Ok(Self { stream: BufReader::new(stream) })
    }

    /// Sends one line (a fault as in the script, or `status`) and waits until it has been done; gives what follows `ok`.
    pub fn send(&mut self, line: &str) -> io::Result<String> {
        self.stream.get_mut().write_all(format!("{line}\n").as_bytes())?;
        let mut reply = String::new();
        self.stream.read_line(&mut reply)?;
        match reply.trim_end().strip_prefix("ok") {
            Some(rest) => Ok(rest.trim_start().to_owned()),
            None if reply.is_empty() => Err(io::ErrorKind::UnexpectedEof.into()),
            None => Err(io::Error::other(format!("`{line}`: {}", reply.trim_end()))),
        }
    }

    /// What the library holds at this moment.
    pub fn status(&mut self) -> io::Result<Status> {
        let reply = self.send("status")?;
        Status::parse(&reply).ok_or_else(|| io::Error::other(format!("`{reply}` is no status")))
    }
}

/// What the library holds at one moment, over all devices.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Status {
    /// libusb contexts.
    pub contexts: usize,
    /// Open device handles.
    pub handles: usize,
    /// Claimed interfaces.
    pub claims: usize,
    /// Allocated transfers.
    pub transfers: usize,
    /// Submitted transfers that have not come back.
    pub in_flight: usize,
    /// References to devices from lists that were not freed.
    pub references: usize,
    /// Frames begun.
    pub frames: u64,
    /// Devices on the bus.
    pub plugged: usize,
    /// Devices whose depth is running.
    pub streaming: usize,
}

impl Status {
    /// Reads `contexts=1 handles=0 …`; `None` if a name is missing or unknown.
    pub fn parse(text: &str) -> Option<Self> {
        let mut status = Self::default();
        let mut read = 0;
        for word in text.split_whitespace() {
            let (name, value) = word.split_once('=')?;
            let place = match name {
                "contexts" => &mut status.contexts,
                "handles" => &mut status.handles,
                "claims" => &mut status.claims,
                "transfers" => &mut status.transfers,
                "in_flight" => &mut status.in_flight,
                "references" => &mut status.references,
                "plugged" => &mut status.plugged,
                "streaming" => &mut status.streaming,
                "frames" => {
                    status.frames = value.parse().ok()?;
                    read += 1;
                    continue;
                }
                _ => return None,
            };
            *place = value.parse().ok()?;
            read += 1;
        }
        (read == 9).then_some(status)
    }
}

impl std::fmt::Display for Status {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { contexts, handles, claims, transfers, in_flight, references, frames, plugged, streaming } = self;
        write!(
            f,
            "contexts={contexts} handles={handles} claims={claims} transfers={transfers} in_flight={in_flight} \
             references={references} frames={frames} plugged={plugged} streaming={streaming}"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_status_reads_as_it_is_written() {
        let status = Status { handles: 2, in_flight: 16, frames: 1 << 40, ..Status::default() };
        assert_eq!(Status::parse(&status.to_string()), Some(status));
        assert_eq!(Status::parse("handles=2"), None);
    }
}

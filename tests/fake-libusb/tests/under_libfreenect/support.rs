//! A host program on the real libfreenect, run under the stand-in.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::OnceLock;
use std::time::Duration;

use fake_libusb_control::frames::FRAME_TICKS;
use fake_libusb_control::{Control, FrameWriter, Standin};
use tempfile::TempDir;
use tumbled_kinect::packed::pack_group;

/// Pixels of a frame.
pub(crate) const PIXELS: usize = 640 * 480;

/// The host program, compiled once; `None` and a printed line where libfreenect's headers or a C compiler are missing.
pub(crate) fn host_program() -> Option<PathBuf> {
    static PROGRAM: OnceLock<Option<PathBuf>> = OnceLock::new();
    PROGRAM.get_or_init(compile).clone()
}

fn compile() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let probe = folder.join(format!("probe-{}.c", std::process::id()));
    fs::write(&probe, "#include <libfreenect.h>\nint main(void) { return 0; }\n").expect("writes");
    let cc = |arguments: &[&Path]| {
        let search = ["-I/usr/include/libfreenect", "-I/usr/local/include/libfreenect"];
        Command::new("cc").args(search).arg("-o").args(arguments).args(["-lfreenect", "-lpthread"]).output()
    };
    let program = folder.join(format!("host-{}", std::process::id()));
    let is_there = cc(&[&program, &probe]).is_ok_and(|output| output.status.success());
    fs::remove_file(&probe).expect("removes");
    if !is_there {
        println!("skipped: cc and libfreenect-dev are not both there");
        return None;
    }
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/under_libfreenect/host.c");
    let output = cc(&[&program, &source]).expect("cc runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    // Tests in other processes do the same: whoever is last puts an equal file in its place.
    let settled = folder.join("host");
    fs::rename(&program, &settled).expect("renames");
    Some(settled)
}

/// A frame as the host received it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Received {
    pub(crate) ticks: u32,
    pub(crate) bytes: usize,
    pub(crate) digest: u64,
    pub(crate) missing: Vec<u16>,
}

/// Variables that load the stand-in, and tell it its script.
pub(crate) type Environment = [(OsString, OsString); 2];

/// A process that does not outlive its test.
struct Owned(Child);

impl Drop for Owned {
    fn drop(&mut self) {
        // It has mostly ended by itself; killing what has ended is no harm.
        self.0.kill().ok();
        self.0.wait().ok();
    }
}

/// A running host program under a stand-in.
pub(crate) struct Host {
    pub(crate) standin: Standin,
    pub(crate) folder: TempDir,
    child: Owned,
    lines: ChildStdin,
    replies: BufReader<ChildStdout>,
}

impl Host {
    /// Starts the host under a script; `prepare` may put frames into the folder before. `None`: skipped.
    pub(crate) fn start(script: &str, prepare: impl FnOnce(&Path)) -> Option<Self> {
        Self::start_with(script, prepare, |_, environment| environment)
    }

    /// The same, with a say in what the host's environment is.
    pub(crate) fn start_with(
        script: &str,
        prepare: impl FnOnce(&Path),
        environment: impl FnOnce(&Path, Environment) -> Environment,
    ) -> Option<Self> {
        let program = host_program()?;
        let folder = tempfile::tempdir().expect("a folder");
        prepare(folder.path());
        let standin = Standin::new(folder.path(), script).expect("builds the stand-in");
        let mut child = Command::new(program)
            .arg(folder.path().join("received"))
            .envs(environment(folder.path(), standin.environment()))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(File::create(folder.path().join("stderr")).expect("creates"))
            .spawn()
            .expect("the host starts");
        let lines = child.stdin.take().expect("its stdin");
        let replies = BufReader::new(child.stdout.take().expect("its stdout"));
        Some(Self { standin, folder, child: Owned(child), lines, replies })
    }

    /// Lets the host do something; the numbers it answers with.
    pub(crate) fn ask_all(&mut self, line: &str) -> Vec<i64> {
        writeln!(self.lines, "{line}").expect("the host listens");
        let mut reply = String::new();
        self.replies.read_line(&mut reply).expect("the host answers");
        let mut words = reply.split_whitespace();
        assert_eq!(words.next(), line.split_whitespace().next(), "{line}: {}", self.stderr());
        words.map(|word| word.parse().expect("a number")).collect()
    }

    /// Lets the host do something; the result of the libfreenect call behind it.
    pub(crate) fn ask(&mut self, line: &str) -> i64 {
        self.ask_all(line)[0]
    }

    /// Opens the first device and starts depth in a format.
    pub(crate) fn stream(&mut self, format: u32) {
        for line in ["init", "open", &format!("mode {format}"), "start"] {
            assert_eq!(self.ask(line), 0, "{line}: {}", self.stderr());
        }
    }

    /// Lets the host receive so many frames.
    pub(crate) fn receive(&mut self, frames: u64) {
        let before = self.ask("frames");
        assert_eq!(self.ask(&format!("run {frames} 60")), 0, "{}", self.stderr());
        assert_eq!(self.ask("frames") - before, frames as i64, "within a minute: {}", self.stderr());
    }

    /// A connection to the stand-in.
    pub(crate) fn control(&self) -> Control {
        self.standin.connect(Duration::from_secs(20)).expect("connects")
    }

    /// Ends the host by its own means and waits for it.
    pub(crate) fn finish(mut self, lines: &[&str]) -> Finished {
        for line in lines {
            self.ask(line);
        }
        drop(self.lines);
        assert!(self.child.0.wait().expect("ends").success());
        Finished { standin: self.standin, folder: self.folder }
    }

    pub(crate) fn stderr(&self) -> String {
        fs::read_to_string(self.folder.path().join("stderr")).unwrap_or_default()
    }
}

/// What a host left behind.
pub(crate) struct Finished {
    pub(crate) standin: Standin,
    folder: TempDir,
}

impl Finished {
    /// The frames in order.
    pub(crate) fn received(&self) -> Vec<Received> {
        let text = fs::read_to_string(self.folder.path().join("received")).expect("reads");
        text.lines().map(received).collect()
    }

    /// Asserts that nothing was used wrongly and nothing is left.
    pub(crate) fn assert_clean(&self) {
        let journal = self.standin.journal().expect("reads");
        assert_eq!(journal.of("error").collect::<Vec<_>>(), Vec::<&_>::new());
        let exit = journal.of("exit").last().expect("the host shut libfreenect down");
        for name in ["handles", "claims", "transfers", "in_flight", "references"] {
            assert_eq!(exit.value(name), Some("0"), "{name}");
        }
    }
}

fn received(line: &str) -> Received {
    let words: Vec<&str> = line.split(' ').collect();
    Received {
        ticks: words[0].parse().expect("ticks"),
        bytes: words[1].parse().expect("a number"),
        digest: u64::from_str_radix(words[2], 16).expect("a digest"),
        missing: words[3].split(',').filter_map(|word| word.parse().ok()).collect(),
    }
}

/// FNV-1a with 64 bits, as the host computes it.
pub(crate) fn digest(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

/// A made-up frame: every code 0..=2047 in another place in each frame.
pub(crate) fn codes(number: u32) -> Vec<u16> {
    (0..PIXELS as u32)
        .map(|pixel| ((pixel.wrapping_mul(2_654_435_761) >> 7).wrapping_add(number * 77) & 0x7FF) as u16)
        .collect()
}

/// The packed 11-bit stream of a frame.
pub(crate) fn pack(codes: &[u16]) -> Vec<u8> {
    codes.as_chunks().0.iter().flat_map(|group| pack_group(*group)).collect()
}

/// 16-bit little-endian, as libfreenect unpacks on the machines this runs on.
pub(crate) fn unpacked(codes: &[u16]) -> Vec<u8> {
    codes.iter().flat_map(|code| code.to_ne_bytes()).collect()
}

/// Writes frames with the ticks 0, 2 000 000 and so on.
pub(crate) fn write_frames(path: &Path, frames: &[Vec<u16>]) {
    let mut writer = FrameWriter::new(File::create(path).expect("creates")).expect("writes");
    for (frame, number) in frames.iter().zip(0_u32..) {
        writer.write(number * FRAME_TICKS, &pack(frame)).expect("writes");
    }
    writer.finish().expect("flushes");
}

/// Three made-up frames in `frames`, as most scripts want them.
pub(crate) fn three_frames(folder: &Path) {
    write_frames(&folder.join("frames"), &[codes(0), codes(1), codes(2)]);
}

/// Every frame that was sent whole after a whole one arrived whole, and every frame that arrived lacks what the truth
/// says: unless the machine was so busy that packets were late, which spoils that frame and the next.
pub(crate) fn assert_true(finished: &Finished, device: usize) {
    let truth = finished.standin.truth().expect("reads");
    let received: BTreeMap<u32, Received> = finished.received().into_iter().map(|frame| (frame.ticks, frame)).collect();
    let (mut before_whole, mut compared) = (true, 0);
    for sent in truth.frames(device) {
        let spoiled = !sent.late.is_empty() || !before_whole;
        before_whole = sent.late.is_empty();
        if spoiled || sent.sent != Some(sent.packets) {
            continue;
        }
        let arrived = received.get(&sent.ticks).map(|frame| &frame.missing);
        // Of a run's last frame the packet that ends it may be missing: it is delivered with the next one only.
        if arrived.is_some() || sent.is_whole() {
            assert_eq!(arrived, Some(&sent.missing()), "frame {}", sent.number);
            compared += 1;
        }
    }
    assert!(compared > 0, "nothing to compare");
}

//! Where a camera's frames come from.

use std::fs::{self, File};
use std::io::{self, Read};
use std::os::unix::fs::{FileExt, FileTypeExt};
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

use fake_libusb_control::frames::{FRAME_HEADER, FRAME_TICKS, MAGIC, ticks_of};
use fake_libusb_control::{Frame, FrameReader, Frames, PACKED_BYTES};

/// Frames read ahead of the camera; the writer of a feed is held back by then.
const READ_AHEAD: usize = 2;
/// From frame to frame in a file, bytes.
const STEP: u64 = (FRAME_HEADER + PACKED_BYTES) as u64;

/// A camera's frames.
#[derive(Debug)]
pub(crate) enum Source {
    /// There are none.
    None,
    /// A file of frames.
    File(FramesFile),
    /// Frames that another process writes.
    Feed { frames: Receiver<Frame>, next: Option<Frame> },
}

impl Source {
    /// Opens a file, or begins to listen to a feed; `arrived` is called after every frame of it.
    pub(crate) fn open(frames: Option<&Frames>, arrived: fn()) -> io::Result<Self> {
        match frames {
            None => Ok(Self::None),
            Some(Frames::File { path, once, follow }) => FramesFile::open(path, *once, *follow).map(Self::File),
            Some(Frames::Feed(path)) => {
                let (to, frames) = sync_channel(READ_AHEAD);
                listen(path.clone(), to, arrived)?;
                Ok(Self::Feed { frames, next: None })
            }
        }
    }

    /// Whether there is a frame to send now.
    pub(crate) fn is_ready(&mut self) -> bool {
        match self {
            Self::None => false,
            Self::File(file) => !file.is_over(),
            Self::Feed { frames, next } => {
                if next.is_none() {
                    // A feed that ended is told as a feed without a frame: both send nothing.
                    *next = frames.try_recv().ok();
                }
                next.is_some()
            }
        }
    }

    /// Takes the next frame's bytes and gives its ticks; `None` if there is none. `elapsed` frames have passed by the
    /// clock since the camera was first started.
    pub(crate) fn take(&mut self, elapsed: u64, bytes: &mut Vec<u8>) -> io::Result<Option<u32>> {
        if !self.is_ready() {
            return Ok(None);
        }
        match self {
            Self::None => Ok(None),
            Self::File(file) => file.take(elapsed, bytes),
            Self::Feed { next, .. } => Ok(next.take().map(|frame| {
                *bytes = frame.packed;
                frame.ticks
            })),
        }
    }
}

/// A file of frames, read a little ahead by a thread of its own: the bus must not wait for a disk.
#[derive(Debug)]
pub(crate) struct FramesFile {
    ticks: Vec<u32>,
    once: bool,
    follow: bool,
    next: u64,
    /// Frames by their numbers, over all loops.
    ahead: Receiver<io::Result<(u64, Vec<u8>)>>,
    /// No frame before this one is asked for any more.
    wanted: Arc<AtomicU64>,
}

impl FramesFile {
    fn open(path: &Path, once: bool, follow: bool) -> io::Result<Self> {
        let says = |error: io::Error| io::Error::new(error.kind(), format!("{}: {error}", path.display()));
        let file = File::open(path).map_err(says)?;
        let mut magic = [0; MAGIC.len()];
        file.read_exact_at(&mut magic, 0).map_err(says)?;
        let length = file.metadata()?.len();
        let payload = length - MAGIC.len() as u64;
        if magic != MAGIC || payload == 0 || !payload.is_multiple_of(STEP) {
            let found = format!("{length} bytes, expected `TUSBDEP1` and whole frames of {STEP} bytes");
            return Err(says(io::Error::new(io::ErrorKind::InvalidData, found)));
        }
        let mut ticks = Vec::new();
        for frame in 0..payload / STEP {
            let mut header = [0; FRAME_HEADER];
            file.read_exact_at(&mut header, MAGIC.len() as u64 + frame * STEP).map_err(says)?;
            ticks.push(ticks_of(&header).map_err(says)?);
        }
        let (to, ahead) = sync_channel(READ_AHEAD);
        let wanted = Arc::new(AtomicU64::new(0));
        let reading = Reading { file, count: payload / STEP, once, wanted: Arc::clone(&wanted), to };
        thread::Builder::new().name("usb-frames".into()).spawn(move || reading.run())?;
        Ok(Self { ticks, once, follow, next: 0, ahead, wanted })
    }

    fn is_over(&self) -> bool {
        self.once && self.next >= self.ticks.len() as u64
    }

    fn take(&mut self, elapsed: u64, bytes: &mut Vec<u8>) -> io::Result<Option<u32>> {
        if self.follow {
            self.next = self.next.max(elapsed);
        }
        if self.is_over() {
            return Ok(None);
        }
        let number = self.next;
        self.next += 1;
        self.wanted.store(number, Ordering::Relaxed);
        *bytes = loop {
            let read = self.ahead.recv().map_err(io::Error::other)?;
            match read? {
                (found, frame) if found == number => break frame,
                _ => {} // what a scene that goes on has left behind
            }
        };
        let count = self.ticks.len() as u64;
        let (loops, index) = (number / count, number % count);
        // The clock goes on over the loops: the first frame follows the last at the distance of the last two.
        let carried = self.period().wrapping_mul(loops as u32);
        Ok(self.ticks.get(index as usize).map(|ticks| ticks.wrapping_add(carried)))
    }

    fn period(&self) -> u32 {
        let step = match self.ticks.as_slice() {
            [.., before, last] => last.wrapping_sub(*before),
            _ => FRAME_TICKS,
        };
        let (first, last) = (self.ticks.first().copied(), self.ticks.last().copied());
        last.unwrap_or_default().wrapping_sub(first.unwrap_or_default()).wrapping_add(step)
    }
}

/// The reader of a file.
struct Reading {
    file: File,
    count: u64,
    once: bool,
    wanted: Arc<AtomicU64>,
    to: SyncSender<io::Result<(u64, Vec<u8>)>>,
}

impl Reading {
    /// Reads on until nobody takes the frames any more, or none is left.
    fn run(self) {
        let mut number = 0;
        loop {
            number = self.wanted.load(Ordering::Relaxed).max(number);
            if self.once && number >= self.count {
                return;
            }
            let mut bytes = vec![0; PACKED_BYTES];
            let offset = MAGIC.len() as u64 + number % self.count * STEP + FRAME_HEADER as u64;
            let read = self.file.read_exact_at(&mut bytes, offset).map(|()| (number, bytes));
            if self.to.send(read).is_err() {
                return;
            }
            number += 1;
        }
    }
}

/// Reads a feed on a thread of its own: a FIFO if there is one at `path`, else a socket made there.
fn listen(path: PathBuf, to: SyncSender<Frame>, arrived: fn()) -> io::Result<()> {
    let is_fifo = fs::metadata(&path).is_ok_and(|found| found.file_type().is_fifo());
    if is_fifo {
        // Opening waits for the writer; the next writer may come after the first.
        thread::Builder::new().name("usb-feed".into()).spawn(move || {
            while let Ok(pipe) = File::open(&path)
                && pass(pipe, &to, arrived)
            {}
        })?;
    } else {
        if path.exists() {
            fs::remove_file(&path)?;
        }
        let listener = UnixListener::bind(&path)?;
        thread::Builder::new().name("usb-feed".into()).spawn(move || {
            while let Ok((stream, _)) = listener.accept()
                && pass(stream, &to, arrived)
            {}
        })?;
    }
    Ok(())
}

/// Passes on a writer's frames until it ends; false when nobody takes them any more.
fn pass(from: impl Read, to: &SyncSender<Frame>, arrived: fn()) -> bool {
    let mut reader = match FrameReader::new(from) {
        Ok(reader) => reader,
        Err(error) => {
            eprintln!("fake-libusb: feed: {error}");
            return true;
        }
    };
    loop {
        match reader.read() {
            Ok(Some(frame)) => {
                if to.send(frame).is_err() {
                    return false;
                }
                arrived();
            }
            Ok(None) => return true,
            Err(error) => {
                eprintln!("fake-libusb: feed: {error}");
                return true;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fake_libusb_control::FrameWriter;
    use std::io::Write;

    fn file(ticks: &[u32], once: bool, follow: bool) -> FramesFile {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("frames");
        let mut writer = FrameWriter::new(File::create(&path).expect("creates")).expect("writes");
        for &ticks in ticks {
            writer.write(ticks, &[ticks as u8; PACKED_BYTES]).expect("writes");
        }
        writer.finish().expect("flushes");
        FramesFile::open(&path, once, follow).expect("opens")
    }

    fn taken(file: &mut FramesFile, elapsed: u64) -> Option<(u32, u8)> {
        let mut bytes = Vec::new();
        file.take(elapsed, &mut bytes).expect("reads").map(|ticks| (ticks, bytes[421_999]))
    }

    #[test]
    fn ticks_go_on_over_the_loops() {
        let mut looped = file(&[10, 30, 60], false, false);
        let read: Vec<_> = (0..7).map(|_| taken(&mut looped, 0).expect("endless")).collect();
        // The period is 60 − 10 plus the last distance, 30: 80.
        assert_eq!(read, [(10, 10), (30, 30), (60, 60), (90, 10), (110, 30), (140, 60), (170, 10)]);
    }

    #[test]
    fn a_scene_goes_on_while_nothing_streams() {
        let mut scene = file(&[10, 20, 30, 40], true, true);
        assert_eq!(taken(&mut scene, 0), Some((10, 10)));
        assert_eq!(taken(&mut scene, 2), Some((30, 30)));
        assert_eq!(taken(&mut scene, 3), Some((40, 40)));
        assert_eq!(taken(&mut scene, 4), None);
    }

    #[test]
    fn a_file_cut_within_a_frame_is_refused() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("frames");
        let mut raw = File::create(&path).expect("creates");
        raw.write_all(b"TUSBDEP1").expect("writes");
        raw.write_all(&[0; 100]).expect("writes");
        let error = FramesFile::open(&path, false, false).expect_err("is cut").to_string();
        assert!(error.ends_with("108 bytes, expected `TUSBDEP1` and whole frames of 422408 bytes"), "{error}");
    }
}

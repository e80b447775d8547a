//! Where the parts of a recording go: the disk, or what a test puts in its place.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// Small records between the chunks are gathered up to this size.
const BUFFER_BYTES: usize = 1 << 18;

/// Makes and removes the files of a recording.
pub trait Storage: Send {
    /// Makes a file to be written from its start.
    ///
    /// # Errors
    /// What the system says; `AlreadyExists` where a file is there and `replace` is not set.
    fn create(&mut self, path: &Path, replace: bool) -> io::Result<Box<dyn PartFile>>;

    /// Whether a file is there.
    fn exists(&self, path: &Path) -> bool;

    /// Removes a file.
    ///
    /// # Errors
    /// What the system says.
    fn remove(&mut self, path: &Path) -> io::Result<()>;

    /// Bytes that may still be written where `path` lies.
    ///
    /// # Errors
    /// What the system says.
    fn free_bytes(&self, path: &Path) -> io::Result<u64>;
}

/// A part being written.
pub trait PartFile: Write + Send {
    /// Brings everything written so far to the medium, so that a power cut does not take it.
    ///
    /// # Errors
    /// What the system says.
    fn sync(&mut self) -> io::Result<()>;

    /// Cuts the file to this length, after a failed write.
    ///
    /// # Errors
    /// What the system says.
    fn truncate(&mut self, length: u64) -> io::Result<()>;
}

/// The file system.
#[derive(Clone, Copy, Debug, Default)]
pub struct FileSystem;

impl Storage for FileSystem {
    fn create(&mut self, path: &Path, replace: bool) -> io::Result<Box<dyn PartFile>> {
        let mut options = OpenOptions::new();
        options.write(true);
        if replace {
            options.create(true).truncate(true)
        } else {
            options.create_new(true)
        };
        let file = options.open(path)?;
        // The entry in the folder too is to survive a power cut. Folders that cannot be opened are let be.
        if let Ok(folder) = File::open(folder_of(path)) {
            folder.sync_data().unwrap_or_default();
        }
        Ok(Box::new(DiskFile { writer: Some(BufWriter::with_capacity(BUFFER_BYTES, file)) }))
    }

    fn exists(&self, path: &Path) -> bool {
        path.symlink_metadata().is_ok()
    }

    fn remove(&mut self, path: &Path) -> io::Result<()> {
        fs::remove_file(path)
    }

    fn free_bytes(&self, path: &Path) -> io::Result<u64> {
        let stats = nix::sys::statvfs::statvfs(folder_of(path))?;
        // What this process may use, not what is kept for root.
        Ok(stats.blocks_available().saturating_mul(stats.fragment_size()))
    }
}

fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// A file on the disk; without a writer once it has been cut.
struct DiskFile {
    writer: Option<BufWriter<File>>,
}

impl DiskFile {
    fn writer(&mut self) -> io::Result<&mut BufWriter<File>> {
        self.writer.as_mut().ok_or_else(|| io::Error::other("the file has been cut"))
    }
}

impl Write for DiskFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.writer()?.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer()?.flush()
    }
}

impl PartFile for DiskFile {
    fn sync(&mut self) -> io::Result<()> {
        let writer = self.writer()?;
        writer.flush()?;
        writer.get_ref().sync_data()
    }

    fn truncate(&mut self, length: u64) -> io::Result<()> {
        let Some(writer) = self.writer.take() else { return Ok(()) };
        // What the buffer still holds must not be written behind the cut when it is dropped.
        let (file, _buffered) = writer.into_parts();
        file.set_len(length)
    }
}

/// A part's file as the MCAP writer has it; clones share it, so that the recorder can sync and cut it.
#[derive(Clone)]
pub(crate) struct Sink(Arc<Mutex<SinkState>>);

struct SinkState {
    file: Box<dyn PartFile>,
    position: u64,
    /// Nothing more is let through: a failed part must not grow a tail when its writer is dropped.
    closed: bool,
}

impl Sink {
    pub(crate) fn new(file: Box<dyn PartFile>) -> Self {
        Self(Arc::new(Mutex::new(SinkState { file, position: 0, closed: false })))
    }

    fn with<T>(&self, act: impl FnOnce(&mut SinkState) -> T) -> T {
        act(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Bytes written.
    pub(crate) fn position(&self) -> u64 {
        self.with(|state| state.position)
    }

    pub(crate) fn sync(&self) -> io::Result<()> {
        self.with(|state| state.file.sync())
    }

    /// After a failure: keeps the first `length` bytes and lets nothing more through.
    pub(crate) fn cut_off(&self, length: u64) -> io::Result<()> {
        self.with(|state| {
            state.closed = true;
            state.file.truncate(length)
        })
    }
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.with(|state| {
            if state.closed {
                return Err(io::Error::other("the recording has stopped"));
            }
            let written = state.file.write(bytes)?;
            state.position += written as u64;
            Ok(written)
        })
    }

    fn flush(&mut self) -> io::Result<()> {
        self.with(|state| if state.closed { Ok(()) } else { state.file.flush() })
    }
}

impl Seek for Sink {
    /// Tells where it is; the parts are written from start to end.
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let position = self.position();
        match to {
            SeekFrom::Current(0) => Ok(position),
            SeekFrom::Start(start) if start == position => Ok(position),
            _ => Err(io::Error::new(io::ErrorKind::Unsupported, "a recording is written from start to end")),
        }
    }
}

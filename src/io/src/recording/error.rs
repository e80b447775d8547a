//! Why a recording cannot be made, goes on no longer, or cannot be read.

use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::header::HeaderFault;

/// Why a recording cannot be begun.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecorderError {
    /// A file is there already: this one, or a part that rotation would come to.
    #[error("{} is there already: name another file, or say that it may be replaced", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// The name has no file name or is not text.
    #[error("{} is no name for a recording: expected a file such as session.mcap", path.display())]
    NoName {
        /// The path.
        path: PathBuf,
    },
    /// More is to be attached than is read back.
    #[error("{found} {what}: a recording takes {most} at most")]
    TooLarge {
        /// Of what.
        what: String,
        /// How many.
        found: usize,
        /// How many there may be.
        most: usize,
    },
    /// The first part cannot be written.
    #[error("cannot begin the recording: {0}")]
    Begin(StopReason),
}

/// Why a recording stopped before it was told to.
#[derive(Clone, Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StopReason {
    /// The disk is nearly full; the recording was finished cleanly before it is.
    #[error("{free} bytes are free at {}, fewer than the {min_free} that are to stay free", path.display())]
    LowSpace {
        /// The recording.
        path: PathBuf,
        /// Bytes free.
        free: u64,
        /// Bytes that are to stay free.
        min_free: u64,
    },
    /// The system refused to write; everything up to the last whole chunk is in the file.
    #[error("cannot write {}: {source}", path.display())]
    Write {
        /// The part.
        path: PathBuf,
        /// What the system said.
        source: Arc<io::Error>,
    },
    /// The recorder's thread ended without a word.
    #[error("the recorder's thread is gone")]
    Thread,
}

impl StopReason {
    pub(crate) fn io(path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Write { path: path.to_owned(), source: Arc::new(source) }
    }

    pub(crate) fn mcap(path: &Path) -> impl FnOnce(mcap::McapError) -> Self {
        move |error| {
            let source = match error {
                mcap::McapError::Io(source) => source,
                other => io::Error::other(other),
            };
            Self::io(path)(source)
        }
    }
}

/// Why a recording cannot be read at all. Damage further on is told by [`super::RecordingInfo`].
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadError {
    /// The system refused to read.
    #[error("cannot read {}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Not one of these recordings.
    #[error("{} is no recording of this program: an MCAP file with profile `tumbled` is expected", path.display())]
    NotARecording {
        /// The file.
        path: PathBuf,
    },
    /// It ends, or breaks, before its start record: nothing is in it.
    #[error("{} breaks off at byte {offset}, before its start record: nothing in it can be read", path.display())]
    NoStart {
        /// The file.
        path: PathBuf,
        /// Where.
        offset: u64,
    },
    /// The start record cannot be used.
    #[error("{}: {fault}", path.display())]
    Header {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        fault: HeaderFault,
    },
    /// Files that are not parts of one recording.
    #[error(
        "{} and {} are of different sessions ({first_session}, {other_session}): read them one by one",
        first.display(), other.display()
    )]
    DifferentSessions {
        /// One file.
        first: PathBuf,
        /// Its session.
        first_session: String,
        /// Another file.
        other: PathBuf,
        /// Its session.
        other_session: String,
    },
    /// The same part twice.
    #[error("{} and {} are both part {part} of one recording: give each part once", first.display(), other.display())]
    SamePart {
        /// One file.
        first: PathBuf,
        /// The other.
        other: PathBuf,
        /// The part's number.
        part: u32,
    },
    /// No file was given.
    #[error("no recording is given")]
    Nothing,
}

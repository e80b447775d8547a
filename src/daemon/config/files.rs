//! The files a config names: read once, when it is loaded, from the disk or from the recording that holds the config.

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use bytes::Bytes;
use tumbled_io::recording::{AttachedFile, MAX_FILE_BYTES, RecordingHeader};

use super::Config;
use super::origin::{Layer, Origin};

/// A file the config names, with what is in it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RigFile {
    /// The key that names it: `lidar.front.calibration`, `kinect.near.depth_table`, `rig.calibration`,
    /// `target.saved`.
    pub key: String,
    /// Its name without folders.
    pub name: String,
    /// Where it was read, for messages: its path, or its name and the recording's.
    pub place: String,
    /// What is in it, at most [`MAX_FILE_BYTES`].
    pub content: Bytes,
}

impl RigFile {
    /// Its content as text.
    ///
    /// # Errors
    /// Where it is no UTF-8.
    pub fn text(&self) -> Result<&str, NotUtf8> {
        std::str::from_utf8(&self.content).map_err(|error| NotUtf8 { offset: error.valid_up_to() })
    }
}

/// A file that is no text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("byte offset {offset}: not UTF-8 text")]
pub struct NotUtf8 {
    /// The first byte that is not part of a character.
    pub offset: usize,
}

impl Config {
    /// Every file of the config, as a recording carries them.
    pub fn attachments(&self) -> Vec<AttachedFile> {
        let calibrations = self.lidars.iter().filter_map(|lidar| lidar.calibration.as_ref());
        let tables = self.kinects.iter().filter_map(|kinect| kinect.depth_table.as_ref());
        let saved = self.target.saved.iter().map(|saved| &saved.file);
        let all = self.calibration.iter().chain(calibrations).chain(tables).chain(saved);
        all.map(|file| AttachedFile::new(&file.key, &file.name, file.content.clone())).collect()
    }
}

/// A recording whose own config is loaded.
#[derive(Clone, Debug)]
pub struct Recorded {
    /// The recording, for messages.
    pub path: PathBuf,
    /// What it says of itself.
    pub header: RecordingHeader,
}

impl Recorded {
    fn file(&self, key: &str) -> Result<RigFile, FileFault> {
        let recording = self.path.display();
        let attached = self.header.files.iter().find(|attached| attached.key == key);
        let attached =
            attached.ok_or_else(|| FileFault::Absent(format!("the recording {recording} holds no file `{key}`")))?;
        let name = &attached.file.name;
        let content = attached.content.clone();
        let content =
            content.ok_or_else(|| FileFault::Unreadable(format!("the copy of {name} in {recording} is damaged")))?;
        Ok(RigFile { key: key.to_owned(), name: name.clone(), place: format!("{name} in {recording}"), content })
    }
}

/// Why a file is not to be had: what was found, as a sentence.
pub(super) enum FileFault {
    /// It is not there.
    Absent(String),
    /// It is there and cannot be read.
    Unreadable(String),
}

/// Where files are read from, and which were named on this machine.
#[derive(Default)]
pub(super) struct FileShelf {
    /// The recording whose config is loaded.
    pub(super) recorded: Option<Recorded>,
    /// Every path named, whether it was read or not.
    pub(super) paths: Vec<PathBuf>,
}

impl FileShelf {
    /// The file that `key` names as `text`, written at `origin`. A name that comes from a recording is looked for among
    /// what the recording holds: on this machine that path is nobody's, or somebody else's.
    pub(super) fn take(&self, key: &str, text: &str, origin: &Origin) -> Result<RigFile, FileFault> {
        match &self.recorded {
            Some(recorded) if origin.layer() == Layer::Recorded => recorded.file(key),
            _ => from_disk(key, &origin.directory().join(text)),
        }
    }

    /// Notes a path that is named, so that nothing is written over it.
    pub(super) fn note(&mut self, text: &str, origin: &Origin) {
        if origin.layer() != Layer::Recorded {
            self.paths.push(origin.directory().join(text));
        }
    }
}

fn from_disk(key: &str, path: &Path) -> Result<RigFile, FileFault> {
    let shown = path.display();
    if !path.exists() {
        return Err(FileFault::Absent(format!("the file {shown} is not there")));
    }
    if !path.is_file() {
        // Nothing that is read: a pipe would wait for its writer.
        let what = if path.is_dir() { "a folder" } else { "no regular file" };
        return Err(FileFault::Unreadable(format!("the file {shown} is {what}")));
    }
    let unreadable = |error: std::io::Error| FileFault::Unreadable(format!("the file {shown} cannot be read: {error}"));
    let mut content = Vec::new();
    let mut file = File::open(path).map_err(unreadable)?.take(MAX_FILE_BYTES as u64 + 1);
    file.read_to_end(&mut content).map_err(unreadable)?;
    if content.len() > MAX_FILE_BYTES {
        let message = format!("the file {shown} has more than {MAX_FILE_BYTES} bytes: it is no calibration or table");
        return Err(FileFault::Unreadable(message));
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    Ok(RigFile { key: key.to_owned(), name, place: shown.to_string(), content: content.into() })
}

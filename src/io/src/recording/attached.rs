//! The rig's files that travel with a recording: calibrations and tables without which its bytes cannot be decoded alike.

use bytes::Bytes;

use super::error::RecorderError;
use super::header::{InputFile, RecordingHeader};
use super::layout::MAX_CONFIG_BYTES;

/// The largest file that is attached or read back. An HDL-64E's `db.xml` has 0.2 MB, a depth table 20 kB.
pub const MAX_FILE_BYTES: usize = 4 << 20;

/// Files of one recording: a rig of ten sensors has one each, and its calibration.
pub const MAX_FILES: usize = 32;

/// A file that the config names, as it was when the session began.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AttachedFile {
    /// What the config calls it: `lidar.front.calibration`, `kinect.near.depth_table`, `rig.calibration`.
    pub key: String,
    /// Its name without folders, size and digest.
    pub file: InputFile,
    /// What is in it; `None`: the recording's copy is damaged or gone.
    pub content: Option<Bytes>,
}

impl AttachedFile {
    /// A file to attach; `name` without folders.
    pub fn new(key: &str, name: &str, content: Bytes) -> Self {
        let blake3 = blake3::hash(&content).to_hex().to_string();
        let file = InputFile { name: name.to_owned(), bytes: content.len() as u64, blake3 };
        Self { key: key.to_owned(), file, content: Some(content) }
    }

    /// Takes a copy found in a recording, provided it is the file that was attached.
    pub(super) fn restore(&mut self, content: &[u8]) {
        let same = content.len() <= MAX_FILE_BYTES
            && content.len() as u64 == self.file.bytes
            && blake3::hash(content).to_hex().as_str() == self.file.blake3;
        if same {
            self.content = Some(Bytes::copy_from_slice(content));
        }
    }

    /// The name of the attachment.
    pub(super) fn attachment_name(key: &str) -> String {
        format!("{ATTACHMENT_FOLDER}{key}")
    }

    /// The key of an attachment; `None`: it is something else.
    pub(super) fn key_of_attachment(name: &str) -> Option<&str> {
        name.strip_prefix(ATTACHMENT_FOLDER)
    }
}

/// In front of the key in the names of the attachments.
const ATTACHMENT_FOLDER: &str = "files/";

/// Whether what a header attaches can be read back.
pub(super) fn check(header: &RecordingHeader) -> Result<(), RecorderError> {
    let limit = |what: &str, found: usize, most: usize| {
        if found > most { Err(RecorderError::TooLarge { what: what.to_owned(), found, most }) } else { Ok(()) }
    };
    limit("bytes of the config", header.config.len(), MAX_CONFIG_BYTES)?;
    limit("files of the rig", header.files.len(), MAX_FILES)?;
    for file in &header.files {
        let found = file.content.as_ref().map_or(0, Bytes::len);
        limit(&format!("bytes of {}", file.key), found, MAX_FILE_BYTES)?;
    }
    Ok(())
}

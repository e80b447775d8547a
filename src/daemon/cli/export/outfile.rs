//! A file that appears under its name only when it is whole.
//!
//! It is written beside its place as `NAME.partial` and renamed at the end, so that an interrupted export never
//! leaves a short file that looks like a whole one.

use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use crate::cli::Failure;

/// Writes through a buffer this large.
const BUFFER_BYTES: usize = 1 << 20;

/// The file being written. Dropped without [`OutFile::finish`] it is removed.
pub(super) struct OutFile {
    path: PathBuf,
    partial: PathBuf,
    writer: BufWriter<File>,
    finished: bool,
}

impl OutFile {
    /// Begins the file; its folder is made when there is none.
    pub(super) fn create(path: &Path) -> Result<Self, Failure> {
        let Some(name) = path.file_name().filter(|_| !path.is_dir()) else {
            return Err(Failure::input(format!("{} is a folder, a file is written", path.display()))
                .with_help("give -o a file name"));
        };
        if let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty()) {
            fs::create_dir_all(folder).map_err(|error| cannot_write(folder, &error))?;
        }
        let mut partial_name = name.to_owned();
        partial_name.push(".partial");
        let partial = path.with_file_name(partial_name);
        let file = File::create(&partial).map_err(|error| cannot_write(&partial, &error))?;
        Ok(Self {
            path: path.to_owned(),
            partial,
            writer: BufWriter::with_capacity(BUFFER_BYTES, file),
            finished: false,
        })
    }

    /// Appends bytes.
    pub(super) fn write(&mut self, bytes: &[u8]) -> Result<(), Failure> {
        self.writer.write_all(bytes).map_err(|error| cannot_write(&self.partial, &error))
    }

    /// Writes `header` over the first bytes of the file and puts the file in its place.
    pub(super) fn finish(mut self, header: &[u8]) -> Result<PathBuf, Failure> {
        let write = |writer: &mut BufWriter<File>| -> io::Result<()> {
            writer.flush()?;
            if !header.is_empty() {
                writer.seek(SeekFrom::Start(0))?;
                writer.write_all(header)?;
                writer.flush()?;
            }
            Ok(())
        };
        write(&mut self.writer).map_err(|error| cannot_write(&self.partial, &error))?;
        fs::rename(&self.partial, &self.path).map_err(|error| cannot_write(&self.path, &error))?;
        self.finished = true;
        Ok(self.path.clone())
    }
}

impl Drop for OutFile {
    fn drop(&mut self) {
        if !self.finished {
            // Nothing can be done about a file that cannot be removed: it is called .partial.
            fs::remove_file(&self.partial).unwrap_or_default();
        }
    }
}

fn cannot_write(path: &Path, error: &io::Error) -> Failure {
    Failure::failed(format!("cannot write {}: {error}", path.display()))
}

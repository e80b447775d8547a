//! A file that appears under its name only when it is whole.
//!
//! It is written beside its place under a name nobody has, and renamed at the end, so that an interrupted export never
//! leaves a short file that looks like a whole one and never touches a file that was there. What is no regular file (a
//! device, a pipe) cannot be replaced: it is written to as it stands.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use tempfile::{NamedTempFile, TempPath};

use super::protected::{Protected, resolve};
use crate::cli::{Failure, output};

/// Writes through a buffer this large.
const BUFFER_BYTES: usize = 1 << 20;

/// The file being written. Dropped without [`OutFile::finish`] it is removed.
pub(super) struct OutFile {
    /// As it was asked for.
    path: PathBuf,
    writer: BufWriter<File>,
    place: Place,
}

/// Where the bytes go until the end, and what becomes of them then.
enum Place {
    /// Into a file of its own, which then takes the name; dropped before that it is removed.
    Beside { written: TempPath, name: PathBuf },
    /// To their end at once.
    Itself,
}

impl OutFile {
    /// Begins the file; its folder is made when there is none. A link is followed to what it names.
    ///
    /// With `rewrites` the first bytes are written once more at the end, which not everything allows.
    ///
    /// # Errors
    /// Exit code 2: a folder, a protected file, or something that cannot be written over while `rewrites` asks for it.
    /// Exit code 1: whatever the system refuses.
    pub(super) fn create(path: &Path, rewrites: bool, protected: &Protected) -> Result<Self, Failure> {
        let permissions = match fs::metadata(path) {
            Ok(found) if found.is_dir() => {
                return Err(Failure::input(format!("{} is a folder, a file is written", path.display()))
                    .with_help("give -o a file name"));
            }
            Ok(found) if !found.is_file() => return Self::in_place(path, rewrites),
            Ok(found) => Some(found.permissions()),
            Err(error) if error.kind() == io::ErrorKind::NotFound => None,
            Err(error) => return Err(cannot_write(path, error)),
        };
        let name = resolve(path).map_err(|error| cannot_write(path, error))?;
        protected.allow(path, &name)?;
        let folder = name.parent().unwrap_or(Path::new("/"));
        fs::create_dir_all(folder).map_err(|error| cannot_write(folder, error))?;
        let beside = output::beside(folder).map_err(|error| cannot_write(path, error))?;
        let (file, written) = NamedTempFile::into_parts(beside);
        if let Some(permissions) = permissions {
            file.set_permissions(permissions).map_err(|error| cannot_write(path, error))?;
        }
        Ok(Self::new(path, file, Place::Beside { written, name }))
    }

    fn in_place(path: &Path, rewrites: bool) -> Result<Self, Failure> {
        let mut file = OpenOptions::new().write(true).open(path).map_err(|error| cannot_write(path, error))?;
        if rewrites && file.stream_position().is_err() {
            return Err(Failure::input(format!(
                "{} is a pipe or a terminal, and the number of points, known at the end, stands at the file's beginning",
                path.display()
            ))
            .with_help("use --format csv or pts, or give -o a file"));
        }
        Ok(Self::new(path, file, Place::Itself))
    }

    fn new(path: &Path, file: File, place: Place) -> Self {
        Self { path: path.to_owned(), writer: BufWriter::with_capacity(BUFFER_BYTES, file), place }
    }

    /// Appends bytes.
    pub(super) fn write(&mut self, bytes: &[u8]) -> Result<(), Failure> {
        self.writer.write_all(bytes).map_err(|error| cannot_write(&self.path, error))
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
        write(&mut self.writer).map_err(|error| cannot_write(&self.path, error))?;
        if let Place::Beside { written, name } = self.place {
            written.persist(&name).map_err(|error| cannot_write(&self.path, error.error))?;
        }
        Ok(self.path)
    }
}

fn cannot_write(path: &Path, error: io::Error) -> Failure {
    if error.kind() == io::ErrorKind::BrokenPipe {
        // Whoever read from the pipe has seen enough.
        return Failure::Output(error);
    }
    Failure::failed(format!("cannot write {}: {error}", path.display()))
}

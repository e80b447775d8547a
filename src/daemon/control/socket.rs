//! The control socket's file.

use std::fs;
use std::io;
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::config::UnixPath;

/// Orders are for the owner and the group of the socket.
const MODE: u32 = 0o660;

/// Why no orders can be taken.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ControlError {
    /// The socket cannot be made.
    #[error("cannot make the control socket {}: {source}; make its folder writable, or name another path in [stream] control", path.display())]
    Socket {
        /// The path.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Another daemon listens there.
    #[error("another program serves the control socket {}: end it, or name another path in [stream] control", path.display())]
    InUse {
        /// The path.
        path: PathBuf,
    },
    /// Something else lies at the path.
    #[error("{} exists and is no socket: it is left alone; name another path in [stream] control", path.display())]
    NoSocket {
        /// The path.
        path: PathBuf,
    },
    /// No thread.
    #[error("cannot start the control socket's thread: {0}")]
    Start(io::Error),
}

/// A listening socket, whose file is removed with it unless it is another's by then.
#[derive(Debug)]
pub struct Listener {
    pub(super) socket: UnixListener,
    path: PathBuf,
    /// Device and inode.
    identity: (u64, u64),
}

impl Listener {
    /// Listens. `None`: the default path cannot be written, which has been told.
    ///
    /// # Errors
    /// A configured path that cannot be had; a path that somebody else has.
    pub fn bind(unix: &UnixPath) -> Result<Option<Self>, ControlError> {
        let path = &unix.path;
        clear(path)?;
        match listen(path) {
            Ok(listener) => Ok(Some(listener)),
            Err(source) if unix.configured => Err(ControlError::Socket { path: path.clone(), source }),
            Err(error) => {
                tracing::warn!(path = %path.display(), "no control socket: {error}; `tumbled ctl` cannot give orders");
                Ok(None)
            }
        }
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        let still_ours = fs::symlink_metadata(&self.path).is_ok_and(|file| identity(&file) == self.identity);
        if still_ours && let Err(error) = fs::remove_file(&self.path) {
            tracing::warn!(path = %self.path.display(), "the control socket's file could not be removed: {error}");
        }
    }
}

fn identity(file: &fs::Metadata) -> (u64, u64) {
    (file.dev(), file.ino())
}

/// Removes the socket that a daemon left behind which was killed.
fn clear(path: &Path) -> Result<(), ControlError> {
    let Ok(file) = fs::symlink_metadata(path) else {
        return Ok(()); // nothing there, or no way to it: binding will tell
    };
    if !file.file_type().is_socket() {
        return Err(ControlError::NoSocket { path: path.to_owned() });
    }
    match UnixStream::connect(path) {
        // Only a socket without a server refuses.
        Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => {
            fs::remove_file(path).map_err(|source| ControlError::Socket { path: path.to_owned(), source })
        }
        _ => Err(ControlError::InUse { path: path.to_owned() }),
    }
}

fn listen(path: &Path) -> io::Result<Listener> {
    let socket = UnixListener::bind(path)?;
    // From here on the file is removed when something fails.
    let listener = Listener { socket, path: path.to_owned(), identity: identity(&fs::symlink_metadata(path)?) };
    fs::set_permissions(path, fs::Permissions::from_mode(MODE))?;
    listener.socket.set_nonblocking(true)?;
    Ok(listener)
}

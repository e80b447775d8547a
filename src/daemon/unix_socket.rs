//! Unix sockets that the daemon serves: a file that a killed daemon left behind is cleared, one that is somebody else's is not.

use std::fs;
use std::io;
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

use thiserror::Error;

use crate::config::UnixPath;

/// What a socket is for, as errors and warnings say it.
#[derive(Clone, Copy, Debug)]
pub struct Purpose {
    /// E.g. `control socket`.
    pub name: &'static str,
    /// The key of the config that names its path.
    pub key: &'static str,
    /// What is missing without it.
    pub without: &'static str,
    /// Permissions of its file.
    pub mode: u32,
}

/// Why a socket cannot be served.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum UnixSocketError {
    /// It cannot be made.
    #[error("cannot make the {name} {}: {source}; make its folder writable, or name another path in {key}", path.display())]
    Failed {
        /// What it is for.
        name: &'static str,
        /// The key that names it.
        key: &'static str,
        /// The path.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Another program listens there.
    #[error("another program serves the {name} {}: end it, or name another path in {key}", path.display())]
    InUse {
        /// What it is for.
        name: &'static str,
        /// The key that names it.
        key: &'static str,
        /// The path.
        path: PathBuf,
    },
    /// Something else lies at the path.
    #[error("{} exists and is no socket: it is left alone; name another path in {key}", path.display())]
    NoSocket {
        /// The key that names it.
        key: &'static str,
        /// The path.
        path: PathBuf,
    },
}

/// A socket's file, removed when dropped unless it is another's by then.
#[derive(Debug)]
pub struct SocketFile {
    path: PathBuf,
    /// Device and inode.
    identity: (u64, u64),
}

impl SocketFile {
    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for SocketFile {
    fn drop(&mut self) {
        let still_ours = fs::symlink_metadata(&self.path).is_ok_and(|file| identity(&file) == self.identity);
        if still_ours && let Err(error) = fs::remove_file(&self.path) {
            tracing::warn!(path = %self.path.display(), "the socket's file could not be removed: {error}");
        }
    }
}

fn identity(file: &fs::Metadata) -> (u64, u64) {
    (file.dev(), file.ino())
}

/// Listens, without waiting for connections. `None`: the default path cannot be written, which has been told.
///
/// # Errors
/// A configured path that cannot be had; a path that somebody else has.
pub fn listen(unix: &UnixPath, purpose: &Purpose) -> Result<Option<(UnixListener, SocketFile)>, UnixSocketError> {
    clear(&unix.path, purpose)?;
    match bind(&unix.path, purpose.mode) {
        Ok(bound) => Ok(Some(bound)),
        Err(source) if unix.configured => Err(purpose.failed(&unix.path, source)),
        Err(error) => {
            tracing::warn!(path = %unix.path.display(), "no {}: {error}; {}", purpose.name, purpose.without);
            Ok(None)
        }
    }
}

impl Purpose {
    fn failed(&self, path: &Path, source: io::Error) -> UnixSocketError {
        UnixSocketError::Failed { name: self.name, key: self.key, path: path.to_owned(), source }
    }
}

/// Removes the socket that a daemon left behind which was killed.
fn clear(path: &Path, purpose: &Purpose) -> Result<(), UnixSocketError> {
    let Ok(file) = fs::symlink_metadata(path) else {
        return Ok(()); // nothing there, or no way to it: binding will tell
    };
    if !file.file_type().is_socket() {
        return Err(UnixSocketError::NoSocket { key: purpose.key, path: path.to_owned() });
    }
    match UnixStream::connect(path) {
        // Only a socket without a server refuses.
        Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => {
            fs::remove_file(path).map_err(|source| purpose.failed(path, source))
        }
        _ => Err(UnixSocketError::InUse { name: purpose.name, key: purpose.key, path: path.to_owned() }),
    }
}

fn bind(path: &Path, mode: u32) -> io::Result<(UnixListener, SocketFile)> {
    let listener = UnixListener::bind(path)?;
    // From here on the file is removed when something fails.
    let file = SocketFile { path: path.to_owned(), identity: identity(&fs::symlink_metadata(path)?) };
    fs::set_permissions(path, fs::Permissions::from_mode(mode))?;
    listener.set_nonblocking(true)?;
    Ok((listener, file))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_is_another_servers_by_now_is_not_removed() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("state.sock");
        let socket = UnixPath { path: path.clone(), configured: true };
        let purpose = Purpose { name: "socket", key: "a key", without: "nobody can read", mode: 0o600 };
        let (listener, file) = listen(&socket, &purpose).expect("bound").expect("a socket");
        // Kept elsewhere, so that its inode is not given to the next file.
        fs::rename(&path, folder.path().join("old.sock")).expect("renamed");
        let _second = UnixListener::bind(&path).expect("another server");
        drop((listener, file));
        assert!(path.exists());
    }
}

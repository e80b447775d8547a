//! The listeners: where the stream can be reached.

use std::fs;
use std::io;
use std::net::SocketAddr;
use std::os::unix::fs::{FileTypeExt, MetadataExt, PermissionsExt};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};

use socket2::{Domain, Protocol, Socket, Type};
use thiserror::Error;

use super::reach::NonLive;
use crate::config::UnixPath;

/// Everybody on the machine may read the state, as over loopback; the folder's mode can narrow that.
const SOCKET_MODE: u32 = 0o666;

/// Connections the kernel holds until they are accepted: a burst of a second.
const BACKLOG: i32 = 1_024;

/// Why the stream could not start.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum StreamError {
    /// The TCP address cannot be had.
    #[error(
        "cannot listen on {address} for the state stream: {source}; is another tumbled running? [stream] tcp names another address, port 0 takes a free one"
    )]
    Tcp {
        /// The address.
        address: SocketAddr,
        /// Why.
        source: io::Error,
    },
    /// An address that others reach, for data that are no measurement.
    #[error(transparent)]
    NonLive(#[from] NonLive),
    /// The Unix socket cannot be made.
    #[error("cannot make the Unix socket {}: {source}; make its folder writable, or name another path in [stream] unix", path.display())]
    Unix {
        /// The path.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Another server listens there.
    #[error("another program serves the Unix socket {}: end it, or name another path in [stream] unix", path.display())]
    UnixInUse {
        /// The path.
        path: PathBuf,
    },
    /// Something else lies at the path.
    #[error("{} exists and is no socket: it is left alone; name another path in [stream] unix", path.display())]
    NoSocket {
        /// The path.
        path: PathBuf,
    },
    /// The threads or the HELLO line could not be made.
    #[error("cannot start the state stream: {0}")]
    Start(#[from] io::Error),
}

/// Listens on a TCP address.
pub(super) fn tcp(address: SocketAddr) -> Result<std::net::TcpListener, StreamError> {
    let listen = || {
        let socket = Socket::new(Domain::for_address(address), Type::STREAM, Some(Protocol::TCP))?;
        // A restart must not wait for the old connections to time out.
        socket.set_reuse_address(true)?;
        socket.bind(&address.into())?;
        socket.listen(BACKLOG)?;
        socket.set_nonblocking(true)?;
        Ok(socket.into())
    };
    listen().map_err(|source| StreamError::Tcp { address, source })
}

/// A Unix socket's file, removed when dropped unless it is another's by then.
#[derive(Debug)]
pub(super) struct SocketFile {
    path: PathBuf,
    /// Device and inode.
    identity: (u64, u64),
}

impl SocketFile {
    pub(super) fn path(&self) -> &Path {
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

/// Listens on a Unix socket. `None`: the default path cannot be written, which has been told.
pub(super) fn unix(socket: &UnixPath) -> Result<Option<(UnixListener, SocketFile)>, StreamError> {
    clear(&socket.path)?;
    match listen(&socket.path) {
        Ok(bound) => Ok(Some(bound)),
        Err(source) if socket.configured => Err(StreamError::Unix { path: socket.path.clone(), source }),
        Err(error) => {
            tracing::warn!(path = %socket.path.display(), "no Unix socket for the state stream: {error}; TCP serves alone");
            Ok(None)
        }
    }
}

/// Removes the socket that a server left behind which was killed.
fn clear(path: &Path) -> Result<(), StreamError> {
    let Ok(file) = fs::symlink_metadata(path) else {
        return Ok(()); // nothing there, or no way to it: binding will tell
    };
    if !file.file_type().is_socket() {
        return Err(StreamError::NoSocket { path: path.to_owned() });
    }
    match UnixStream::connect(path) {
        // Only a socket without a server refuses.
        Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => {
            fs::remove_file(path).map_err(|source| StreamError::Unix { path: path.to_owned(), source })
        }
        _ => Err(StreamError::UnixInUse { path: path.to_owned() }),
    }
}

fn listen(path: &Path) -> io::Result<(UnixListener, SocketFile)> {
    let listener = UnixListener::bind(path)?;
    // From here on the file is removed when something fails.
    let file = SocketFile { path: path.to_owned(), identity: identity(&fs::symlink_metadata(path)?) };
    fs::set_permissions(path, fs::Permissions::from_mode(SOCKET_MODE))?;
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
        let (listener, file) = unix(&socket).expect("bound").expect("a socket");
        // Kept elsewhere, so that its inode is not given to the next file.
        fs::rename(&path, folder.path().join("old.sock")).expect("renamed");
        let _second = UnixListener::bind(&path).expect("another server");
        drop((listener, file));
        assert!(path.exists());
    }
}

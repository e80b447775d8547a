//! The control socket's file.

use std::io;
use std::os::unix::net::{UnixListener, UnixStream};

use thiserror::Error;

use crate::config::UnixPath;
use crate::unix_socket::{self, Purpose, SocketFile, UnixSocketError};

/// Orders are for the owner and the group of the socket.
const SOCKET: Purpose = Purpose {
    name: "control socket",
    key: "[stream] control",
    without: "`tumbled ctl` cannot give orders",
    mode: 0o660,
};

/// Why no orders can be taken.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ControlError {
    /// The socket cannot be had.
    #[error(transparent)]
    Socket(#[from] UnixSocketError),
    /// No thread.
    #[error("cannot start the control socket's thread: {0}")]
    Start(io::Error),
}

/// A listening socket, whose file is removed with it unless it is another's by then.
#[derive(Debug)]
pub struct Listener {
    socket: UnixListener,
    _file: SocketFile,
}

impl Listener {
    /// Listens. `None`: the default path cannot be written, which has been told.
    ///
    /// # Errors
    /// A configured path that cannot be had; a path that somebody else has.
    pub fn bind(unix: &UnixPath) -> Result<Option<Self>, ControlError> {
        let bound = unix_socket::listen(unix, &SOCKET)?;
        Ok(bound.map(|(socket, file)| Self { socket, _file: file }))
    }

    /// The next connection, without waiting. By a method, so that a closure that takes connections owns the file too.
    pub(super) fn accept(&self) -> io::Result<UnixStream> {
        self.socket.accept().map(|(connection, _)| connection)
    }
}

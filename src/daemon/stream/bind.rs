//! The listeners: where the stream can be reached.

use std::io;
use std::net::SocketAddr;
use std::os::unix::net::UnixListener;

use socket2::{Domain, Protocol, Socket, Type};
use thiserror::Error;

use super::reach::NonLive;
use crate::config::UnixPath;
use crate::unix_socket::{self, Purpose, SocketFile, UnixSocketError};

/// Everybody on the machine may read the state, as over loopback; the folder's mode can narrow that.
const SOCKET: Purpose =
    Purpose { name: "Unix socket of the state stream", key: "[stream] unix", without: "TCP serves alone", mode: 0o666 };

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
    /// The Unix socket cannot be had.
    #[error(transparent)]
    Unix(#[from] UnixSocketError),
    /// The threads or the HELLO line could not be made.
    #[error("cannot start the state stream: {0}")]
    Start(#[from] io::Error),
}

/// Listens on a TCP address.
pub(super) fn tcp(address: SocketAddr) -> Result<std::net::TcpListener, StreamError> {
    listen(address, BACKLOG).map_err(|source| StreamError::Tcp { address, source })
}

/// A listener for an asynchronous server; the kernel holds `backlog` connections until they are accepted.
pub(crate) fn listen(address: SocketAddr, backlog: i32) -> io::Result<std::net::TcpListener> {
    let socket = Socket::new(Domain::for_address(address), Type::STREAM, Some(Protocol::TCP))?;
    // A restart must not wait for the old connections to time out.
    socket.set_reuse_address(true)?;
    socket.bind(&address.into())?;
    socket.listen(backlog)?;
    socket.set_nonblocking(true)?;
    Ok(socket.into())
}

/// Listens on a Unix socket. `None`: the default path cannot be written, which has been told.
pub(super) fn unix(socket: &UnixPath) -> Result<Option<(UnixListener, SocketFile)>, StreamError> {
    Ok(unix_socket::listen(socket, &SOCKET)?)
}

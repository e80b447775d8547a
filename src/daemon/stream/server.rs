//! The server: started and stopped by the synchronous daemon.

use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use tokio::net::{TcpListener, UnixListener};
use tokio::runtime::{Builder, Runtime};
use tokio::task::JoinHandle;
use tokio::time::timeout;

use super::accept::{Listener, accept};
use super::bind::{self, StreamError};
use super::hello::{Hello, StreamOrigin};
use super::hub::{ClientTotals, Hub, Publisher};
use super::limits::Limits;
use super::reach;
use crate::config::{self, UnixPath};
use crate::unix_socket::SocketFile;

/// Worker threads: one may be busy with a large line while the other serves the rest.
const WORKERS: usize = 2;

/// How long the runtime may take to end once every client was told.
const RUNTIME_END: Duration = Duration::from_millis(200);

/// Where the stream is served, and to whom.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StreamConfig {
    /// TCP address; port 0 takes a free one; none: no TCP.
    pub tcp: Option<SocketAddr>,
    /// Unix socket; none: no Unix socket.
    pub unix: Option<UnixPath>,
    /// Whether data that are not live may be served beyond this machine.
    pub allow_nonlive: bool,
    /// What clients may take of the daemon.
    pub limits: Limits,
}

impl StreamConfig {
    /// What a rig's config says, with the usual limits.
    pub fn of(config: &config::StreamConfig, allow_nonlive: bool) -> Self {
        Self { tcp: config.tcp, unix: config.unix.clone(), allow_nonlive, limits: Limits::default() }
    }
}

/// Where a server listens.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct StreamAddresses {
    /// TCP, with the port that was chosen.
    pub tcp: Option<SocketAddr>,
    /// The Unix socket.
    pub unix: Option<PathBuf>,
}

/// A running server. Dropped, it ends at once; [`StreamServer::stop`] lets clients take what waits for them.
#[derive(Debug)]
pub struct StreamServer {
    /// `None` once stopped.
    runtime: Option<Runtime>,
    hub: Arc<Hub>,
    doors: Vec<JoinHandle<()>>,
    addresses: StreamAddresses,
    /// Removes the socket's file when dropped.
    socket: Option<SocketFile>,
    origin: StreamOrigin,
}

impl StreamServer {
    /// Binds and serves. `hello` is what every client is told first.
    ///
    /// # Errors
    /// [`StreamError`]: an address or a path cannot be had, or must not be for these data.
    pub fn start(config: StreamConfig, hello: &Hello) -> Result<Self, StreamError> {
        if let Some(address) = config.tcp {
            reach::check("the state stream", address, hello.origin, config.allow_nonlive)?;
        }
        let tcp = config.tcp.map(bind::tcp).transpose()?;
        let unix = config.unix.as_ref().map(bind::unix).transpose()?.flatten();
        let hub = Hub::new(config.limits, hello).map_err(io::Error::other)?;
        let runtime = runtime()?;
        // Sockets are registered with the runtime that is entered.
        let entered = runtime.enter();
        let mut doors = Vec::new();
        let mut addresses = StreamAddresses::default();
        if let Some(listener) = tcp {
            addresses.tcp = Some(listener.local_addr()?);
            doors.push(Listener::Tcp(TcpListener::from_std(listener)?));
        }
        let mut socket = None;
        if let Some((listener, file)) = unix {
            addresses.unix = Some(file.path().to_owned());
            doors.push(Listener::Unix(UnixListener::from_std(listener)?));
            socket = Some(file);
        }
        let doors = doors.into_iter().map(|listener| tokio::spawn(accept(listener, Arc::clone(&hub)))).collect();
        drop(entered);
        let server = Self { runtime: Some(runtime), hub, doors, addresses, socket, origin: hello.origin };
        server.tell_where();
        Ok(server)
    }

    fn tell_where(&self) {
        let word = |address: Option<String>| address.unwrap_or_else(|| "none".to_owned());
        let tcp = word(self.addresses.tcp.map(|address| address.to_string()));
        let unix = word(self.addresses.unix.as_ref().map(|path| path.display().to_string()));
        tracing::info!(%tcp, %unix, origin = self.origin.name(), "state stream");
    }

    /// Where it listens.
    pub fn addresses(&self) -> &StreamAddresses {
        &self.addresses
    }

    /// The way to the clients.
    pub fn publisher(&self) -> Publisher {
        Publisher::new(Arc::clone(&self.hub))
    }

    /// The clients now and what was counted since the start.
    pub fn clients(&self) -> ClientTotals {
        self.hub.totals()
    }

    /// Tells every client that the server ends, waits [`Limits::farewell`] at most (1 s) for them to take what waits,
    /// and removes the socket's file. Not to be called from an asynchronous task.
    pub fn stop(mut self) -> ClientTotals {
        self.close_doors();
        if let Some(runtime) = self.runtime.take() {
            let hub = Arc::clone(&self.hub);
            // Whoever has not taken it by then has had its time.
            runtime.block_on(async { timeout(hub.limits.farewell, hub.all_left()).await.unwrap_or_default() });
            runtime.shutdown_timeout(RUNTIME_END);
        }
        self.hub.totals()
    }

    fn close_doors(&mut self) {
        for door in self.doors.drain(..) {
            door.abort();
        }
        self.socket = None;
        self.hub.stop();
    }
}

impl Drop for StreamServer {
    fn drop(&mut self) {
        self.close_doors();
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

/// Its own, so that nothing else the daemon does waits for clients.
fn runtime() -> io::Result<Runtime> {
    let number = AtomicUsize::new(0);
    Builder::new_multi_thread()
        .worker_threads(WORKERS)
        .thread_name_fn(move || format!("stream-{}", number.fetch_add(1, Ordering::Relaxed)))
        .enable_io()
        .enable_time()
        .build()
}

//! The servers of a session, as the config wants them.

use tumbled_model::UnixNs;

use super::publish::Publish;
use crate::cli::Failure;
use crate::config::Config;
use crate::stream::{Hello, Limits, SocketPath, StreamConfig, StreamOrigin, StreamServer};

/// What a session is, for those who connect.
#[derive(Clone, Copy, Debug)]
pub struct About<'a> {
    /// Its id.
    pub session: &'a str,
    /// Where its data come from.
    pub origin: StreamOrigin,
    /// Wall time at rig time 0.
    pub unix_at_zero: UnixNs,
}

/// The running servers.
#[derive(Debug)]
pub struct Servers {
    stream: StreamServer,
    max_cloud_points: usize,
}

impl Servers {
    /// Starts what the config names.
    ///
    /// # Errors
    /// An address or a path that cannot be had, or must not be for these data: exit code 2.
    pub fn start(config: &Config, about: About<'_>, allow_nonlive: bool) -> Result<Self, Failure> {
        let unix = config.stream.unix.as_ref();
        let unix = unix.map(|unix| SocketPath { path: unix.path.clone(), configured: unix.configured });
        let stream = StreamConfig { tcp: config.stream.tcp, unix, allow_nonlive, limits: Limits::default() };
        let hello = Hello::new(about.session, &config.name, about.origin, about.unix_at_zero);
        let stream = StreamServer::start(stream, &hello).map_err(Failure::input)?;
        Ok(Self { stream, max_cloud_points: config.stream.max_cloud_points })
    }

    /// The way to those who are connected.
    pub fn publish(&self, about: About<'_>) -> Publish {
        Publish::new(about.origin, about.unix_at_zero, self.max_cloud_points, Some(self.stream.publisher()))
    }

    /// The state stream.
    pub fn stream(&self) -> &StreamServer {
        &self.stream
    }

    /// Ends them: clients take what waits for them, for a second at most.
    pub fn stop(self) {
        self.stream.stop();
    }
}

//! Who may see data that are no measurement.

use std::net::SocketAddr;

use thiserror::Error;

use super::hello::StreamOrigin;

/// An address that other machines reach, for data that are no measurement.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("{service} on {address} would be seen by other machines, and the data are {}, not live: name a loopback address, or allow it with --allow-nonlive", origin.name())]
pub struct NonLive {
    /// What would listen there.
    pub service: &'static str,
    /// The address.
    pub address: SocketAddr,
    /// Where the data come from.
    pub origin: StreamOrigin,
}

/// Refuses an address that other machines reach unless the data are live or it is allowed. `service` is what would
/// listen there, for the message.
///
/// # Errors
/// [`NonLive`].
pub fn check(
    service: &'static str,
    address: SocketAddr,
    origin: StreamOrigin,
    allow_nonlive: bool,
) -> Result<(), NonLive> {
    if address.ip().to_canonical().is_loopback() {
        return Ok(());
    }
    if origin != StreamOrigin::Live && !allow_nonlive {
        return Err(NonLive { service, address, origin });
    }
    tracing::warn!(%address, origin = origin.name(), "{service} can be read by other machines, as configured");
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_live_data_leave_the_machine_unless_it_is_allowed() {
        let elsewhere: SocketAddr = "0.0.0.0:7117".parse().expect("an address");
        for origin in [StreamOrigin::Replay, StreamOrigin::Simulated] {
            let error = check("the state stream", elsewhere, origin, false).expect_err("refused");
            assert!(error.to_string().contains("--allow-nonlive") && error.to_string().contains(origin.name()));
            assert!(check("the state stream", elsewhere, origin, true).is_ok());
            assert!(check("the state stream", "[::1]:7117".parse().expect("an address"), origin, false).is_ok());
        }
        assert!(check("the state stream", elsewhere, StreamOrigin::Live, false).is_ok());
    }
}

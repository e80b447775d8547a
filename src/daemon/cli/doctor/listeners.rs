//! Where the state would be told: can a session listen there?

use std::io::ErrorKind;
use std::net::{SocketAddr, TcpListener};
use std::os::unix::fs::FileTypeExt;
use std::os::unix::net::UnixStream;
use std::path::Path;

use super::report::{Finding, Level};
use crate::config::{StreamConfig, UnixPath};

const CHECK: &str = "stream";

/// The TCP ports and the Unix socket.
pub(super) fn check(stream: &StreamConfig) -> Vec<Finding> {
    let tcp = [("stream.tcp", stream.tcp), ("stream.http", stream.http), ("stream.foxglove", stream.foxglove)];
    let tcp = tcp.into_iter().filter_map(|(key, address)| Some(tcp_port(key, address?)));
    tcp.chain(stream.unix.as_ref().map(unix_socket)).collect()
}

fn tcp_port(key: &str, address: SocketAddr) -> Finding {
    let finding = match TcpListener::bind(address) {
        Ok(_) => Finding::ok(CHECK, format!("{address} is free")),
        Err(error) => {
            let remedy = match error.kind() {
                ErrorKind::AddrInUse => format!(
                    "`ss -tlpn 'sport = :{}'` shows by whom (a running tumbled?): end it, or set {key}",
                    address.port()
                ),
                ErrorKind::AddrNotAvailable => format!("`ip address` lists this machine's addresses: set {key}"),
                _ => format!("set {key} to another address or port"),
            };
            Finding::fail(CHECK, format!("cannot listen on {address}: {error}"), remedy)
        }
    };
    finding.of(key)
}

fn unix_socket(socket: &UnixPath) -> Finding {
    let UnixPath { path, configured } = socket;
    let remedy = "make its folder writable, name another path, or an empty one for none: stream.unix";
    let finding = match std::fs::symlink_metadata(path) {
        Ok(file) if !file.file_type().is_socket() => {
            Finding::fail(CHECK, format!("{} is no socket: it is left alone", path.display()), remedy)
        }
        Ok(_) if UnixStream::connect(path).is_ok() => {
            let remedy = "a running tumbled? End it, or name another path: stream.unix";
            Finding::fail(CHECK, format!("another program serves {}", path.display()), remedy)
        }
        // Nothing there, or a socket that a killed program left behind.
        _ => match may_make(path) {
            Ok(()) => Finding::ok(CHECK, format!("{} can be made", path.display())),
            Err(error) => {
                let message = format!("{} cannot be made: {error}", path.display());
                // The default is for an installed service: without it TCP serves alone.
                let level = if *configured { Level::Fail } else { Level::Warn };
                Finding { level, ..Finding::warn(CHECK, message, remedy) }
            }
        },
    };
    finding.of("stream.unix")
}

/// Whether a file could be made at a path, tried with a nameless one beside it.
fn may_make(path: &Path) -> std::io::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    tempfile::tempfile_in(folder).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::net::UnixListener;

    #[test]
    fn a_unix_socket_is_judged_by_what_lies_there() {
        let folder = tempfile::tempdir().expect("a folder");
        let judge = |name: &str, configured| {
            let finding = unix_socket(&UnixPath { path: folder.path().join(name), configured });
            (finding.level, finding.message)
        };
        assert_eq!(judge("new.sock", true).0, Level::Ok);
        let missing = |configured| judge("nowhere/state.sock", configured).0;
        assert_eq!((missing(true), missing(false)), (Level::Fail, Level::Warn), "the default path is only a warning");
        std::fs::write(folder.path().join("file"), "").expect("a file");
        assert!(judge("file", false).1.contains("is no socket"));
        let served = UnixListener::bind(folder.path().join("state.sock")).expect("a socket");
        assert_eq!(judge("state.sock", true).0, Level::Fail);
        drop(served);
        assert_eq!(judge("state.sock", true).0, Level::Ok, "left behind by a program that is gone");
    }

    #[test]
    fn a_tcp_port_in_use_is_told_with_the_way_to_its_owner() {
        let owner = TcpListener::bind("127.0.0.1:0").expect("a free port");
        let address = owner.local_addr().expect("bound");
        let finding = tcp_port("stream.tcp", address);
        assert_eq!(finding.level, Level::Fail);
        assert!(finding.remedy.expect("a remedy").contains(&format!("'sport = :{}'", address.port())));
        drop(owner);
        assert_eq!(tcp_port("stream.tcp", address).level, Level::Ok);
        // 192.0.2.0/24 is reserved for documentation (RFC 5737): no machine has it.
        let elsewhere = tcp_port("stream.tcp", "192.0.2.1:7117".parse().expect("an address"));
        assert!(elsewhere.remedy.expect("a remedy").contains("ip address"), "{}", elsewhere.message);
    }
}

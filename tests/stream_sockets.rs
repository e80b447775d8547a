//! Where the state stream listens: TCP and a Unix socket, and what stands in the way.

use std::fs;
use std::os::unix::fs::{FileTypeExt, PermissionsExt};
use std::os::unix::net::UnixListener;
use std::path::PathBuf;

use tumbled::config::UnixPath;
use tumbled::stream::{Class, Limits, StreamConfig, StreamError, StreamServer};
use tumbled::unix_socket::UnixSocketError;

use crate::support::Workbench;
use crate::support::stream::{Client, hello, marked, on_a_free_port, server};

fn with_socket(path: PathBuf, configured: bool) -> StreamConfig {
    StreamConfig { unix: Some(UnixPath { path, configured }), ..on_a_free_port(Limits::default()) }
}

#[test]
fn the_unix_socket_speaks_the_same_and_its_file_goes_with_the_server() {
    let bench = Workbench::new();
    let path = bench.path("state.sock");
    let server = StreamServer::start(with_socket(path.clone(), true), &hello()).expect("starts");
    assert_eq!(server.addresses().unix.as_deref(), Some(path.as_path()));
    let mode = fs::metadata(&path).expect("the socket").permissions().mode();
    // Everybody on the machine may connect, as over loopback.
    assert_eq!(mode & 0o777, 0o666);
    let mut by_path = Client::connect_unix(&path);
    let mut by_port = Client::connect(&server);
    server.publisher().publish_json(Class::Health, marked(Class::Health, 7));
    assert_eq!(by_path.next(), by_port.next());
    server.stop();
    assert!(!path.exists());
}

#[test]
fn a_socket_that_a_killed_server_left_is_replaced() {
    let bench = Workbench::new();
    let path = bench.path("state.sock");
    drop(UnixListener::bind(&path).expect("a server that was killed"));
    assert!(path.exists());
    let server = StreamServer::start(with_socket(path.clone(), false), &hello()).expect("starts");
    Client::connect_unix(&path);
    drop(server);
    assert!(!path.exists(), "removed without a stop, too");
}

#[test]
fn a_socket_that_is_served_is_left_to_its_server() {
    let bench = Workbench::new();
    let path = bench.path("state.sock");
    let first = StreamServer::start(with_socket(path.clone(), true), &hello()).expect("starts");
    for configured in [true, false] {
        let second = StreamServer::start(with_socket(path.clone(), configured), &hello());
        assert!(matches!(second, Err(StreamError::Unix(UnixSocketError::InUse { .. }))), "{second:?}");
    }
    Client::connect_unix(&path);
    first.stop();
}

#[test]
fn what_is_no_socket_is_never_removed() {
    let bench = Workbench::new();
    let path = bench.path("state.sock");
    fs::write(&path, "precious").expect("a file");
    for configured in [true, false] {
        let error = StreamServer::start(with_socket(path.clone(), configured), &hello()).expect_err("no socket");
        assert!(error.to_string().contains("is no socket"), "{error}");
    }
    assert!(!fs::metadata(&path).expect("still there").file_type().is_socket());
    assert_eq!(fs::read_to_string(&path).expect("readable"), "precious");
}

#[test]
fn a_path_that_cannot_be_written_is_an_error_if_it_was_asked_for() {
    let bench = Workbench::new();
    let path = bench.path("missing/state.sock");
    let error = StreamServer::start(with_socket(path.clone(), true), &hello()).expect_err("no folder");
    assert!(matches!(error, StreamError::Unix { .. }) && error.to_string().contains("missing/state.sock"), "{error}");
    let server = StreamServer::start(with_socket(path.clone(), false), &hello()).expect("goes on without");
    assert_eq!(server.addresses().unix, None);
    Client::connect(&server);
}

#[test]
fn a_port_that_is_taken_is_named() {
    let first = server(Limits::default());
    let taken = first.addresses().tcp;
    let error =
        StreamServer::start(StreamConfig { tcp: taken, ..StreamConfig::default() }, &hello()).expect_err("taken");
    assert!(error.to_string().contains(&taken.expect("TCP").to_string()), "{error}");
}

#[test]
fn simulated_data_do_not_leave_the_machine_unless_it_is_allowed() {
    let everywhere = StreamConfig { tcp: Some(([0, 0, 0, 0], 0).into()), ..StreamConfig::default() };
    let error = StreamServer::start(everywhere.clone(), &hello()).expect_err("simulated");
    assert!(error.to_string().contains("--allow-nonlive"), "{error}");
    let allowed = StreamServer::start(StreamConfig { allow_nonlive: true, ..everywhere }, &hello());
    assert!(allowed.is_ok(), "{allowed:?}");
}

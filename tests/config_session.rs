//! The sections about a session: time, stream, record.

use std::num::NonZeroU32;
use std::path::Path;
use std::time::Duration;

use tumbled::config::{
    ClockMethod, Config, DEFAULT_STREAM_SOCKET, RecordConfig, StreamConfig, TelemetryKinds, TimeConfig, load,
};
use tumbled_io::recording::RingBound;
use tumbled_model::Span;

use crate::support::Workbench;

fn with(settings: &[&str]) -> Config {
    let settings: Vec<String> = settings.iter().map(|setting| (*setting).to_owned()).collect();
    load(None, &settings).expect("fine").config
}

/// What is said about settings that are refused: messages and remedies.
fn refused(settings: &[&str]) -> Vec<String> {
    let settings: Vec<String> = settings.iter().map(|setting| (*setting).to_owned()).collect();
    let error = load(None, &settings).expect_err("refused");
    error.problems.iter().map(|p| format!("{p} / {}", p.help.as_deref().unwrap_or_default())).collect()
}

#[test]
fn the_built_in_session_listens_on_loopback_and_records_in_parts() {
    let Config { time, stream, record, .. } = with(&[]);
    let expected = TimeConfig { hold: Span(150_000_000), silent_after: Span(2_000_000_000), clock: ClockMethod::Hull };
    assert_eq!(time, expected);
    let StreamConfig { tcp, unix, control, http, foxglove, .. } = stream;
    let control = control.expect("a socket");
    assert_eq!((control.path.to_str(), control.configured), (Some("/run/tumbled/control.sock"), false));
    assert_eq!((stream.telemetry, stream.telemetry_kind, stream.rate_hz), (None, TelemetryKinds::Epoch, Some(100.0)));
    assert_eq!(stream.point_horizons, [Span(100_000_000), Span(500_000_000), Span(1_000_000_000)]);
    assert_eq!(tcp, "127.0.0.1:7117".parse().ok());
    assert_eq!(http, "127.0.0.1:8080".parse().ok());
    assert_eq!(foxglove, "127.0.0.1:8765".parse().ok());
    assert_eq!(stream.max_cloud_points, 2_000);
    let unix = unix.expect("a socket");
    assert_eq!((unix.path.as_path(), unix.configured), (Path::new(DEFAULT_STREAM_SOCKET), false));
    let rotate_after = Some(Duration::from_secs(600));
    let pretrigger = RingBound { span: Span(30_000_000_000), bytes: 256 << 20 };
    let (min_free, rotate) = (Some(1 << 30), Some(4 << 30));
    assert_eq!(record, RecordConfig { min_free, rotate, rotate_after, keep: None, pretrigger });
    assert!(!stream.http_control, "nobody orders from a page unless somebody wanted it");
}

#[test]
fn predictions_have_a_rate_and_horizons_in_their_ranges_or_are_off() {
    let off = with(&["stream.rate_hz=0", "stream.point_horizons_ms=[]"]).stream;
    assert_eq!((off.rate_hz, off.point_horizons), (None, Vec::new()));
    for wrong in ["stream.rate_hz=0.05", "stream.rate_hz=1001", "stream.rate_hz=-1", "stream.telemetry_kind=all"] {
        assert_eq!(refused(&[wrong]).len(), 1, "{wrong}");
    }
    for wrong in ["[0.0]", "[10001.0]", "[200.0, 100.0]", "[100.0, 100.0]", "[1,2,3,4,5,6,7,8,9]"] {
        let said = refused(&[&format!("stream.point_horizons_ms={wrong}")]);
        assert!(said.len() == 1 && said[0].contains("point_horizons_ms"), "{wrong}: {said:?}");
    }
    let nothing = ["stream.rate_hz=0", "stream.telemetry=127.0.0.1:7118", "stream.telemetry_kind=predicted"];
    assert!(refused(&nothing)[0].contains("nothing would be sent"), "{:?}", refused(&nothing));
}

#[test]
fn an_empty_text_switches_a_listener_or_a_limit_off() {
    let off = ["stream.tcp=", "stream.unix=", "stream.foxglove=", "record.min_free=", "record.rotate="];
    let config = with(&[&off[..], &["record.rotate_after=", "record.keep=3", "record.pretrigger="]].concat());
    assert_eq!((config.stream.tcp, config.stream.unix, config.stream.foxglove), (None, None, None));
    let keep = NonZeroU32::new(3);
    let pretrigger = RingBound { span: Span(0), bytes: 256 << 20 };
    assert_eq!(config.record, RecordConfig { min_free: None, rotate: None, rotate_after: None, keep, pretrigger });
    for (wrong, part) in [("record.pretrigger=long", "expected a duration"), ("record.pretrigger_bytes=5GiB", "4 GiB")]
    {
        let said = refused(&[wrong]);
        assert!(said.len() == 1 && said[0].contains(part), "{wrong}: {said:?}");
    }
}

#[test]
fn a_socket_that_somebody_chose_is_told_from_the_default_and_a_file_names_it_from_its_own_folder() {
    let bench = Workbench::new();
    let file = bench.file("lab/rig.toml", "[stream]\nunix = 'state.sock'\n");
    let unix = load(Some(&file), &[]).expect("fine").config.stream.unix.expect("a socket");
    assert_eq!((unix.path, unix.configured), (bench.path("lab/state.sock"), true));
    let default = format!("stream.unix={DEFAULT_STREAM_SOCKET}");
    assert!(!with(&[&default]).stream.unix.expect("a socket").configured, "the default path, written down");
}

#[test]
fn times_have_limits() {
    assert_eq!(with(&["time.hold_ms=0", "time.clock=arrival"]).time.hold, Span(0));
    assert_eq!(refused(&["time.hold_ms=10001"]).len(), 1);
    assert_eq!(refused(&["time.silent_after_ms=0"]).len(), 1);
    assert_eq!(refused(&["time.clock=gps", "stream.max_cloud_points=0"]).len(), 2);
}

#[test]
fn what_is_no_address_size_or_duration_is_refused_with_the_form_it_has() {
    let long = format!("stream.unix=/run/{}", "x".repeat(103));
    let settings = [
        "stream.tcp=localhost:7117",
        "stream.foxglove=:8765",
        &long, // 5 + 103 bytes: one too many
        "record.min_free=1 gigabyte",
        "record.rotate=1MB",
        "record.rotate_after=10 minutes",
    ];
    insta::assert_snapshot!(refused(&settings).join("\n"));
    assert_eq!(refused(&["stream.tcp=127.0.0.1:9", "stream.foxglove=127.0.0.1:9"]).len(), 1);
    assert_eq!(refused(&["stream.tcp=127.0.0.1:9", "stream.http=127.0.0.1:9"]).len(), 1);
    assert_eq!(with(&["stream.tcp=127.0.0.1:0", "stream.foxglove=127.0.0.1:0"]).stream.tcp.map(|a| a.port()), Some(0));
    assert_eq!(refused(&["record.rotate_after=500ms"]).len(), 1);
}

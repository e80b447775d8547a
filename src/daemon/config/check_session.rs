//! Rules of the sections about a session: addresses, sockets, sizes and durations.

use std::net::SocketAddr;
use std::num::NonZeroU32;
use std::path::Path;
use std::time::Duration;

use tumbled_io::recording::RingBound;
use tumbled_model::Span;

use super::check::{Rules, span_of_ms};
use super::layers::keys;
use super::raw_session::{RawRecord, RawStream, RawTime, TelemetryKinds};
use super::session::{DEFAULT_CONTROL_SOCKET, DEFAULT_STREAM_SOCKET, RecordConfig, StreamConfig, TimeConfig, UnixPath};
use crate::quantity;

/// The longest path of a Unix socket, bytes: `sun_path` has 108 with its end mark.
const SOCKET_PATH_BYTES: usize = 107;

/// The least rate of predicted states above none.
const LEAST_RATE_HZ: f64 = 0.1;
/// Times that points of interest are predicted for.
const MOST_HORIZONS: usize = 8;
/// The farthest of them, ms.
const LONGEST_HORIZON_MS: f64 = 10_000.0;

pub(super) fn time(raw: &RawTime) -> TimeConfig {
    TimeConfig { hold: span_of_ms(raw.hold_ms), silent_after: span_of_ms(raw.silent_after_ms), clock: raw.clock }
}

/// `None`: an address or path that is none, reported.
pub(super) fn stream(rules: &mut Rules<'_>, raw: &RawStream) -> Option<StreamConfig> {
    let tcp = socket_address(rules, "tcp", &raw.tcp, 7117);
    let http = socket_address(rules, "http", &raw.http, 8080);
    let foxglove = socket_address(rules, "foxglove", &raw.foxglove, 8765);
    let telemetry = socket_address(rules, "telemetry", &raw.telemetry, 7118);
    for ((one, a), (other, b)) in [
        (("tcp", tcp), ("foxglove", foxglove)),
        (("tcp", tcp), ("http", http)),
        (("foxglove", foxglove), ("http", http)),
    ] {
        if let Some(address) = a.flatten().filter(|address| b.flatten() == Some(*address) && address.port() != 0) {
            let message = format!("`stream.{one}` and `stream.{other}` are both {address}");
            rules.broken(&keys(&["stream", other]), message, "give each a port of its own");
        }
    }
    let unix = unix_path(rules, "unix", &raw.unix, DEFAULT_STREAM_SOCKET);
    let control = unix_path(rules, "control", &raw.control, DEFAULT_CONTROL_SOCKET);
    let max_cloud_points = usize::try_from(raw.max_cloud_points).unwrap_or(usize::MAX);
    let rate_hz = rate(rules, raw);
    let point_horizons = horizons(rules, &raw.point_horizons_ms);
    Some(StreamConfig {
        tcp: tcp?,
        unix: unix?,
        control: control?,
        http: http?,
        http_control: raw.http_control,
        foxglove: foxglove?,
        telemetry: telemetry?,
        telemetry_kind: raw.telemetry_kind,
        rate_hz: rate_hz?,
        point_horizons: point_horizons?,
        max_cloud_points,
    })
}

/// `Some(None)`: no predicted states. `None`: a rate that is none, or none where telemetry needs one, reported.
fn rate(rules: &mut Rules<'_>, raw: &RawStream) -> Option<Option<f64>> {
    let at = keys(&["stream", "rate_hz"]);
    let rate_hz = (raw.rate_hz > 0.0).then_some(raw.rate_hz);
    if let Some(rate_hz) = rate_hz.filter(|rate_hz| *rate_hz < LEAST_RATE_HZ) {
        let message = format!("`stream.rate_hz` is {rate_hz}: a predicted state comes every 10 s at least");
        rules.broken(&at, message, "write 0.1 or more, e.g. rate_hz = 100.0; 0: no predicted states");
        return None;
    }
    if rate_hz.is_none() && !raw.telemetry.is_empty() && raw.telemetry_kind == TelemetryKinds::Predicted {
        let message = "`stream.telemetry_kind` is \"predicted\" and `stream.rate_hz` is 0: nothing would be sent";
        rules.broken(&at, message.to_owned(), "write e.g. rate_hz = 100.0, or telemetry_kind = \"epoch\"");
        return None;
    }
    Some(rate_hz)
}

/// `None`: horizons that are none, reported.
fn horizons(rules: &mut Rules<'_>, ms: &[f64]) -> Option<Vec<Span>> {
    let in_range = ms.iter().all(|ms| *ms > 0.0 && *ms <= LONGEST_HORIZON_MS);
    let ascending = ms.is_sorted_by(|before, after| before < after);
    if in_range && ascending && ms.len() <= MOST_HORIZONS {
        return Some(ms.iter().copied().map(span_of_ms).collect());
    }
    let message =
        format!("`stream.point_horizons_ms` is {ms:?}: not up to {MOST_HORIZONS} ascending times of 10 s at most");
    rules.broken(&keys(&["stream", "point_horizons_ms"]), message, "write e.g. [100.0, 500.0]; empty: no predictions");
    None
}

/// `Some(None)`: none is wanted. `None`: no address, reported.
fn socket_address(rules: &mut Rules<'_>, key: &str, text: &str, usual_port: u16) -> Option<Option<SocketAddr>> {
    if text.is_empty() {
        return Some(None);
    }
    match text.parse() {
        Ok(address) => Some(Some(address)),
        Err(_) => {
            let what = if key == "telemetry" { "to send to" } else { "to listen on" };
            let help = format!("write the address {what}, e.g. {key} = \"127.0.0.1:{usual_port}\"; empty: none");
            rules.broken(&keys(&["stream", key]), format!("\"{text}\" is not an IP address with a port"), help);
            None
        }
    }
}

/// `Some(None)`: none is wanted. `None`: too long, reported.
fn unix_path(rules: &mut Rules<'_>, key: &str, text: &str, default: &str) -> Option<Option<UnixPath>> {
    let at = keys(&["stream", key]);
    let Some(path) = rules.path(&at, Some(text)) else { return Some(None) };
    let length = path.as_os_str().len();
    if length > SOCKET_PATH_BYTES {
        let message = format!("the path of the socket has {length} bytes, more than the {SOCKET_PATH_BYTES} of a path");
        rules.broken(&at, message, "choose a shorter one, e.g. below /run or /tmp; empty: no socket");
        return None;
    }
    let configured = path != Path::new(default);
    Some(Some(UnixPath { path, configured }))
}

/// `None`: a size or duration that is none, reported.
pub(super) fn record(rules: &mut Rules<'_>, raw: &RawRecord) -> Option<RecordConfig> {
    let min_free = quantity_of(rules, "min_free", &raw.min_free, quantity::size);
    let rotate = quantity_of(rules, "rotate", &raw.rotate, quantity::size);
    if let Some(Some(rotate)) = rotate
        && rotate < RecordConfig::LEAST_ROTATE
    {
        let message = format!("`record.rotate` is {rotate} bytes: a part is at least 1 MiB");
        rules.broken(&keys(&["record", "rotate"]), message, "write e.g. rotate = \"4GiB\"; empty: never by size");
    }
    let rotate_after = quantity_of(rules, "rotate_after", &raw.rotate_after, quantity::duration);
    if let Some(Some(after)) = rotate_after
        && after < Duration::from_secs(1)
    {
        let message = format!("`record.rotate_after` is {} ms: a part covers at least 1 s", after.as_millis());
        let help = "write e.g. rotate_after = \"10m\"; empty: never by time";
        rules.broken(&keys(&["record", "rotate_after"]), message, help);
    }
    let keep = NonZeroU32::new(raw.keep);
    let pretrigger = pretrigger(rules, raw);
    Some(RecordConfig {
        min_free: min_free?,
        rotate: rotate?,
        rotate_after: rotate_after?,
        keep,
        pretrigger: pretrigger?,
    })
}

/// `None`: no time or size, or too much of it, reported.
fn pretrigger(rules: &mut Rules<'_>, raw: &RawRecord) -> Option<RingBound> {
    let span = quantity_of(rules, "pretrigger", &raw.pretrigger, quantity::duration);
    let bytes = quantity_of(rules, "pretrigger_bytes", &raw.pretrigger_bytes, quantity::size);
    let (span, bytes) = (span?.unwrap_or_default(), bytes?.unwrap_or_default());
    if bytes > RecordConfig::MOST_PRETRIGGER {
        let message = format!("`record.pretrigger_bytes` is {bytes}: at most 4 GiB of memory are kept");
        rules.broken(&keys(&["record", "pretrigger_bytes"]), message, "write e.g. pretrigger_bytes = \"256MiB\"");
        return None;
    }
    let span = Span(i64::try_from(span.as_nanos()).unwrap_or(i64::MAX));
    Some(RingBound { span, bytes: usize::try_from(bytes).unwrap_or(usize::MAX) })
}

/// `Some(None)`: empty, not set. `None`: no quantity, reported.
fn quantity_of<T>(
    rules: &mut Rules<'_>,
    key: &str,
    text: &str,
    read: impl Fn(&str) -> Result<T, quantity::QuantityError>,
) -> Option<Option<T>> {
    if text.is_empty() {
        return Some(None);
    }
    match read(text) {
        Ok(quantity) => Some(Some(quantity)),
        Err(expected) => {
            let message = format!("`record.{key}` is \"{text}\": {expected}");
            rules.broken(&keys(&["record", key]), message, "empty: not set");
            None
        }
    }
}

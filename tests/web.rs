//! The operator's page and the metrics of a running daemon.

use std::collections::BTreeMap;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tungstenite::Message;
use tungstenite::client::IntoClientRequest;
use tungstenite::http::HeaderValue;

use crate::support::Workbench;
use crate::support::browser::Browser;
use crate::support::daemon::{Daemon, FREE_PORTS};
use crate::support::replaying::Replaying;

/// So long is waited for what has to happen; a machine that is busy may take its time.
const PATIENCE: Duration = Duration::from_secs(60);

fn demo(bench: &Workbench) -> (Daemon, SocketAddr) {
    let daemon = Daemon::start(bench, &[&["run", "--sim", "demo", "--json"], &FREE_PORTS[..]].concat());
    let http = daemon.http.expect("a page");
    (daemon, http)
}

/// An answer's status and body.
fn get(address: SocketAddr, path: &str, more: &str) -> (u16, String) {
    let mut stream = TcpStream::connect(address).expect("connects");
    stream.set_read_timeout(Some(PATIENCE)).expect("a timeout");
    write!(stream, "GET {path} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n{more}\r\n").expect("sends");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("an answer");
    let (head, body) = answer.split_once("\r\n\r\n").expect("a head");
    let status = head.split(' ').nth(1).and_then(|status| status.parse().ok()).expect("a status");
    (status, body.to_owned())
}

fn once(address: SocketAddr, path: &str, is_there: impl Fn(u16, &str) -> bool) -> String {
    let began = Instant::now();
    loop {
        let (status, body) = get(address, path, "");
        if is_there(status, &body) {
            return body;
        }
        assert!(began.elapsed() < PATIENCE, "{path} says {status} {body}");
        std::thread::sleep(Duration::from_millis(200));
    }
}

/// The samples of a text in the exposition format, by name with labels. Panics on a line that is not in the format.
fn samples(text: &str) -> BTreeMap<String, f64> {
    let is_name = |name: &str| {
        name.starts_with("tumbled_") && name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
    };
    let (mut kinds, mut helped, mut found) = (BTreeMap::new(), Vec::new(), BTreeMap::new());
    assert!(text.ends_with('\n'), "the last line ends too");
    for line in text.lines() {
        if let Some(help) = line.strip_prefix("# HELP ") {
            let (name, words) = help.split_once(' ').expect("a name and a help");
            assert!(is_name(name) && !words.is_empty() && !helped.contains(&name), "{line}");
            helped.push(name);
        } else if let Some(kind) = line.strip_prefix("# TYPE ") {
            let (name, kind) = kind.split_once(' ').expect("a name and a type");
            assert!(["counter", "gauge", "histogram"].contains(&kind), "{line}");
            assert_eq!(helped.last(), Some(&name), "HELP before TYPE");
            assert!(kinds.insert(name, kind).is_none(), "told twice: {line}");
        } else {
            let (series, value) = line.rsplit_once(' ').expect("a series and a value");
            let (name, labels) = series.split_once('{').unwrap_or((series, "}"));
            let family = ["_bucket", "_sum", "_count"]
                .iter()
                .find_map(|end| name.strip_suffix(end).filter(|family| kinds.get(family) == Some(&"histogram")));
            assert!(is_name(name) && kinds.contains_key(family.unwrap_or(name)), "no TYPE before {line}");
            let labels = labels.strip_suffix('}').expect("closed");
            for label in labels.split_terminator("\",") {
                let (key, value) = label.split_once("=\"").expect("key=\"value\"");
                assert!(
                    key.chars().all(|c| c.is_ascii_lowercase()) && !value.trim_end_matches('"').contains('"'),
                    "{line}"
                );
            }
            let value = value.parse().unwrap_or_else(|_| panic!("no number: {line}"));
            assert!(found.insert(series.to_owned(), value).is_none(), "twice: {line}");
        }
    }
    found
}

#[test]
fn a_monitoring_system_reads_health_states_and_metrics_and_other_web_pages_read_nothing() {
    let bench = Workbench::new();
    let (daemon, http) = demo(&bench);
    assert_eq!(once(http, "/healthz", |status, _| status == 200), "ok\n");
    let health: Value = serde_json::from_str(&get(http, "/api/health", "").1).expect("JSON");
    assert_eq!((&health["class"], &health["origin"]), (&"HEALTH".into(), &"simulated".into()));
    let state = once(http, "/api/state", |_, body| body.contains("\"mode\":\"tracking\""));
    let state: Value = serde_json::from_str(&state).expect("JSON");
    assert_eq!((&state["class"], &state["kind"]), (&"STATE".into(), &"epoch".into()));

    let samples = samples(&once(http, "/metrics", |_, body| body.contains("tumbled_mode{mode=\"tracking\"} 1")));
    let value = |series: &str| *samples.get(series).unwrap_or_else(|| panic!("no {series} in {samples:?}"));
    assert_eq!(value("tumbled_origin{origin=\"simulated\"}"), 1.0);
    assert!(value("tumbled_packets_total{sensor=\"near\"}") > 0.0);
    assert_eq!(value("tumbled_client_dropped_total"), 0.0);
    let fused = value("tumbled_fusion_seconds_count");
    assert!(fused > 0.0 && value("tumbled_fusion_seconds_bucket{le=\"+Inf\"}") == fused);
    assert!(value("tumbled_fusion_seconds_sum") > 0.0 && value("tumbled_pretrigger_bytes") > 0.0);
    assert_eq!(value("tumbled_watchdog_feeds_total"), 0.0, "no service manager started it");
    let all = value("tumbled_epoch_latency_seconds_count");
    assert!(all > 0.0 && value("tumbled_epoch_latency_seconds_bucket{le=\"+Inf\"}") == all);

    assert_eq!(get(http, "/api/state", "Origin: http://evil.example\r\n").0, 403);
    assert_eq!(get(http, "/nothing", "").0, 404);
    daemon.signal("TERM");
    assert_eq!(daemon.finish().code, Some(0));
}

#[test]
fn a_page_is_told_hello_first_and_one_that_never_reads_or_comes_from_elsewhere_costs_nothing() {
    let bench = Workbench::new();
    let (daemon, http) = demo(&bench);
    let open = |origin: &'static str| {
        let stream = TcpStream::connect(http).expect("connects");
        stream.set_read_timeout(Some(PATIENCE)).expect("a timeout");
        let mut request = format!("ws://{http}/ws").into_client_request().expect("a request");
        if !origin.is_empty() {
            request.headers_mut().insert("Origin", HeaderValue::from_static(origin));
        }
        tungstenite::client::client(request, stream).map(|(socket, _)| socket).ok()
    };
    assert!(open("http://evil.example").is_none(), "another page is refused");
    let _never_reads = open("").expect("accepted");
    let mut page = open("").expect("accepted");
    let mut classes = Vec::new();
    let began = Instant::now();
    while !["STATE", "HEALTH", "CLOUD"].iter().all(|class| classes.iter().any(|seen| seen == class)) {
        assert!(began.elapsed() < PATIENCE, "{classes:?}");
        let Message::Text(text) = page.read().expect("a line") else { continue };
        let line: Value = serde_json::from_str(&text).expect("JSON");
        assert_eq!(line["seq"], classes.len(), "without gaps");
        classes.push(line["class"].as_str().expect("a class").to_owned());
    }
    assert_eq!(classes.first().map(String::as_str), Some("HELLO"));
    daemon.signal("TERM");
    assert_eq!(daemon.finish().code, Some(0), "it ends with pages open");
}

#[test]
fn the_page_shows_in_a_browser_that_it_is_simulated_and_tracks_with_a_rate_and_finds_a_daemon_that_was_restarted() {
    let bench = Workbench::new();
    let (daemon, http) = demo(&bench);
    let Some(mut browser) = Browser::open(&bench, &format!("http://{http}/")) else { return };
    let began = Instant::now();
    while browser.text_of("mode") != "tracking" || browser.text_of("rate") == "–" {
        assert!(began.elapsed() < PATIENCE, "it says {:?}", browser.text_of("mode"));
        std::thread::sleep(Duration::from_millis(100));
    }
    assert_eq!(browser.text_of("origin"), "SIMULATED");
    let rate: f64 = browser.text_of("rate").split(' ').next().and_then(|rate| rate.parse().ok()).expect("a rate");
    assert!(rate > 1.0, "{rate} °/s");
    assert!(browser.text_of("q-measuring").starts_with("Yes."), "{}", browser.text_of("q-measuring"));
    for question in ["q-well", "q-missing", "q-since", "q-todo"] {
        let answer = browser.text_of(question);
        assert!(!answer.is_empty() && !answer.contains("Not known"), "{question}: {answer}");
    }
    // Something is drawn: not every pixel of a row through the middle is alike.
    let colours = "(() => { const c = document.createElement('canvas'), v = document.getElementById('view'); \
                   c.width = v.width; c.height = v.height; const d = c.getContext('2d'); d.drawImage(v, 0, 0); \
                   return new Set(new Uint32Array(d.getImageData(0, v.height >> 1, v.width, 1).data.buffer)).size })()";
    let began = Instant::now();
    while browser.value(colours).as_u64().is_none_or(|colours| colours < 3) {
        assert!(began.elapsed() < PATIENCE, "the canvas is blank");
        std::thread::sleep(Duration::from_millis(100));
    }
    // A recording is begun and ended from the page.
    until(&mut browser, "recording", |text| text == "not recording");
    browser.press("record");
    until(&mut browser, "told", |text| text.starts_with("recording ("));
    until(&mut browser, "record", |text| text == "Stop recording");
    browser.press("record");
    until(&mut browser, "told", |text| text.starts_with("recorded (") && text.contains(".mcap"));
    assert!(browser.complaints().is_empty(), "{:?}", browser.complaints());

    daemon.signal("TERM");
    assert_eq!(daemon.finish().code, Some(0));
    until(&mut browser, "origin", |text| text == "NOT CONNECTED");
    // A daemon comes back at the same address, and the page finds it by itself.
    let at = format!("stream.http={http}");
    let again =
        Daemon::start(&bench, &[&["run", "--sim", "demo", "--json"], &FREE_PORTS[..], &["--set", &at]].concat());
    until(&mut browser, "origin", |text| text == "SIMULATED");
    again.signal("TERM");
    assert_eq!(again.finish().code, Some(0));
}

/// Waits until an element's text is as wanted.
fn until(browser: &mut Browser, id: &str, is_so: impl Fn(&str) -> bool) {
    let began = Instant::now();
    loop {
        let text = browser.text_of(id);
        if is_so(&text) {
            return;
        }
        assert!(began.elapsed() < PATIENCE, "{id} says {text:?}");
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// Sends an order for the transport, and gives the answer's status and what it says.
fn steer(address: SocketAddr, order: &str) -> (u16, Value) {
    let mut stream = TcpStream::connect(address).expect("connects");
    stream.set_read_timeout(Some(PATIENCE)).expect("a timeout");
    let head = format!("Host: {address}\r\nConnection: close\r\nContent-Type: application/json");
    write!(stream, "POST /api/transport HTTP/1.1\r\n{head}\r\nContent-Length: {}\r\n\r\n{order}", order.len())
        .expect("sends");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("an answer");
    let (head, body) = answer.split_once("\r\n\r\n").expect("a head");
    let status = head.split(' ').nth(1).and_then(|status| status.parse().ok()).expect("a status");
    (status, serde_json::from_str(body).unwrap_or_default())
}

#[test]
fn a_replay_is_held_sent_on_and_begun_anew_over_http_and_in_a_browser() {
    let bench = Workbench::new();
    assert_eq!(bench.run(&["simulate", "demo", "-o", "sim", "--duration", "3s"]).code, 0);
    let held = ["sim/capture.mcap", "--config", "sim/rig.toml", "--hold", "--speed", "1"];
    let replaying = Replaying::start(&bench, &held);
    let http = replaying.http;
    let (status, report) = steer(http, r#"{"do":"pause"}"#);
    assert_eq!((status, &report["paused"], &report["allowed"]), (200, &json!(true), &json!(true)), "{report}");
    assert!(get(http, "/api/control", "").1.contains(r#""allowed":false"#), "a replay takes no orders");
    assert_eq!(steer(http, r#"{"do":"fly"}"#).0, 400);
    let (status, report) = steer(http, r#"{"do":"to","value":1.5}"#);
    assert_eq!(status, 200, "{report}");
    once(http, "/api/transport", |_, body| {
        let report: Value = serde_json::from_str(body).unwrap_or_default();
        report["paused"] == true && report["t_s"].as_f64().is_some_and(|t_s| (1.4..1.6).contains(&t_s))
    });
    // Nothing is played, and HEALTH goes on: of the same time, with the facts of now.
    let health = || serde_json::from_str::<Value>(&get(http, "/api/health", "").1).expect("JSON");
    let held = health();
    once(http, "/api/health", |_, body| {
        let now: Value = serde_json::from_str(body).unwrap_or_default();
        assert_eq!((&now["t_ns"], &now["core"]), (&held["t_ns"], &held["core"]));
        now["shell"]["uptime_s"].as_f64() > held["shell"]["uptime_s"].as_f64().map(|uptime_s| uptime_s + 5.5)
    });
    assert_eq!(get(http, "/healthz", ""), (200, "ok\n".to_owned()), "held for longer than a session that hangs");
    if let Some(mut browser) = Browser::open(&bench, &format!("http://{http}/")) {
        until(&mut browser, "origin", |text| text == "REPLAY" || text == "SIMULATED");
        until(&mut browser, "position", |text| text.starts_with("held at 1."));
        browser.press("play");
        until(&mut browser, "position", |text| text.starts_with("at its end"));
        assert!(browser.complaints().is_empty(), "{:?}", browser.complaints());
        browser.press("restart");
        until(&mut browser, "told", |text| text.starts_with("plays 1 times as fast"));
    }
    steer(http, r#"{"do":"speed","value":"max"}"#);
    steer(http, r#"{"do":"play"}"#);
    once(http, "/api/transport", |_, body| body.contains(r#""ended":true"#));
    assert_eq!(get(http, "/healthz", "").0, 200);
    replaying.signal("TERM");
    assert_eq!(replaying.finish().0, Some(0));
}

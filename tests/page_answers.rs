//! Five questions of whoever comes to the rig, answered by the page's text while something is wrong: is it measuring? how
//! well? what is missing? since when? what to do?

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

use crate::support::Workbench;
use crate::support::browser::Browser;
use crate::support::daemon::{Daemon, FREE_PORTS};
use crate::support::replaying::Replaying;

/// So long is waited for what has to be said; a machine that is busy may take its time.
const PATIENCE: Duration = Duration::from_secs(60);

/// The questions in the order of the page, with what is to be found in the answers.
type Answers = [(&'static str, &'static str); 5];

/// Waits until all answers are as wanted.
fn expect(browser: &mut Browser, scene: &str, answers: &Answers) {
    let began = Instant::now();
    loop {
        let told = answers.map(|(question, _)| browser.text_of(question));
        let are_right = told.iter().zip(answers).all(|(told, (_, wanted))| told.contains(wanted));
        if are_right {
            println!("{scene}: {told:#?}");
            return;
        }
        assert!(began.elapsed() < PATIENCE, "{scene}: {told:#?}");
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// Sends an order for a replay's transport.
fn steer(address: SocketAddr, order: &str) {
    let mut stream = TcpStream::connect(address).expect("connects");
    stream.set_read_timeout(Some(PATIENCE)).expect("a timeout");
    let head = format!("Host: {address}\r\nConnection: close\r\nContent-Type: application/json");
    write!(stream, "POST /api/transport HTTP/1.1\r\n{head}\r\nContent-Length: {}\r\n\r\n{order}", order.len())
        .expect("sends");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).expect("an answer");
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
}

/// The demo's first seconds with something wrong, held at a time.
fn held(bench: &Workbench, at_s: f64, more: &[&str]) -> Replaying {
    let recorded = ["sim/capture.mcap", "--config", "sim/rig.toml", "--hold", "--speed", "0.001"];
    let replaying = Replaying::start(bench, &[&recorded[..], more].concat());
    steer(replaying.http, &format!(r#"{{"do":"to","value":{at_s:.1}}}"#));
    replaying
}

#[test]
fn five_questions_are_answered_on_the_page_in_six_scenes_of_trouble() {
    let bench = Workbench::new();
    let Some(mut browser) = Browser::open(&bench, "about:blank") else { return };
    let done = bench.run(&["simulate", "turntable-20dps", "-o", "sim", "--duration", "5s"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let silent = |sensors: &[&str]| {
        let fault = |sensor: &&str| format!("[[fault]]\nsensor = \"{sensor}\"\nfrom_s = 2.0\naction = \"unplug\"\n");
        format!("seed = 1\n{}", sensors.iter().map(fault).collect::<String>())
    };
    bench.file("lidar.toml", silent(&["front"]));
    bench.file("both.toml", silent(&["front", "near"]));
    let learning = ["--set", "target.background=start", "--set", "target.background_s=3"];
    let elsewhere = ["--set", "target.roi_center_m=[0.0,0.0,-9.0]"];
    let frozen = "seed = 1\n[[fault]]\nsensor = \"near\"\nfrom_s = 2.0\naction = \"freeze\"\n";
    bench.file("frozen.toml", frozen);
    let scenes: [(&str, f64, &[&str], Answers); 5] = [
        (
            "the camera gives the same picture again and again",
            4.5,
            &["--faults", "frozen.toml"],
            [
                ("q-measuring", "Yes. The target is measured"),
                ("q-well", "Usable with care. Rate ±"),
                ("q-missing", "near is frozen"),
                ("q-since", "So for "),
                ("q-todo", "said above with its remedy"),
            ],
        ),
        (
            "the LiDAR's cable is off",
            4.5,
            &["--faults", "lidar.toml"],
            [
                ("q-measuring", "Yes. The target is measured"),
                ("q-well", "Usable with care. Rate ±"),
                ("q-missing", "only one sensor has measured in the last two seconds; front"),
                ("q-since", "So for "),
                ("q-todo", "Check in the table which sensor gives nothing."),
            ],
        ),
        (
            "both cables are off",
            4.5,
            &["--faults", "both.toml"],
            [
                ("q-measuring", "Not at this moment. Its motion is carried on"),
                ("q-well", "Do not use it."),
                ("q-missing", "nothing was measured for more than a second; no sensor delivers data"),
                ("q-since", "So for "),
                ("q-todo", "Check the sensors, and whether something stands before them."),
            ],
        ),
        (
            "nothing stands there",
            2.0,
            &elsewhere,
            [
                ("q-measuring", "No. Nothing that could be the target"),
                ("q-well", "Do not use it."),
                ("q-missing", "nothing stands in the region of interest"),
                ("q-since", "So for "),
                ("q-todo", "Check the target's place and the config's [target] region of interest."),
            ],
        ),
        (
            "the empty room is being learned",
            2.0,
            &learning,
            [
                ("q-measuring", "Not yet. What stands in the empty room is being learned."),
                ("q-well", "Do not use it."),
                ("q-missing", "the empty room is being learned"),
                ("q-since", "So for "),
                ("q-todo", "keep the target out until then"),
            ],
        ),
    ];
    for (scene, at_s, more, answers) in &scenes {
        let replaying = held(&bench, *at_s, more);
        browser.go(&format!("http://{}/", replaying.http));
        expect(&mut browser, scene, answers);
        assert!(browser.complaints().is_empty(), "{scene}: {:?}", browser.complaints());
        browser.go("about:blank");
    }

    let daemon = Daemon::start(&bench, &[&["run", "--sim", "demo", "--json"][..], &FREE_PORTS].concat());
    browser.go(&format!("http://{}/", daemon.http.expect("a page")));
    let well = [
        ("q-measuring", "Yes. The target is measured"),
        ("q-well", "Rate ±"),
        ("q-missing", ""),
        ("q-since", "So for "),
        ("q-todo", ""),
    ];
    expect(&mut browser, "nothing is wrong", &well);
    daemon.signal("TERM");
    daemon.finish();
    expect(
        &mut browser,
        "the daemon has ended",
        &[
            ("q-measuring", "Not known: the daemon does not answer."),
            ("q-well", "Not known."),
            ("q-missing", "The connection to the daemon."),
            ("q-since", "For "),
            ("q-todo", "systemctl status tumbled"),
        ],
    );
}

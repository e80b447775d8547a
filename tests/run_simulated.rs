//! `tumbled run` without hardware: a scene's sensors in real time, through everything that real ones pass.

use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

use serde_json::Value;
use tumbled::cli::replay::ReplayReport;
use tumbled::cli::run::RunReport;
use tumbled::cli::verify::{Verdict, VerifyReport};
use tumbled::stream::StreamOrigin;
use tumbled_core::ClockState;

use crate::rig_files::header;
use crate::support::daemon::{Daemon, Ended, FREE_PORTS};
use crate::support::{Workbench, repository};

/// So long is waited for what has to happen; a machine that is busy may take its time.
const PATIENCE: Duration = Duration::from_secs(60);

fn running(bench: &Workbench, more: &[&str]) -> Daemon {
    Daemon::start(bench, &[&["run", "--json", "--min-free", "0"], &FREE_PORTS[..], more].concat())
}

fn report(ended: &Ended) -> RunReport {
    serde_json::from_str(&ended.report).unwrap_or_else(|error| panic!("{error} in {ended:?}"))
}

/// What a client is told, from HELLO on.
fn lines(daemon: &Daemon, subscribe: &str) -> impl Iterator<Item = Value> + use<> {
    let mut client = TcpStream::connect(daemon.stream.expect("a stream")).expect("connects");
    client.set_read_timeout(Some(PATIENCE)).expect("a timeout");
    client.write_all(format!("{{\"subscribe\":[{subscribe}]}}\n").as_bytes()).expect("sends");
    BufReader::new(client).lines().map(|line| serde_json::from_str(&line.expect("a line")).expect("JSON"))
}

#[test]
fn eight_seconds_of_the_demo_are_a_complete_session_of_two_locked_sensors_and_its_recording_is_the_same_to_the_bit() {
    let bench = Workbench::new();
    let arguments = ["run", "--sim", "demo", "--duration", "8s", "--record", "run.mcap", "--min-free", "0", "--json"];
    let done = bench.run(&[&arguments[..], &FREE_PORTS].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    let live: RunReport = done.json();
    assert_eq!((live.origin, live.complete, live.faults), (StreamOrigin::Simulated, true, None));
    assert_eq!(live.simulation.as_ref().map(|simulation| simulation.scene.as_str()), Some("demo"));
    let sources: Vec<(&str, u64)> = live.sources.iter().map(|source| (&*source.sensor, source.packets)).collect();
    for (sensor, source) in live.sensors.iter().zip(["near", "front"]) {
        let clock = sensor.clock.expect("a clock");
        assert_eq!((&*sensor.id, clock.state), (source, ClockState::Locked));
        assert!(sensor.points.in_epochs > 10_000 && sensor.received > 0, "{sensor:?}");
        // The scene's time is the session's: a device's counter is ahead by what the scene says (754 s and 31 s at the
        // start, 12 and -25 ppm of 8 s more), and stamps seem late by the quickest way, which is below a millisecond.
        let ahead_ns = if source == "near" { 31_000_000_000 } else { 754_000_000_000_i64 };
        let late_ms = (clock.offset_ns + ahead_ns) as f64 * 1e-6;
        assert!((0.0..5.0).contains(&late_ms), "{source}: {late_ms} ms");
        assert!(sources.contains(&(source, sensor.received)), "{sources:?}: {} of {source}", sensor.received);
    }

    let replayed = bench.run(&["replay", "run.mcap", "--json"]);
    assert_eq!(replayed.code, 0, "{}", replayed.stderr);
    let replay: ReplayReport = replayed.json();
    assert_eq!((replay.origin, &replay.session), (StreamOrigin::Simulated, &Some(live.session)));
    assert_eq!((replay.checkpoint, replay.digest), (live.checkpoint, live.digest.clone()));
    let verified: VerifyReport = bench.run(&["verify", "run.mcap", "--json"]).json();
    assert_eq!((verified.verdict, verified.digest), (Verdict::Match, live.digest));
}

#[test]
fn without_a_config_it_is_the_demo_and_everybody_is_told_that_it_is_simulated() {
    let bench = Workbench::new();
    let daemon = running(&bench, &[]);
    let first = daemon.said.lines().next().expect("a line");
    assert!(first.contains("SIMULATED") && first.contains("origin=\"simulated\""), "{first}");
    assert!(first.contains("--config"), "what to do instead: {first}");
    let began = Instant::now();
    let mut lines = lines(&daemon, "\"HEALTH\"");
    let hello = lines.next().expect("HELLO");
    assert_eq!(
        (&hello["class"], &hello["origin"], &hello["rig"]),
        (&"HELLO".into(), &"simulated".into(), &"demo".into())
    );
    let healthy = |line: &Value| {
        assert_eq!((&line["class"], &line["origin"]), (&"HEALTH".into(), &"simulated".into()));
        assert_eq!(line["shell"]["simulation"]["scene"], "demo");
        let sensors = line["core"]["sensors"].as_array().expect("sensors");
        // The turntable has no clock of its own.
        let locked = |clock: &Value| clock.is_null() || clock["state"] == "locked";
        sensors.len() == 3 && sensors.iter().all(|s| s["state"] == "live" && locked(&s["clock"]))
    };
    let both = lines.take_while(|_| began.elapsed() < PATIENCE).find(healthy);
    assert!(both.is_some(), "both sensors live and their clocks locked");
    daemon.signal("TERM");
    let ended = daemon.finish();
    assert_eq!((ended.code, report(&ended).origin), (Some(0), StreamOrigin::Simulated));
}

#[test]
fn faults_are_seen_by_clients_while_they_last_and_told_at_the_end() {
    let bench = Workbench::new();
    bench.file(
        "faults.toml",
        "seed = 7\n[[fault]]\nsensor = \"near\"\nfrom_s = 2.0\nuntil_s = 4.0\naction = \"unplug\"\n\
         [[fault]]\nsensor = \"front\"\nfrom_s = 1.0\nuntil_s = 3.0\naction.loss.probability = 0.05\n",
    );
    let daemon = running(&bench, &["--sim", "demo", "--faults", "faults.toml"]);
    let mut states = Vec::new();
    for line in lines(&daemon, "\"EVENT\"").filter(|line| line["kind"] == "sensor_state" && line["sensor"] == "near") {
        states.push(line["message"].as_str().expect("a message").to_owned());
        if states.iter().any(|state| state.contains("absent (was live)"))
            && states.last().is_some_and(|s| s.contains("is live"))
        {
            break;
        }
    }
    let went = states.iter().position(|state| state == "near is absent (was live)").expect("it was lost");
    // Opened again, with frames at once.
    assert_eq!(states.get(went + 1).map(String::as_str), Some("near is live (was absent)"), "{states:?}");
    daemon.signal("INT");
    let ended = daemon.finish();
    let report = report(&ended);
    let truth = &report.faults.expect("faults").sensors;
    // At most 2 s at 30 Hz; 2 s of 1507 packets/s of which one in twenty is lost: 151 ± 12. Less where the machine is so
    // busy that the pretended devices skip what they are late for.
    assert!((1..=61).contains(&truth["near"].silenced), "{truth:?}");
    assert!((1..=200).contains(&truth["front"].lost), "{truth:?}");
    let front = report.sensors.iter().find(|sensor| &*sensor.id == "front").expect("the LiDAR");
    assert!(front.lost.total >= truth["front"].lost, "{} of {truth:?}", front.lost.total);
}

#[test]
fn a_scenes_own_faults_and_those_of_a_file_are_done_and_told_each_for_itself() {
    let bench = Workbench::new();
    let demo = std::fs::read_to_string(repository().join("config/scenes/demo.toml")).expect("the scene");
    let own = "[[fault]]\nsensor = \"front\"\naction.loss.probability = 0.05\n\n[[lidar]]";
    bench.file("lossy.toml", demo.replace("[[lidar]]", own));
    bench.file("faults.toml", "seed = 7\n[[fault]]\nsensor = \"near\"\nfrom_s = 1.0\naction = \"unplug\"\n");
    let arguments = ["run", "--sim", "lossy.toml", "--faults", "faults.toml", "--duration", "2s", "--json"];
    let recording = ["--record", "run.mcap", "--min-free", "0"];
    let done = bench.run(&[&arguments[..], &recording, &FREE_PORTS].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    let report: RunReport = done.json();
    let own = report.simulation.and_then(|simulation| simulation.faults).expect("the scene's").sensors;
    let asked_for = report.faults.expect("the file's").sensors;
    assert!(own["front"].lost > 50 && own["near"].silenced == 0, "{own:?}");
    assert!(asked_for["front"].lost == 0 && asked_for["near"].silenced > 10, "{asked_for:?}");
    // What the scene's own faults let through comes to those of the file.
    assert_eq!(own["front"].items - own["front"].lost, asked_for["front"].items);
    // The recording says for ever what was done besides.
    let header = header(&bench, "run.mcap");
    assert!(header.session.contains("-faults-") && header.session == report.session, "{}", header.session);
    assert!(header.notes["faults"].contains("unplug"), "{:?}", header.notes);
}

#[test]
fn a_pause_of_this_machine_is_left_out_and_told_and_the_clocks_stay_locked() {
    let bench = Workbench::new();
    let daemon = running(&bench, &["--sim", "demo"]);
    let locked = |line: &Value| {
        let sensors = line["core"]["sensors"].as_array().expect("sensors");
        let has_clock = |sensor: &&Value| !sensor["clock"].is_null();
        sensors.iter().filter(has_clock).all(|sensor| sensor["clock"]["state"] == "locked" && sensor["state"] == "live")
    };
    let mut health = lines(&daemon, "\"HEALTH\"").filter(|line| line["class"] == "HEALTH");
    assert!(health.by_ref().take(60).any(|line| locked(&line)));
    daemon.signal("STOP");
    std::thread::sleep(Duration::from_millis(1_500));
    daemon.signal("CONT");
    let told = |line: &Value| {
        let reasons = line["shell"]["reasons"].as_array().expect("reasons").clone();
        reasons.iter().any(|reason| reason["key"] == "simulation_behind")
    };
    assert!(health.by_ref().take(10).any(|line| told(&line)));
    assert!(health.take(30).any(|line| locked(&line)));
    daemon.signal("INT");
    let ended = daemon.finish();
    assert_eq!(ended.log.matches("too slow for the simulated sensors").count(), 1, "{}", ended.log);
    let report = report(&ended);
    let left_out = report.simulation.expect("a scene").left_out;
    // 0.3 s had been made before; the first stretch after it is given 0.2 s.
    assert!(left_out.left_out_s > 1.0, "{left_out:?}");
    assert!(left_out.latest_ms <= 100.0, "{left_out:?}");
    let front = report.sensors.iter().find(|sensor| &*sensor.id == "front").expect("the LiDAR");
    let late_ms = (front.clock.expect("a clock").offset_ns + 754_000_000_000) as f64 * 1e-6;
    assert!((0.0..5.0).contains(&late_ms), "time was not shifted: {late_ms} ms");
    // Of 1507 data packets and 10 position packets a second those of the pause never come.
    let most = 1_518.0 * (report.duration_s + 0.1 - left_out.left_out_s);
    assert!((front.received as f64) < most, "{} of at most {most}: no burst made up for it", front.received);
}

#[test]
fn two_scenes_run_beside_each_other() {
    let bench = Workbench::new();
    let daemons = [running(&bench, &[]), running(&bench, &["--sim", "tumble"])];
    assert_ne!(daemons[0].data, daemons[1].data);
    for daemon in &daemons {
        let live = |line: &Value| line["core"]["sensors"][1]["state"] == "live";
        assert!(lines(daemon, "\"HEALTH\"").take(60).any(|line| live(&line)));
    }
    for daemon in daemons {
        daemon.signal("INT");
        let ended = daemon.finish();
        assert_eq!(ended.code, Some(0), "{ended:?}");
        let report = report(&ended);
        let front = report.sources.iter().find(|source| source.sensor == "front").expect("the LiDAR");
        // Each hears its own sensor alone: 1507 data packets and 10 position packets a second.
        let most = 1_518.0 * (report.duration_s + 0.1);
        assert!((front.packets as f64) < most, "{} in {} s", front.packets, report.duration_s);
    }
}

#[test]
fn a_sensor_that_is_taken_out_of_the_rig_is_not_simulated() {
    let bench = Workbench::new();
    let arguments = ["run", "--duration", "1500ms", "--json", "--set", "kinect=[]"];
    let done = bench.run(&[&arguments[..], &FREE_PORTS].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    let report: RunReport = done.json();
    let names: Vec<&str> = report.sensors.iter().map(|sensor| &*sensor.id).collect();
    assert_eq!((names, report.sources.len()), (vec!["front", "turntable"], 2));
    assert!(report.sensors[0].received > 1_000, "{report:?}");
    // Ports of loopback, whatever the config says.
    assert!(done.stderr.contains("data=127.0.0.1:") && !done.stderr.contains("data=127.0.0.1:2368"), "{}", done.stderr);
}

#[test]
fn what_makes_no_sense_is_refused_with_the_remedy() {
    let bench = Workbench::new();
    bench.file("rig.toml", "kinect = []\n");
    bench.file("none.toml", "[[fault]]\nsensor = \"left\"\naction = \"unplug\"\n");
    bench.file("wrong.toml", "[[fault]]\naction.loss.probability = 2.0\n");
    let cases: [(&[&str], &[&str]); 6] = [
        (&["--config", "rig.toml", "--sim", "demo"], &["rig.toml", "--sim demo", "leave out --config"]),
        (&["--config", "rig.toml", "--faults", "none.toml"], &["rehearsals", "--sim SCENE"]),
        (&["--sim", "demos"], &["demos", "symmetric", "turntable-20dps"]),
        (&["--faults", "none.toml"], &["left", "front, near"]),
        (&["--faults", "wrong.toml"], &["wrong.toml", "probability", "0 to 1"]),
        (&["--set", "stream.tcp=0.0.0.0:0"], &["simulated", "--allow-nonlive"]),
    ];
    for (arguments, expected) in cases {
        let done = bench.run(&[&["run", "--duration", "100ms"], &FREE_PORTS[..], arguments].concat());
        assert_eq!(done.code, 2, "{arguments:?}: {}", done.stderr);
        assert!(expected.iter().all(|text| done.stderr.contains(text)), "{arguments:?}: {}", done.stderr);
    }
    let allowed = ["run", "--duration", "1s", "--allow-nonlive"];
    let done = bench.run(&[&allowed, &FREE_PORTS[..], &["--set", "stream.tcp=0.0.0.0:0"]].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
}

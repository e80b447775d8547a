//! Devices that come, go and refuse, as the real libfreenect meets them.

use std::os::unix::fs::symlink;
use std::path::Path;
use std::time::{Duration, Instant};

use crate::support::{Environment, Host, assert_true, three_frames};
use fake_libusb_control::Status;

/// Asks until the answer is as wanted, for ten seconds at most.
fn until(host: &mut Host, line: &str, wanted: i64) {
    let end = Instant::now() + Duration::from_secs(10);
    loop {
        let answer = host.ask(line);
        if answer == wanted {
            return;
        }
        assert!(Instant::now() < end, "{line}: {answer}, not {wanted}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

#[test]
fn an_unplugged_camera_ends_the_stream_and_comes_back_at_another_port() {
    let Some(mut host) = Host::start("kinect 1414 serial A7\nframes frames", three_frames) else { return };
    host.stream(2);
    host.receive(5);
    let mut control = host.control();
    assert_eq!(control.send("unplug").expect("obeys"), "");
    assert_eq!(host.ask("run 1000 20"), -1);
    assert_eq!(host.ask("run 1 1"), -1, "it stays so");
    assert_eq!(["stop", "close", "count"].map(|line| host.ask(line)), [-1, 0, 0]);
    let gone = Status { contexts: 1, frames: control.status().expect("answers").frames, ..Status::default() };
    assert_eq!(control.status().expect("answers"), gone);
    assert_ne!(host.ask("open A7"), 0);

    control.send("replug port 2").expect("obeys");
    assert_eq!(["count", "open A7", "mode 2", "start"].map(|line| host.ask(line)), [1, 0, 0, 0]);
    host.receive(5);
    let status = control.status().expect("answers");
    assert_eq!((status.handles, status.claims, status.transfers, status.streaming), (1, 1, 16, 1));
    assert_eq!(control.send("replug").expect_err("it is there").to_string(), "`replug`: error: is plugged in");
    assert_eq!(
        control.send("on 1 unplug").expect_err("one device").to_string(),
        "`on 1 unplug`: error: there is no device 1 of 1"
    );
    assert!(control.send("drop 5").expect("obeys").starts_with("frame "));
    host.finish(&["stop", "close", "shutdown"]).assert_clean();
}

#[test]
fn a_hundred_cycles_leave_nothing_behind() {
    let Some(mut host) = Host::start("kinect 1414\nframes frames\npace fast", three_frames) else { return };
    host.stream(2);
    host.receive(2);
    let mut control = host.control();
    control.status().expect("answers"); // from here on the connection's descriptor is among those counted
    let (descriptors, before) = (host.ask("descriptors"), control.status().expect("answers"));
    for cycle in 0..100 {
        control.send("unplug").expect("obeys");
        assert_eq!(host.ask("run 1000000 20"), -1, "cycle {cycle}");
        host.ask("stop");
        assert_eq!([host.ask("close"), host.ask("count")], [0, 0], "cycle {cycle}");
        control.send(&format!("replug port {}", 1 + cycle % 4)).expect("obeys");
        assert_eq!(["count", "open", "mode 2", "start"].map(|line| host.ask(line)), [1, 0, 0, 0], "cycle {cycle}");
        host.receive(2);
    }
    let after = Status { frames: before.frames, in_flight: before.in_flight, ..control.status().expect("answers") };
    assert_eq!((host.ask("descriptors"), after), (descriptors, before));
    let finished = host.finish(&["stop", "close", "shutdown"]);
    finished.assert_clean();
    let journal = finished.standin.journal().expect("reads");
    assert_eq!((journal.count("claim"), journal.count("submit")), (101, 101));
}

#[test]
fn a_mute_camera_hangs_the_thread_that_opens_it_and_no_other() {
    let script = "kinect 1414 serial MUTE\nmute-from-start\nkinect 1414 serial TALKS\nframes frames\npace fast";
    let Some(mut host) = Host::start(script, three_frames) else { return };
    assert_eq!(["init", "count", "open-in-thread MUTE"].map(|line| host.ask(line)), [0, 2, 0]);
    assert_eq!(["open TALKS", "mode 2", "start"].map(|line| host.ask(line)), [0, 0, 0]);
    host.ask("assemble");
    host.receive(30);
    host.ask("sleep 0.3");
    host.receive(30);
    assert_eq!(host.ask("opened-in-thread"), 0);
    host.control().send("mute off").expect("obeys");
    until(&mut host, "opened-in-thread", 1);
    let finished = host.finish(&["stop", "close", "shutdown"]);
    finished.assert_clean();
    assert_true(&finished, 1);
}

#[test]
fn a_mute_camera_talks_again_after_it_was_without_power() {
    let Some(mut host) = Host::start("kinect 1414 serial A7\nmute", three_frames) else { return };
    assert_eq!(["init", "open-in-thread A7"].map(|line| host.ask(line)), [0, 0]);
    let mut control = host.control();
    host.ask("sleep 0.2");
    assert_eq!(host.ask("opened-in-thread"), 0);
    control.send("unplug").expect("obeys");
    until(&mut host, "opened-in-thread", -1);
    control.send("replug").expect("obeys");
    assert_eq!(["open A7", "close"].map(|line| host.ask(line)), [0, 0]);
}

#[test]
fn two_cameras_stream_side_by_side() {
    for pace in ["fast", "real"] {
        let script = format!("pace {pace}\nkinect 1414 serial A\nframes frames\nkinect 1414 serial B\nframes frames");
        let Some(mut host) = Host::start(&script, three_frames) else { return };
        for line in ["init", "open A", "mode 2", "start", "use 1", "open B", "mode 2", "start", "use 0"] {
            assert_eq!(host.ask(line), 0, "{line}");
        }
        host.receive(60);
        host.ask("use 1");
        let second = host.ask("frames");
        // Both send 30 frames a second from their starts on, which lie a few milliseconds apart.
        assert!((50..=61).contains(&second), "{pace}: {second}");
        // One goes, the other stays.
        host.control().send("on 1 unplug").expect("obeys");
        host.ask("run 1 0.2");
        host.ask("use 0");
        assert_eq!(host.control().status().expect("answers").plugged, 1);
        host.finish(&["use 1", "close", "use 0", "stop", "close", "shutdown"]).assert_clean();
    }
}

#[test]
fn refusals_are_the_kernels() {
    let Some(mut host) = Host::start("kinect 1414\nframes frames\npace fast\nno-permission", three_frames) else {
        return;
    };
    assert_eq!((host.ask("init"), host.ask("count")), (0, 1), "it is seen, but not to be opened");
    let mut control = host.control();
    // libfreenect says −1 to everything; the cause stands in its log alone, by name or by number, as its version has it.
    for (line, number, name) in [
        ("no-permission", "-3", "LIBUSB_ERROR_ACCESS"),
        ("busy", "-6", "LIBUSB_ERROR_BUSY"),
        ("busy not-found", "-5", "LIBUSB_ERROR_NOT_FOUND"),
    ] {
        control.send(line).expect("obeys");
        assert_eq!(host.ask("open"), -1, "{line}");
        control.send("no-permission off").expect("obeys");
        let log = host.stderr();
        assert!(log.contains(&format!("camera: {number}")) || log.contains(name), "{line}: {log}");
    }
    control.send("busy off").expect("obeys");

    // The kernel's driver is taken off, and put back at the end.
    control.send("kernel-driver").expect("obeys");
    assert_eq!((host.ask("open"), host.ask("close")), (0, 0));

    control.send("refuse-bandwidth").expect("obeys");
    assert_eq!(["open", "mode 2", "start"].map(|line| host.ask(line)), [0, 0, 0], "libfreenect does not tell");
    assert_eq!(["run 1 0.3", "frames"].map(|line| host.ask(line)), [0, 0]);
    control.send("refuse-bandwidth off").expect("obeys");
    assert_eq!((host.ask("stop"), host.ask("start")), (0, 0));
    host.receive(1);
    let finished = host.finish(&["stop", "close", "shutdown"]);
    finished.assert_clean();
    let journal = finished.standin.journal().expect("reads");
    // Open and two claims, then sixteen transfers.
    assert_eq!([journal.count("refuse"), journal.count("detach")], [3 + 16, 2]);
    assert_eq!(journal.count("attach"), 2);
}

#[test]
fn later_models_are_opened_by_their_audio_devices_serial() {
    let script = "kinect 1473 serial B2 port 1\nkinect k4w serial C3 port 2\nframes frames\npace fast";
    let Some(mut host) = Host::start(script, three_frames) else { return };
    assert_eq!(["init", "count", "open 0000000000000000"].map(|line| host.ask(line)), [0, 2, -1]);
    assert_eq!(["open B2", "close"].map(|line| host.ask(line)), [0, 0]);
    assert_eq!(["open C3", "mode 0", "start"].map(|line| host.ask(line)), [0, 0, 0]);
    host.receive(3);
    let finished = host.finish(&["stop", "close", "shutdown"]);
    finished.assert_clean();
    let journal = finished.standin.journal().expect("reads");
    let settings: Vec<_> = journal.of("setting").map(|entry| (entry.value("device"), entry.value("setting"))).collect();
    assert_eq!(settings, [(Some("1"), Some("1"))], "the Kinect for Windows streams on its alternate setting");
}

#[test]
fn motor_lamp_and_accelerometer_answer_on_every_model() {
    for (model, subdevices) in [("1414", 3), ("1473", 3), ("k4w", 3)] {
        let script = format!("kinect {model}\naccelerometer 12 -800 77");
        let Some(mut host) = Host::start(&script, |_| ()) else { return };
        assert_eq!(host.ask("init"), 0);
        host.ask(&format!("subdevices {subdevices}"));
        assert_eq!(["open", "tilt -10", "led 1"].map(|line| host.ask(line)), [0, 0, 0], "{model}");
        let state = host.ask_all("state");
        assert!(state[0] >= 0, "{model}: {state:?}");
        assert_eq!(state[1..], [12, -800, 77, -20], "{model}: half degrees");
        let finished = host.finish(&["close", "shutdown"]);
        finished.assert_clean();
        let journal = finished.standin.journal().expect("reads");
        let tilts: Vec<_> = journal.of("tilt").map(|entry| entry.value("half_degrees")).collect();
        assert_eq!(tilts, [Some("-20")], "{model}");
    }
}

#[test]
fn colour_is_dark_and_depth_goes_on_beside_it() {
    let Some(mut host) = Host::start("kinect 1414\nframes frames\npace fast", three_frames) else { return };
    host.stream(2);
    assert_eq!(host.ask("video"), 0);
    host.receive(20);
    assert_eq!(host.control().status().expect("answers").transfers, 32);
    host.finish(&["stop", "stop-video", "close", "shutdown"]).assert_clean();
}

#[test]
fn what_happens_at_a_time_happens_then() {
    let script = "kinect 1414\nframes frames\nat 0.5 unplug\nat 0.8 replug port 3";
    let Some(mut host) = Host::start(script, three_frames) else { return };
    host.stream(2);
    assert_eq!(host.ask("run 1000 20"), -1);
    host.ask("close");
    until(&mut host, "count", 1);
    let finished = host.finish(&["shutdown"]);
    finished.assert_clean();
    let journal = finished.standin.journal().expect("reads");
    let times: Vec<f64> = journal.of("fault").map(|entry| entry.seconds).collect();
    // To a slot of 125 µs, whenever the host looked.
    assert_eq!(times, [0.5, 0.8]);
    // Frames 33.3 ms apart after a start within the first half second; whole ones only.
    let truth = finished.standin.truth().expect("reads");
    assert!(truth.frames(0).all(|frame| frame.seconds < 0.5));
}

#[test]
fn the_stand_in_may_be_put_in_libusbs_place() {
    let instead = |folder: &Path, [preload, script]: Environment| {
        symlink(preload.1, folder.join("libusb-1.0.so.0")).expect("links");
        [("LD_LIBRARY_PATH".into(), folder.as_os_str().to_owned()), script]
    };
    let Some(mut host) = Host::start_with("kinect 1414\nframes frames\npace fast", three_frames, instead) else {
        return;
    };
    host.stream(2);
    host.receive(3);
    host.finish(&["stop", "close", "shutdown"]).assert_clean();
}

#[test]
fn a_script_with_a_mistake_is_told_and_libusb_does_not_begin() {
    let Some(mut host) = Host::start("kinect 1515", |_| ()) else { return };
    assert_ne!(host.ask("init"), 0);
    let stderr = host.stderr();
    assert!(stderr.contains("usb.script: line 1: found model `1515`, expected 1414, 1473 or k4w"), "{stderr}");
}

#[test]
fn a_host_that_leaves_transfers_behind_is_found_out() {
    let Some(mut host) = Host::start("kinect 1414\nframes frames\npace fast", three_frames) else { return };
    host.stream(2);
    host.receive(1);
    let status = host.control().status().expect("answers");
    assert_eq!((status.contexts, status.handles, status.claims, status.transfers), (1, 1, 1, 16));
    // It ends without a word: no exit in the journal.
    let finished = host.finish(&[]);
    assert_eq!(finished.standin.journal().expect("reads").count("exit"), 0);
}

//! Faults on purpose: what is asked for is done, counted, and never taken for what was recorded.

use tumbled::cli::import::ImportReport;
use tumbled::cli::replay::ReplayReport;
use tumbled::cli::simulate::SimulateReport;
use tumbled::cli::verify::{Verdict, VerifyReport};
use tumbled::stream::StreamOrigin;
use tumbled_io::recording::{Origin, Reader};
use tumbled_model::{Body, SourceState};
use tumbled_sim::faults::FaultTruth;

use crate::rig_files::header;
use crate::support::replaying::Replaying;
use crate::support::{Workbench, repository};

/// Three seconds of the accuracy scene, and faults: 5 % of the LiDAR's items lost, the Kinect unplugged for a second.
fn bench() -> Workbench {
    let bench = Workbench::new();
    let scene = std::fs::read_to_string(repository().join("config/scenes/turntable-20dps.toml")).expect("a scene");
    bench.file("short.toml", scene.replace("duration_s = 60.0", "duration_s = 3.0"));
    bench.file(
        "faults.toml",
        "seed = 3\n\n[[fault]]\nsensor = \"front\"\naction.loss.probability = 0.05\n\n\
         [[fault]]\nsensor = \"near\"\nfrom_s = 1.0\nuntil_s = 2.0\naction = \"unplug\"\n",
    );
    bench
}

fn replayed(bench: &Workbench, arguments: &[&str]) -> (ReplayReport, String) {
    let done = bench.run(&[&["replay"], arguments, &["--json"]].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    (done.json(), done.stderr)
}

fn drive(bench: &Workbench) {
    let capture = std::fs::read(repository().join("tests/captures/vlp32c-strongest-600rpm-fov180.pcap"));
    bench.file("drive.pcap", capture.expect("a capture"));
}

#[test]
fn what_is_wrong_with_a_fault_file_is_told_with_its_place_and_the_remedy() {
    let bench = bench();
    let refused = |text: &str, words: &[&str]| {
        bench.file("wrong.toml", text);
        for command in [&["replay", "sim:short.toml"][..], &["simulate", "short.toml", "-o", "out"]] {
            let done = bench.run(&[command, &["--faults", "wrong.toml"]].concat());
            assert_eq!(done.code, 2, "{}", done.stderr);
            for word in words {
                assert!(done.stderr.contains(word), "{word} in {}", done.stderr);
            }
        }
    };
    refused("seed = 1\ncolour = 2\n", &["wrong.toml", "line 2", "colour", "fault"]);
    refused("[[fault]]\naction.lose.probability = 0.1\n", &["line 2", "lose", "loss"]);
    let second = "[[fault]]\naction = \"unplug\"\n\n[[fault]]\naction.loss.probability = 1.5\n";
    refused(second, &["wrong.toml:4", "fault 2", "probability is 1.5", "0 to 1"]);
    let nobodys = "\n[[fault]]\nsensor = \"rear\"\naction = \"unplug\"\n";
    refused(nobodys, &["wrong.toml:2", "no sensor \"rear\"", "front, near, turntable"]);
    assert!(!bench.path("out").exists(), "nothing is written");
    let done = bench.run(&["replay", "sim:short.toml", "--faults", "none.toml"]);
    assert!(done.code == 2 && done.stderr.contains("lost-target, bad-lines"), "{}", done.stderr);
}

#[test]
fn a_replay_with_faults_is_simulated_is_another_session_and_counts_what_it_did() {
    let bench = bench();
    let imported = bench.run(&["import", "sim:short.toml", "-o", "run.mcap"]);
    assert_eq!(imported.code, 0, "{}", imported.stderr);
    let (before, _) = replayed(&bench, &["run.mcap"]);
    assert_eq!(before.faults, None);
    let arguments = ["run.mcap", "--faults", "faults.toml", "--record", "rehearsal.mcap"];
    let (report, log) = replayed(&bench, &arguments);
    assert!(log.contains("FAULTS of faults.toml"), "{log}");
    assert!(report.warnings.iter().any(|warning| warning.contains("not the session")), "{:?}", report.warnings);
    let truth = report.faults.expect("what was done");
    let [near, front] = [&report.sensors[0], &report.sensors[1]];
    // 3 s: 4521 packets, of which 226 ± 15 are lost; 30 frames of the second second.
    let lost = &truth.sensors["front"];
    assert!((170..290).contains(&lost.lost) && lost.items > 4_500, "{lost:?}");
    assert_eq!(front.received, lost.items + 30 - lost.lost - lost.lost_positions, "30 position packets");
    assert_eq!((near.received, truth.sensors["near"].silenced), (60, 30));
    assert_ne!(report.digest, before.digest);
    let session = report.session.expect("a recording");
    assert!(session.starts_with("sim-turntable-20dps-1-faults-"), "{session}");

    // The rehearsal's recording is itself: it says what it is, verifies, and replays without faults to the same bit.
    let header = header(&bench, "rehearsal.mcap");
    assert_eq!((header.origin, &header.session), (Origin::Simulated, &session));
    assert!(header.notes["faults"].contains("\"probability\":0.05"), "{:?}", header.notes);
    let verified: VerifyReport = bench.run(&["verify", "rehearsal.mcap", "--json"]).json();
    assert_eq!((verified.verdict, verified.difference), (Verdict::Match, None));
    assert_eq!(replayed(&bench, &["rehearsal.mcap"]).0.digest, report.digest);
    let reader = Reader::open(&[bench.path("rehearsal.mcap")]).expect("a recording");
    let states = reader.filter_map(|event| match event.expect("an event").body {
        Body::SensorState { state, .. } => Some(state),
        _ => None,
    });
    assert_eq!(states.collect::<Vec<_>>(), [SourceState::Lost, SourceState::Opened]);

    // The same faults again are the same, at any pace and on any number of threads.
    let paced = ["run.mcap", "--faults", "faults.toml", "--speed", "20", "--threads", "1"];
    assert_eq!(replayed(&bench, &paced).0.checkpoint, report.checkpoint);
}

#[test]
fn a_capture_with_faults_is_no_replay_any_more() {
    let bench = bench();
    drive(&bench);
    let (before, _) = replayed(&bench, &["drive.pcap"]);
    bench.file("late.toml", "[[fault]]\naction.delay.delay_s = 0.25\n");
    let (late, _) = replayed(&bench, &["drive.pcap", "--faults", "late.toml"]);
    assert_eq!((before.origin, late.origin), (StreamOrigin::Replay, StreamOrigin::Simulated));
    assert!((late.duration_s - before.duration_s - 0.25).abs() < 1e-3, "{} {}", late.duration_s, before.duration_s);
    assert_ne!(late.digest, before.digest);

    let arguments = ["import", "drive.pcap", "-o", "late.mcap", "--faults", "late.toml", "--json"];
    let imported: ImportReport = bench.run(&arguments).json();
    let delayed = imported.faults.expect("what was done").sensors["front"].delayed;
    assert!(delayed > 0 && imported.session.contains("-faults-"), "{delayed} {}", imported.session);
    assert_eq!(header(&bench, "late.mcap").origin, Origin::Simulated);

    // The sensors are those of the recording that is read, not of a rig by default.
    let other = ["import", "drive.pcap", "--set", "lidar.id=mast", "-o", "mast.mcap"];
    assert_eq!(bench.run(&other).code, 0);
    bench.file("mast.toml", "[[fault]]\nsensor = \"mast\"\naction.loss.probability = 1.0\n");
    let lost: ImportReport =
        bench.run(&["import", "mast.mcap", "-o", "lost.mcap", "--faults", "mast.toml", "--json"]).json();
    let counts = lost.faults.expect("what was done").sensors["mast"];
    assert!(counts.items > 0 && counts.lost == counts.items, "{counts:?}");

    // A window in which nothing comes: nothing is done, and that is said.
    bench.file("never.toml", "[[fault]]\nfrom_s = 1e6\naction = \"unplug\"\n");
    let (never, _) = replayed(&bench, &["drive.pcap", "--faults", "never.toml"]);
    assert_eq!((never.digest, never.origin), (before.digest, StreamOrigin::Simulated));
    assert!(never.warnings.iter().any(|warning| warning.contains("did nothing")), "{:?}", never.warnings);
}

#[test]
fn clients_of_a_rehearsal_are_told_that_it_is_one() {
    let bench = bench();
    drive(&bench);
    bench.file("late.toml", "[[fault]]\naction.delay.delay_s = 0.25\n");
    let replaying = Replaying::start(&bench, &["drive.pcap", "--speed", "0.5", "--faults", "late.toml"]);
    let hello = replaying.lines("HEALTH").next().expect("HELLO");
    assert_eq!((&hello["class"], &hello["origin"]), (&"HELLO".into(), &"simulated".into()), "{hello}");
    replaying.signal("TERM");
    let (_, log) = replaying.finish();
    assert!(log.contains("FAULTS of late.toml"), "{log}");
    let abroad = ["replay", "drive.pcap", "--faults", "late.toml", "--serve", "--set", "stream.tcp=0.0.0.0:0"];
    let done = bench.run(&[&abroad[..], &["--set", "stream.unix=", "--set", "stream.foxglove="]].concat());
    assert!(done.code == 2 && done.stderr.contains("--allow-nonlive"), "{}", done.stderr);
}

#[test]
fn a_simulated_session_with_faults_has_them_in_every_file_and_their_truth_beside() {
    let bench = bench();
    let simulate = |folder: &str, more: &[&str]| -> SimulateReport {
        let done = bench.run(&[&["simulate", "short.toml", "-o", folder, "--json"], more].concat());
        assert_eq!(done.code, 0, "{}", done.stderr);
        done.json()
    };
    let (plain, faulty) = (simulate("plain", &[]), simulate("a", &["--faults", "faults.toml", "--threads", "1"]));
    simulate("b", &["--faults", "faults.toml", "--threads", "2"]);
    for name in ["capture.mcap", "velodyne.pcap", "kinect/INDEX.txt", "serial.log", "faults.json"] {
        assert!(bench.read_bytes(&format!("a/{name}")) == bench.read_bytes(&format!("b/{name}")), "{name}");
    }
    let truth: FaultTruth = serde_json::from_str(&bench.read("a/faults.json")).expect("a truth");
    assert_eq!((plain.faults, faulty.faults.as_ref()), (None, Some(&truth)));
    assert!(!bench.path("plain/faults.json").exists());
    // What moved, moved as it did; the stage's line had no fault.
    for name in ["truth.csv", "serial.log", "mesh.ply", "rig.toml"] {
        assert!(bench.read(&format!("a/{name}")) == bench.read(&format!("plain/{name}")), "{name}");
    }
    let frames = |folder: &str| bench.read(&format!("{folder}/kinect/INDEX.txt")).lines().count() as u64;
    assert_eq!((frames("plain"), frames("a")), (90, 60));
    let counts = truth.sensors["front"];
    assert_eq!(plain.items["front"] - faulty.items["front"], counts.lost + counts.lost_positions);
    // The pcap and the recording have lost the same packets, and the decoder misses those.
    let (from_pcap, _) = replayed(&bench, &["a/velodyne.pcap", "--config", "a/rig.toml"]);
    let (from_recording, _) = replayed(&bench, &["a/capture.mcap"]);
    let received = |report: &ReplayReport| report.sensors.iter().find(|s| s.id.as_str() == "front").map(|s| s.received);
    assert_eq!((received(&from_pcap), received(&from_recording)), (Some(faulty.items["front"]), received(&from_pcap)));
}

#[test]
fn frames_of_a_wrong_length_are_in_the_recording_alone() {
    let bench = bench();
    bench.file("cut.toml", "[[fault]]\nsensor = \"near\"\naction.resize = { probability = 0.2, bytes = 100 }\n");
    let arguments = ["simulate", "short.toml", "-o", "out", "--faults", "cut.toml", "--json"];
    let report: SimulateReport = bench.run(&arguments).json();
    let resized = report.faults.expect("what was done").sensors["near"].resized;
    assert!(resized > 5, "{resized}");
    assert_eq!((report.items["near"], report.frames_left_out), (90, resized));
    assert_eq!(bench.read("out/kinect/INDEX.txt").lines().count() as u64, 90 - resized);
}

#[test]
fn the_programs_own_fault_files_fit_the_programs_own_scenes() {
    let bench = bench();
    for name in ["lost-target", "bad-lines"] {
        let (report, _) = replayed(&bench, &["sim:short.toml", "--faults", name]);
        assert!(report.faults.is_some(), "{name}");
    }
}

//! Scenes as inputs: simulated sensors through everything that real ones pass.

use tumbled::cli::replay::ReplayReport;
use tumbled::stream::StreamOrigin;
use tumbled_core::ClockState;
use tumbled_core::turntable::TruthState;
use tumbled_io::recording::Reader;
use tumbled_model::Body;
use tumbled_serial::log::LogEntry;
use tumbled_serial::zaber::{Heard, LineSettings, Listener, Sample};
use tumbled_velodyne::hdl64::Calibration;

use crate::support::{Workbench, repository};

/// The accuracy scene's file.
fn accuracy_scene() -> String {
    std::fs::read_to_string(repository().join("config/scenes/turntable-20dps.toml")).expect("a scene")
}

/// Six seconds of it.
fn short_scene(bench: &Workbench) {
    bench.file("short.toml", accuracy_scene().replace("duration_s = 60.0", "duration_s = 6.0"));
}

fn replayed(bench: &Workbench, arguments: &[&str]) -> ReplayReport {
    let done = bench.run(&[&["replay"], arguments, &["--json"]].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    done.json()
}

#[test]
fn a_scene_is_a_healthy_rig_whose_clocks_lock_and_whose_points_all_count() {
    let bench = Workbench::new();
    short_scene(&bench);
    let report = replayed(&bench, &["sim:short.toml"]);
    assert_eq!((report.origin, report.complete), (StreamOrigin::Simulated, true));
    let [near, front, turntable] = report.sensors.as_slice() else { panic!("{report:?}") };
    // 30 frames a second; 6 s / 663.552 µs = 9042.3 packets, and a position packet each tenth of a second.
    assert_eq!(near.received, 180);
    assert!((9_102..=9_104).contains(&front.received), "{}", front.received);
    // 50 readings a second of three chunks each: a request, the first byte of the reply, the rest. Six answers open; twice a
    // second the drive is asked for its error.
    assert!((880 + 33..=918 + 36).contains(&turntable.received), "{}", turntable.received);
    let angles = turntable.turntable.as_ref().expect("a turntable");
    assert!((280..=300).contains(&angles.samples) && angles.truth == TruthState::Valid, "{angles:?}");
    // The target turns as the table does, 20 °/s; the filter has had a few seconds to settle.
    let errors = angles.errors.expect("tracked on a turning table");
    assert!(errors.states > 20 && errors.about_axis_deg.abs() < 2.0 && errors.rate_dps.abs() < 1.0, "{errors:?}");
    assert_eq!(errors.axis_deg, None, "no calibration file");
    assert!(near.turntable.is_none() && front.turntable.is_none());
    for sensor in [near, front] {
        let clock = sensor.clock.expect("a clock");
        assert_eq!((clock.state, sensor.lost.total), (ClockState::Locked, 0), "{}", sensor.id);
        assert!(sensor.points.decoded > 50_000 && sensor.points.in_epochs == sensor.points.decoded);
    }
    // The LiDAR's counter runs 18 ppm slow: so much slower than the host.
    let skew = front.clock.expect("a clock").skew_ppm;
    assert!((skew - 18.0).abs() < 2.0, "{skew}");
}

#[test]
fn a_recording_of_a_scene_is_simulated_for_ever_and_replays_to_the_same_bit() {
    let bench = Workbench::new();
    short_scene(&bench);
    let imported = bench.run(&["import", "sim:short.toml", "-o", "run.mcap"]);
    assert_eq!(imported.code, 0, "{}", imported.stderr);
    let (scene, recording) = (replayed(&bench, &["sim:short.toml"]), replayed(&bench, &["run.mcap", "--threads", "2"]));
    assert_eq!(recording.origin, StreamOrigin::Simulated);
    assert_eq!((recording.checkpoint, recording.digest), (scene.checkpoint, scene.digest));
}

#[test]
fn a_scene_that_is_none_is_refused_with_those_there_are() {
    let bench = Workbench::new();
    let done = bench.run(&["replay", "sim:demos"]);
    assert_eq!(done.code, 2);
    // Each by its name, with the beginning of what it is for.
    for scene in ["demo                a box bus", "calibration-sphere  a sphere", "turntable-5dps      a box bus"] {
        assert!(done.stderr.contains(scene), "{}", done.stderr);
    }
    let done = bench.run(&["replay", "sim:demo", "sim:tumble"]);
    assert_eq!(done.code, 2);
    bench.file("wrong.toml", "name = \"x\"\ncolour = 1\n");
    let done = bench.run(&["replay", "sim:wrong.toml"]);
    assert!(done.code == 2 && done.stderr.contains("wrong.toml"), "{}", done.stderr);
}

#[test]
fn simulated_files_are_the_same_session_in_every_format_and_the_same_bytes_for_the_same_seed() {
    let bench = Workbench::new();
    short_scene(&bench);
    for (folder, threads) in [("a", "1"), ("b", "2")] {
        let arguments = ["simulate", "short.toml", "-o", folder, "--duration", "1500ms", "--threads", threads];
        let done = bench.run(&arguments);
        assert_eq!(done.code, 0, "{}", done.stderr);
    }
    let names =
        ["capture.mcap", "velodyne.pcap", "kinect/INDEX.txt", "truth.csv", "mesh.ply", "rig.toml", "rig-true.toml"];
    for name in names.into_iter().chain(["serial.log"]) {
        let (a, b) = (bench.read_bytes(&format!("a/{name}")), bench.read_bytes(&format!("b/{name}")));
        assert!(!a.is_empty() && a == b, "{name}");
    }
    // The pcap and the recording hold the same packets: the same points.
    let points = |input: &str| bench.points(input, "a/rig.toml");
    let from_recording = points("a/capture.mcap");
    assert!(from_recording.len() > 10_000 * 24 && from_recording == points("a/velodyne.pcap"));
    // Truth: 0 to 1.5 s a hundred times a second, and a turn of 20 degrees a second about z.
    let truth = bench.read("a/truth.csv");
    let rows: Vec<Vec<f64>> = truth
        .lines()
        .skip(1)
        .map(|row| row.split(',').map(|value| value.parse().expect("a number")).collect())
        .collect();
    assert_eq!(rows.len(), 151);
    let rate = 20f64.to_radians();
    assert!(rows.iter().all(|row| (row[11] - rate).abs() < 1e-12 && (row[2] - 2.2).abs() < 1e-12));
    // The rotation about z after 1.5 s: half of 30 degrees in the quaternion.
    assert!((rows[150][7] - 15f64.to_radians().sin()).abs() < 1e-12, "{:?}", rows[150]);
    assert_eq!(bench.run(&["simulate", "short.toml", "-o", "a"]).code, 2, "a folder that is not empty");
}

/// What a listener makes of the stage's chunks in a recording; and the chunks as a log.
fn overheard(bench: &Workbench, recording: &str) -> (Vec<Sample>, String) {
    let mut listener = Listener::new(LineSettings::default());
    let (mut heard, mut log) = (Vec::new(), String::new());
    let reader = Reader::open(&[bench.path(recording)]).expect("a recording");
    let chunks = reader.filter_map(|event| {
        let event = event.expect("an event");
        let Body::SerialChunk { sensor, bytes } = event.body else { return None };
        assert_eq!(sensor.as_str(), "turntable");
        Some((event.arrived, bytes))
    });
    for (at, bytes) in chunks {
        listener.overheard(at, &bytes, &mut heard);
        log += &format!("{} {}\n", at.0, bytes.escape_ascii());
    }
    assert_eq!(listener.counts().lines.refused(), 0);
    let samples =
        heard.into_iter().filter_map(|heard| if let Heard::Sample(sample) = heard { Some(sample) } else { None });
    (samples.collect(), log)
}

#[test]
fn the_stages_conversation_is_in_the_recording_as_in_the_log_and_tells_the_targets_angle() {
    let bench = Workbench::new();
    short_scene(&bench);
    let done = bench.run(&["simulate", "short.toml", "-o", "out", "--duration", "2500ms"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let (samples, chunks) = overheard(&bench, "out/capture.mcap");
    let logged = bench.read("out/serial.log");
    let logged = logged.lines().map(|line| LogEntry::parse(line).expect("an entry"));
    let logged: String = logged.map(|entry| format!("{} {}\n", entry.at.0, entry.bytes.escape_ascii())).collect();
    assert_eq!(logged, chunks);
    assert!(samples.len() > 110, "{}", samples.len());
    for sample in &samples {
        // 20 degrees a second of 768 000 counts a turn; what a reading's time may be off by, and a count.
        let counts = 20.0 / 360.0 * 768_000.0 * sample.at.0 as f64 * 1e-9;
        let doubt = 20.0 / 360.0 * 768_000.0 * sample.half_rtt.as_secs_f64() + 1.0;
        assert!((sample.counts as f64 - counts).abs() <= doubt && sample.trusted(), "{sample:?}: {counts}");
    }
    assert!(bench.read("out/rig.toml").contains("[turntable]"));
    let info = bench.run(&["info", "out/capture.mcap"]);
    assert!(info.code == 0 && info.stdout.contains("/serial/turntable/bytes"), "{}", info.stdout);
}

#[test]
fn the_target_goes_where_a_stage_with_faults_truly_goes() {
    let bench = Workbench::new();
    let scene = std::fs::read_to_string(repository().join("config/scenes/turntable-20dps.toml")).expect("a scene");
    let stage = "[stage]\nmishap_probability = 0.05\n[[stage.stall]]\nfrom_s = 0.5\nuntil_s = 1.0\n\
                 [[stage.slip]]\nat_s = 1.5\nangle_deg = 3.0\n";
    bench.file("faulty.toml", format!("{scene}\n{stage}").replace("duration_s = 60.0", "duration_s = 2.0"));
    let done = bench.run(&["simulate", "faulty.toml", "-o", "out"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let angle_deg = |row: usize| {
        let truth = bench.read("out/truth.csv");
        let row: Vec<f64> =
            truth.lines().nth(1 + row).expect("a row").split(',').map(|v| v.parse().expect("a number")).collect();
        (2.0 * row[7].atan2(row[8]).to_degrees(), row[11].to_degrees())
    };
    // Rows are 10 ms apart. 20 degrees a second until 0.5 s; held; 10 degrees behind from 1 s on; 13 from 1.5 s on.
    for (row, angle, rate) in [(40, 8.0, 20.0), (75, 10.0, 0.0), (120, 14.0, 20.0), (180, 23.0, 20.0)] {
        let found = angle_deg(row);
        assert!((found.0 - angle).abs() < 1e-9 && (found.1 - rate).abs() < 1e-9, "row {row}: {found:?}");
    }
    // A scene without a turntable has no stage to go wrong.
    let tumble = std::fs::read_to_string(repository().join("config/scenes/tumble.toml")).expect("a scene");
    bench.file("wrong.toml", format!("{tumble}\n{stage}"));
    let done = bench.run(&["replay", "sim:wrong.toml"]);
    assert!(done.code == 2 && done.stderr.contains("[stage]"), "{}", done.stderr);
}

#[test]
fn an_hdl64e_is_decoded_by_the_calibration_beside_its_capture() {
    let bench = Workbench::new();
    let scene = std::fs::read_to_string(repository().join("config/scenes/turntable-20dps.toml")).expect("a scene");
    let exact = "parameters = { range_sigma_m = 0.0, beam_bias_sigma_m = 0.0, footprint_mrad = 0.0 }\nclock = { offset_ns = 1_234";
    let scene = scene.replace("vlp-32c", "hdl-64e").replace("clock = { offset_ns = 1_234", exact);
    // A sphere where the target stands: all its points are at one distance from its centre.
    bench.file("hdl.toml", scene.replace("box_bus", "sphere").replace("duration_s = 60.0", "duration_s = 0.5"));
    let done = bench.run(&["simulate", "hdl.toml", "-o", "out"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    Calibration::parse(&bench.read("out/db.xml")).expect("a calibration");
    assert!(bench.read("out/rig-true.toml").contains("calibration = \"db.xml\""));
    let from_pcap = bench.points("out/velodyne.pcap", "out/rig-true.toml");
    assert!(from_pcap == bench.points("out/capture.mcap", "out/rig-true.toml"));
    let coordinate = |record: &[u8], at: usize| f32::from_le_bytes(record[at..at + 4].try_into().expect("four bytes"));
    let radii: Vec<f64> = from_pcap
        .chunks_exact(24)
        .map(|record| [coordinate(record, 0) - 2.2, coordinate(record, 4), coordinate(record, 8)])
        .map(|[x, y, z]| f64::from(x * x + y * y + z * z).sqrt())
        .collect();
    let mean = radii.iter().sum::<f64>() / radii.len() as f64;
    // Half a count of 2 mm and the mesh's facets; another unit's calibration would be centimetres off.
    let off = radii.iter().map(|radius| (radius - mean).abs()).fold(0.0, f64::max);
    assert!(radii.len() > 3_000 && off < 0.003, "{} points, {mean} m, {off} m off", radii.len());
    // The scene itself, as an input, has its calibration with it; and so has its recording.
    let (scene, recording) = (replayed(&bench, &["sim:hdl.toml"]), replayed(&bench, &["out/capture.mcap"]));
    assert_eq!(scene.digest, recording.digest);
    assert!(scene.sensors[1].points.decoded as usize == radii.len());
}

#[test]
fn an_operators_rig_states_its_doubts_and_the_true_one_has_none() {
    let bench = Workbench::new();
    short_scene(&bench);
    let scale = |folder: &str, seed: &str| -> f64 {
        let done = bench.run(&["simulate", "short.toml", "-o", folder, "--duration", "100ms", "--seed", seed]);
        assert_eq!(done.code, 0, "{}", done.stderr);
        assert!(!bench.read(&format!("{folder}/rig-true.toml")).contains("sigma"));
        let rig = bench.read(&format!("{folder}/rig.toml"));
        let sigma = "{ rotation_deg = 0.2, translation_m = 0.004, time_offset_ms = 2.0, depth_scale = 0.003 }";
        assert!(rig.contains(sigma), "{rig}");
        let line = rig.lines().find_map(|line| line.strip_prefix("depth_scale = "));
        line.expect("a scale").parse().expect("a number")
    };
    let scales: Vec<f64> = (1..=6).map(|seed| scale(&seed.to_string(), &seed.to_string())).collect();
    // Six of 0.3 %: their r.m.s. lies within a factor of two of it, all but once in a thousand.
    let rms = (scales.iter().map(|scale| (scale - 1.0) * (scale - 1.0)).sum::<f64>() / 6.0).sqrt();
    assert!((0.001..0.006).contains(&rms), "{scales:?}");
    let check = bench.run(&["config", "check", "1/rig.toml"]);
    assert_eq!(check.code, 0, "{}", check.stderr);
}

#[test]
fn a_scene_is_the_same_on_any_number_of_threads() {
    let bench = Workbench::new();
    short_scene(&bench);
    let on = |threads: &str| replayed(&bench, &["sim:short.toml", "--threads", threads]).checkpoint;
    assert_eq!(on("1"), on("3"));
}

#[test]
fn a_target_may_be_a_surface_from_a_file_beside_the_scene() {
    let bench = Workbench::new();
    let scene =
        accuracy_scene().replace("shape = \"box_bus\"", "mesh = \"parts/tetra.stl\"\nscale = 0.001\ncenter = true");
    bench.file("scenes/own.toml", scene);
    let corners = ["0 0 0", "800 0 0", "0 800 0", "0 0 800"];
    let facet = |face: [usize; 3]| {
        let vertices = face.map(|corner| format!("vertex {}\n", corners[corner])).concat();
        format!("facet normal 0 0 0\nouter loop\n{vertices}endloop\nendfacet\n")
    };
    let faces = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3], [1, 1, 2]].map(facet).concat();
    bench.file("scenes/parts/tetra.stl", format!("solid tetra\n{faces}endsolid tetra\n"));
    let done = bench.run(&["simulate", "scenes/own.toml", "-o", "out", "--duration", "300ms"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    // The surface in the frame of truth.csv: metres, its middle at the origin; the triangle without area is left out.
    let mesh = bench.read("out/mesh.ply");
    assert!(mesh.contains("element vertex 4\n") && mesh.contains("element face 4\n"), "{mesh}");
    assert!(mesh.contains("\n-0.4 -0.4 -0.4\n") && mesh.contains("\n0.4 -0.4 -0.4\n"), "{mesh}");
    let report = replayed(&bench, &["out/capture.mcap"]);
    for sensor in report.sensors.iter().take(2) {
        assert!(sensor.points.decoded > 1_000, "{}: {:?}", sensor.id, sensor.points);
    }
    // A scene of a surface that is not there says which.
    bench.file("scenes/own.toml", bench.read("scenes/own.toml").replace("tetra.stl", "no.stl"));
    let done = bench.run(&["simulate", "scenes/own.toml", "-o", "out2"]);
    assert!(done.code == 2 && done.stderr.contains("no.stl"), "{}", done.stderr);
    // Without the scale it would be 800 m long: told with the remedy.
    bench.file("scenes/own.toml", accuracy_scene().replace("shape = \"box_bus\"", "mesh = \"parts/tetra.stl\""));
    let done = bench.run(&["simulate", "scenes/own.toml", "-o", "out3"]);
    assert!(done.code == 2 && done.stderr.contains("scale = 0.001"), "{}", done.stderr);
}

#[test]
fn a_scenes_own_faults_are_in_every_form_of_it() {
    let bench = Workbench::new();
    let fault = "\n[[fault]]\nsensor = \"near\"\nfrom_s = 2.0\nuntil_s = 4.0\naction = \"unplug\"\n";
    bench.file("faulty.toml", accuracy_scene().replace("duration_s = 60.0", "duration_s = 6.0") + fault);
    let direct = replayed(&bench, &["sim:faulty.toml"]);
    // 180 frames in six seconds, 60 of them in the two without the Kinect.
    let near = direct.sensors.first().expect("a Kinect");
    assert!((118..=122).contains(&near.received), "{}", near.received);
    let done = bench.run(&["simulate", "faulty.toml", "-o", "out"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let written = replayed(&bench, &["out/capture.mcap"]);
    assert_eq!(written.digest, direct.digest);
    // What was done is told: 60 frames silenced, of 180.
    let truth: serde_json::Value = serde_json::from_str(&bench.read("out/scene-faults.json")).expect("JSON");
    let near = &truth["sensors"]["near"];
    assert!(near["items"] == 180 && near["silenced"] == 60, "{truth}");
    // A fault of a sensor that is not there would do nothing: refused.
    bench.file("faulty.toml", accuracy_scene() + &fault.replace("near", "nobody"));
    let done = bench.run(&["replay", "sim:faulty.toml"]);
    assert!(done.code == 2 && done.stderr.contains("nobody"), "{}", done.stderr);
}

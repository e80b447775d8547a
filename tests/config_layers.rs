//! The layers: defaults, file, calibration, `--set`.

use serde_json::{Value, json};
use tumbled::config::Layer;
use tumbled::config::show::ShowReport;
use tumbled::config::{COMMENTED_DEFAULT, Config, load};
use tumbled_model::{Iso, Kinect, Lidar, Rig, Span};

use crate::support::Workbench;

/// Two of each sensor, told apart by sender and serial.
const TWO_OF_EACH: &str = r#"
[[lidar]]
id = "front"
source = "192.168.1.201"
vertical_offsets = "on"
[[lidar]]
id = "back"
source = "192.168.1.202"
[[kinect]]
id = "near"
serial = "A1"
[[kinect]]
id = "far"
serial = "A2"
"#;

/// The effective value and layer of a key, as `config show --json` has them.
fn shown(bench: &Workbench, arguments: &[&str], key: &str) -> (Value, Layer) {
    let done = bench.run(&[&["config", "show", "--json"], arguments].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    let report: ShowReport = done.json();
    let found = report.keys.into_iter().find(|k| k.key == key).unwrap_or_else(|| panic!("no {key}"));
    (found.value, found.layer)
}

fn set_error(arguments: &[&str]) -> String {
    let bench = Workbench::new();
    bench.file("rig.toml", TWO_OF_EACH);
    let mut all = vec!["config", "check", "rig.toml"];
    arguments.iter().for_each(|argument| all.extend(["--set", argument]));
    bench.run(&all).transcript()
}

fn defaults() -> Config {
    load(None, &[]).expect("the built-in config is fine").config
}

#[test]
fn without_a_file_there_is_one_sensor_of_each_kind_in_the_rigs_frame() {
    let config = defaults();
    let [lidar] = config.lidars.as_slice() else { panic!("one LiDAR") };
    let [kinect] = config.kinects.as_slice() else { panic!("one Kinect") };
    assert_eq!((lidar.id.as_str(), lidar.port, lidar.position_port), ("front", 2368, 8308));
    assert_eq!((kinect.id.as_str(), kinect.serial.as_deref()), ("near", None));
    assert_eq!(lidar.t_rig_lidar, Iso::<Rig, Lidar>::identity());
    assert_eq!(kinect.t_rig_kinect, Iso::<Rig, Kinect>::identity());
    assert_eq!(config.turntable, None);
}

#[test]
fn the_commented_default_says_what_is_built_in_apart_from_the_kinects_place() {
    let bench = Workbench::new();
    let file = bench.file("rig.toml", COMMENTED_DEFAULT);
    let mut config = load(Some(&file), &[]).expect("fine").config;
    let drawn = Iso::from_parts([0.0, 0.3, 0.0], [-0.5, 0.5, -0.5, 0.5]).expect("unit");
    assert_eq!(config.kinects[0].t_rig_kinect, drawn);
    config.kinects[0].t_rig_kinect = Iso::identity();
    assert_eq!(config, defaults());
}

#[test]
fn the_commented_default_shows_every_key() {
    let bench = Workbench::new();
    // Examples are comments that begin with a key or a section: `# source = …`, `# [turntable]`.
    let is_key = |line: &str| {
        line.split_once(" = ")
            .is_some_and(|(k, _)| k.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_'))
    };
    let is_section = |line: &str| line.starts_with('[') && !line.starts_with("[fusion]");
    let uncommented: Vec<&str> = COMMENTED_DEFAULT
        .lines()
        .map(|line| line.strip_prefix("# ").filter(|rest| is_key(rest) || is_section(rest)).unwrap_or(line))
        .collect();
    let file = bench.file("rig.toml", uncommented.join("\n"));
    bench.file("calibration.toml", "");
    bench.file("depth.csv", "raw11,depth_mm\n");
    let report: ShowReport = bench.run(&["config", "show", "--json", "--config", file.to_str().expect("UTF-8")]).json();
    let missing: Vec<_> = report.keys.iter().filter(|key| key.layer == Layer::Default).map(|key| &key.key).collect();
    assert!(missing.is_empty(), "not in config/rig.toml: {missing:?}");
    // 2 of the rig, 16 of the LiDAR (its transform is two, its sigma three), 22 of the Kinect (9 intrinsics, transform two,
    // sigma four, warp two), 4 of the turntable, 6 of the target, 2 of the point; 3 of the time, 4 of the filter, 11 of the stream, 6 of the record, 6 limits.
    assert_eq!(report.keys.len(), 2 + 16 + 22 + 4 + 6 + 2 + 3 + 4 + 11 + 6 + 6);
}

#[test]
fn show_names_the_layer_of_every_key() {
    let bench = Workbench::new();
    bench.file("rig.toml", "[rig]\nname = \"lab\"\ncalibration = \"cal/now.toml\"\n\n[[lidar]]\nport = 2370\n");
    bench.file(
        "cal/now.toml",
        "[provenance]\nby = \"calibrate\"\n[lidar.front]\ntime_offset_ms = 1.5\n\n[kinect.near]\n\
         intrinsics = { fx = 580, fy = 581, cx = 319, cy = 241 }\n",
    );
    let arguments = ["config", "show", "--config", "rig.toml", "--origin", "--set", "kinect.intrinsics.k1=0.1"];
    insta::assert_snapshot!("show_origin", bench.run(&arguments).transcript());
    insta::assert_snapshot!("show_json", bench.run(&[&arguments[..], &["--json"]].concat()).transcript());
}

#[test]
fn what_show_prints_loads_as_the_same_config() {
    let bench = Workbench::new();
    let file = bench.file("rig.toml", format!("{TWO_OF_EACH}[turntable]\nport = '/dev/\"x\"'\n"));
    bench.file("empty.toml", "kinect = []\n");
    for name in ["rig.toml", "empty.toml"] {
        let printed = bench.run(&["config", "show", "--origin", "--config", name]).stdout;
        let again = bench.file(&format!("again-{name}"), printed);
        let config = |path| load(Some(path), &[]).expect("fine").config;
        assert_eq!(config(&again), config(&bench.path(name)));
    }
    assert_eq!(load(Some(&file), &[]).expect("fine").config.turntable.expect("set").port, "/dev/\"x\"");
}

#[test]
fn a_calibration_replaces_what_it_names_of_the_sensor_it_names() {
    let bench = Workbench::new();
    let rig = format!("[rig]\ncalibration = 'cal.toml'\n{TWO_OF_EACH}intrinsics = {{ fx = 500.0, k1 = 0.3 }}\n");
    let file = bench.file("rig.toml", rig);
    bench.file(
        "cal.toml",
        "[lidar.back]\nt_rig_lidar = { translation_m = [1, 2, 3], rotation_xyzw = [0, 0, 0, 1] }\n\
         [kinect.far]\ntime_offset_ms = -0.25\nintrinsics = { fx = 580, fy = 581, cx = 319, cy = 241 }\n",
    );
    let config = load(Some(&file), &[]).expect("fine").config;
    assert_eq!(config.lidars[0].t_rig_lidar, Iso::identity());
    assert_eq!(config.lidars[1].t_rig_lidar, Iso::from_parts([1.0, 2.0, 3.0], [0.0, 0.0, 0.0, 1.0]).expect("unit"));
    assert_eq!(config.kinects[1].time_offset, Span(-250_000));
    // Distortion of the config does not survive in a calibrated camera: the calibration found it to be none.
    let far = &config.kinects[1].intrinsics;
    assert_eq!((far.fx, far.fy, far.k1), (580.0, 581.0, 0.0));
    assert_eq!(config.kinects[0].intrinsics.fx, 575.8);
    // --set comes last, and leaves the rest of the calibration alone.
    let settings = ["kinect.far.intrinsics.cx=1".to_owned()];
    let far = load(Some(&file), &settings).expect("fine").config.kinects[1].intrinsics.clone();
    assert_eq!((far.cx, far.fx), (1.0, 580.0));
}

#[test]
fn a_calibration_for_another_rig_is_refused() {
    let bench = Workbench::new();
    bench.file("rig.toml", format!("[rig]\ncalibration = 'cal.toml'\n{TWO_OF_EACH}"));
    bench.file(
        "cal.toml",
        "[lidar.left]\ntime_offset_ms = 1.0\n[kinect.near]\nintrinsics = { fx = 580, fy = 580 }\n\
         [lidar.front]\nt_rig_lidar = { translation_m = [0, 0, 0], rotation_xyzw = [0, 0, 1, 1] }\n",
    );
    insta::assert_snapshot!("calibration_refused", bench.run(&["config", "check", "rig.toml"]).transcript());
}

#[test]
fn a_calibration_of_another_camera_is_refused_and_an_open_serial_is_taken_over() {
    let bench = Workbench::new();
    let rig = |serial: &str| format!("[rig]\ncalibration = 'cal.toml'\n[[kinect]]\nid = 'near'\nserial = '{serial}'\n");
    bench.file("cal.toml", "[kinect.near]\nserial = 'A1'\ndepth_scale = 1.01\n");
    for (serial, fine) in [("A1", true), ("", true), ("B2", false)] {
        let file = bench.file("rig.toml", rig(serial));
        match load(Some(&file), &[]) {
            Ok(loaded) => {
                let kinect = &loaded.config.kinects[0];
                assert!(fine && kinect.depth_scale == 1.01 && kinect.serial.as_deref() == Some("A1"), "{serial}");
            }
            Err(error) => {
                assert!(!fine, "{serial}: {error}");
                let said = bench.run(&["config", "check", "rig.toml"]).transcript();
                assert!(said.contains("\"A1\"") && said.contains("\"B2\"") && said.contains("cal.toml"), "{said}");
            }
        }
    }
}

#[test]
fn set_without_an_id_sets_every_sensor_and_with_one_only_that() {
    let bench = Workbench::new();
    bench.file("rig.toml", TWO_OF_EACH);
    let with = |setting: &'static str| vec!["--config", "rig.toml", "--set", setting];
    let every = with("lidar.vertical_offsets=off");
    assert_eq!(shown(&bench, &every, "lidar.front.vertical_offsets"), (json!("off"), Layer::Set));
    assert_eq!(shown(&bench, &every, "lidar.back.vertical_offsets"), (json!("off"), Layer::Set));
    let one = with("lidar.back.vertical_offsets=off");
    assert_eq!(shown(&bench, &one, "lidar.front.vertical_offsets"), (json!("on"), Layer::File));
    assert_eq!(shown(&bench, &one, "lidar.back.vertical_offsets"), (json!("off"), Layer::Set));
    // The file says nothing of a turntable, and without a file there is the default LiDAR.
    assert_eq!(
        shown(&bench, &["--set", "turntable.port=/dev/x"], "turntable.protocol"),
        (json!("zaber"), Layer::Default)
    );
    assert_eq!(shown(&bench, &["--set", "lidar.model=vlp-16"], "lidar.front.model"), (json!("vlp-16"), Layer::Set));
}

#[test]
fn set_resets_no_key_it_does_not_name() {
    let bench = Workbench::new();
    bench.file("rig.toml", "[[kinect]]\nintrinsics = { fx = 500.0, k1 = 0.2 }\ntime_offset_ms = 3\n");
    let file = ["--config", "rig.toml"];
    let deep = [&file[..], &["--set", "kinect.intrinsics.fx=580"]].concat();
    assert_eq!(shown(&bench, &deep, "kinect.near.intrinsics.fx"), (json!(580), Layer::Set));
    assert_eq!(shown(&bench, &deep, "kinect.near.intrinsics.k1"), (json!(0.2), Layer::File));
    let table = [&file[..], &["--set", "kinect.near={intrinsics={cx=1.5}}"]].concat();
    assert_eq!(shown(&bench, &table, "kinect.near.intrinsics.cx"), (json!(1.5), Layer::Set));
    assert_eq!(shown(&bench, &table, "kinect.near.intrinsics.fx"), (json!(500.0), Layer::File));
    assert_eq!(shown(&bench, &table, "kinect.near.time_offset_ms"), (json!(3), Layer::File));
}

#[test]
fn set_reads_toml_values_and_bare_words() {
    let bench = Workbench::new();
    let value = |setting: &str, key: &str| shown(&bench, &["--set", setting], key).0;
    assert_eq!(
        value("lidar.front.t_rig_lidar.translation_m=[0,0,1]", "lidar.front.t_rig_lidar.translation_m"),
        json!([0, 0, 1])
    );
    assert_eq!(value("rig.name=\"two words\"", "rig.name"), json!("two words"));
    assert_eq!(value("rig.name=two words", "rig.name"), json!("two words"));
    // A text needs no quotes even where it looks like a number, a date or a truth.
    assert_eq!(value("kinect.serial=00123", "kinect.near.serial"), json!("00123"));
    assert_eq!(value("kinect.serial=123", "kinect.near.serial"), json!("123"));
    assert_eq!(value("rig.name=2026-01-01", "rig.name"), json!("2026-01-01"));
    assert_eq!(value("lidar.port=0x10", "lidar.front.port"), json!(16));
    assert_eq!(value("lidar.time_offset_ms = -1e3", "lidar.front.time_offset_ms"), json!(-1000.0));
    // The last one wins.
    let twice = ["--set", "lidar.port=1", "--set", "lidar.front.port=2"];
    assert_eq!(shown(&bench, &twice, "lidar.front.port").0, json!(2));
}

#[test]
fn set_can_name_the_calibration_and_the_id_it_is_for() {
    let bench = Workbench::new();
    bench.file("cal.toml", "[lidar.left]\ntime_offset_ms = 7.0\n");
    // A relative path on the command line starts at the working directory, as the shell completes it.
    let arguments = ["--set", "lidar.id=left", "--set", "rig.calibration=cal.toml"];
    assert_eq!(shown(&bench, &arguments, "lidar.left.time_offset_ms"), (json!(7.0), Layer::Calibration));
}

#[test]
fn relative_paths_of_a_file_start_at_it() {
    let bench = Workbench::new();
    let file = bench.file("rigs/a.toml", "[[kinect]]\ndepth_table = 'tables/t.csv'\n");
    let table = bench.file("rigs/tables/t.csv", "raw11");
    let config = load(Some(&file), &[]).expect("fine").config;
    let read = config.kinects[0].depth_table.as_ref().expect("read");
    assert_eq!((read.place.as_str(), &read.content[..]), (table.to_str().expect("UTF-8"), &b"raw11"[..]));
    assert_eq!((read.key.as_str(), read.name.as_str()), ("kinect.near.depth_table", "t.csv"));
    let config = load(Some(&file), &["kinect.depth_table=".to_owned()]).expect("fine").config;
    assert_eq!(config.kinects[0].depth_table, None, "an empty text is not set");
}

#[test]
fn set_refuses_what_it_does_not_know_and_names_the_nearest() {
    insta::assert_snapshot!("set_unknown_key", set_error(&["lidar.prot=2369"]));
    insta::assert_snapshot!("set_unknown_id", set_error(&["lidar.frnt.port=2369"]));
    insta::assert_snapshot!("set_unknown_section", set_error(&["lidra.port=2369"]));
    insta::assert_snapshot!("set_deeper_than_a_value", set_error(&["lidar.port.x=1"]));
    insta::assert_snapshot!(
        "set_wrong_value",
        set_error(&["lidar.front.port=two", "kinect.t_rig_kinect={rotation_xyzw=[0,0"])
    );
    insta::assert_snapshot!("set_nothing", set_error(&["lidar.port", "lidar..port=1"]));
}

#[test]
fn there_is_nothing_to_set_where_there_is_no_sensor() {
    let bench = Workbench::new();
    bench.file("rig.toml", "kinect = []\n");
    let done = bench.run(&["config", "check", "rig.toml", "--set", "kinect.serial=A1"]);
    assert!(done.code == 2 && done.stderr.contains("there is no [[kinect]] to set `serial` in"), "{}", done.stderr);
    assert!(bench.run(&["config", "check", "rig.toml"]).stdout.contains("no Kinect"));
}

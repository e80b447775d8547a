//! `config check`, `config schema` and `config init` as a user meets them.

use tumbled::cli::config::check::CheckReport;
use tumbled::config::{COMMENTED_DEFAULT, Gravity};

use crate::support::Workbench;

/// The example every document shows.
const EXAMPLE: &str = r#"[rig]
name = "lab-2"
calibration = "calibration.toml"      # optional result of `calibrate`: overrides the inline transforms, offsets and intrinsics
[[lidar]]
id = "front"
model = "auto"                        # auto | vlp-32c | vlp-16 | vlp-16-hi-res | hdl-32e | hdl-64e
port = 2368
position_port = 8308
source = "192.168.1.201"              # optional filter
vertical_offsets = "auto"             # auto | on | off
calibration = "hdl64e.csv"            # HDL-64E: db.xml, velodyne_decoder/ROS YAML, or CSV
t_rig_lidar = { translation_m = [0.0, 0.0, 0.0], rotation_xyzw = [0.0, 0.0, 0.0, 1.0] }
time_offset_ms = 0.0
[[kinect]]
id = "near"
serial = ""                           # empty: the only one
intrinsics = { fx = 575.8, fy = 575.8, cx = 320.0, cy = 240.0, k1 = 0.0, k2 = 0.0, p1 = 0.0, p2 = 0.0, k3 = 0.0 }
t_rig_kinect = { translation_m = [0.0, 0.3, 0.0], rotation_xyzw = [-0.5, 0.5, -0.5, 0.5] }
time_offset_ms = 0.0
[turntable]
port = "/dev/rig/turntable"
protocol = "zaber"                    # zaber | line
[target]
roi_center_m = [2.0, 0.0, 0.0]        # rig frame
roi_radius_m = 1.2
"#;

fn check(text: &str) -> String {
    let bench = Workbench::new();
    bench.file("rig.toml", text);
    bench.run(&["config", "check", "rig.toml"]).transcript()
}

fn check_report(text: &str) -> (i32, CheckReport) {
    let bench = Workbench::new();
    bench.file("rig.toml", text);
    let done = bench.run(&["config", "check", "rig.toml", "--json"]);
    (done.code, done.json())
}

#[test]
fn the_example_is_fine_once_its_calibration_file_is_there() {
    let bench = Workbench::new();
    bench.file("rig.toml", EXAMPLE);
    insta::assert_snapshot!("example_without_calibration", bench.run(&["config", "check", "rig.toml"]).transcript());
    bench.file("calibration.toml", "");
    insta::assert_snapshot!("example_with_calibration", bench.run(&["config", "check", "rig.toml"]).transcript());
}

#[test]
fn an_unknown_key_comes_with_the_nearest_known_one() {
    insta::assert_snapshot!("unknown_key", check("[rig]\nname = \"a\"\n\n[[lidar]]\nvertical_offset = \"on\"\n"));
    insta::assert_snapshot!("unknown_section", check("[turntabel]\nport = \"/dev/ttyUSB0\"\n"));
    insta::assert_snapshot!("section_without_keys", check("[fusion]\nvoxel_m = 0.01\n[stream]\n"));
}

#[test]
fn a_wrong_type_says_what_was_found_and_expected() {
    insta::assert_snapshot!("wrong_types", check("lidar = [{ port = \"2368\" }]\n[target]\nroi_radius_m = nan\n"));
    insta::assert_snapshot!("wrong_word", check("[[lidar]]\nmodel = \"vlp16\"\n"));
}

#[test]
fn a_quaternion_off_unit_length_comes_with_itself_normalised() {
    let text = "[[kinect]]\nt_rig_kinect = { translation_m = [0, 0, 0], rotation_xyzw = [-0.5, 0.5, -0.5, 0.51] }\n";
    insta::assert_snapshot!("bad_quaternion", check(text));
}

#[test]
fn ids_are_unique_over_lidars_and_kinects() {
    insta::assert_snapshot!("duplicate_ids", check("[[lidar]]\nid = \"near\"\n[[kinect]]\nid = \"near\"\n"));
}

#[test]
fn every_problem_is_reported_at_once_in_reading_order() {
    let (code, report) = check_report(
        "[rig]\nnam = \"x\"\n\
         [[lidar]]\nid = \"Front\"\nport = 70000\nsource = \"192.168.1.300\"\n\
         range_min_m = 5\nrange_max_m = 1.0\n\
         [[kinect]]\nid = \"port\"\nintrinsics = { fx = 0.0 }\ntime_offset_ms = inf\n\
         t_rig_kinect = { rotation_xyzw = [0, 0, 0, 2] }\n\
         [turntable]\nprotocol = \"zaber\"\n\
         [[points_of_interest]]\nname = \"a\"\nposition_m = [0, 0]\n",
    );
    let found: Vec<_> = report.problems.iter().map(|p| (p.line.unwrap_or(0), p.key.as_deref().unwrap_or(""))).collect();
    let expected = [
        (2, "rig.nam"),                                 // unknown key
        (4, "lidar.Front.id"),                          // capital letter
        (5, "lidar.Front.port"),                        // beyond 65535
        (6, "lidar.Front.source"),                      // no IP address
        (7, "lidar.Front.range_min_m"),                 // beyond range_max_m
        (10, "kinect.port.id"),                         // a key's name
        (11, "kinect.port.intrinsics.fx"),              // not above 0
        (12, "kinect.port.time_offset_ms"),             // not finite
        (13, "kinect.port.t_rig_kinect.rotation_xyzw"), // length 2
        (14, "turntable"),                              // lacks port
        (18, "points_of_interest.a.position_m"),        // two numbers
    ];
    assert_eq!(found, expected, "{report:#?}");
    assert_eq!((code, report.ok, report.errors, report.warnings), (2, false, 11, 0));
    assert!(report.problems.iter().all(|problem| problem.help.is_some()), "{report:#?}");
}

#[test]
fn what_is_faulty_causes_no_second_problem() {
    // Without the id of the second LiDAR its default would be `front`, the first one's: not its author's mistake.
    let (_, report) = check_report(
        "[[lidar]]\nsource = \"10.0.0.1\"\n[[lidar]]\nid = 3\nsource = \"10.0.0.2\"\n[[kinect]]\nid = \"near\"\n",
    );
    let keys: Vec<_> = report.problems.iter().map(|problem| problem.line).collect();
    assert_eq!(keys, [Some(4)], "{report:#?}");
}

#[test]
fn every_syntax_error_is_reported_with_its_line() {
    let (code, report) = check_report("[rig]\nname = \n[target]\nroi_radius_m = 1,2\n");
    let lines: Vec<_> = report.problems.iter().map(|problem| problem.line).collect();
    assert_eq!((code, lines), (2, vec![Some(2), Some(4)]), "{report:#?}");
}

#[test]
fn files_that_cannot_be_read_are_named_with_the_remedy() {
    let bench = Workbench::new();
    insta::assert_snapshot!("no_file", bench.run(&["config", "check", "rig.toml"]).transcript());
    bench.file("latin1.toml", b"[rig]\nname = \"caf\xe9\"\n");
    let done = bench.run(&["config", "check", "latin1.toml"]);
    // `[rig]\n` is 6 bytes, `name = "caf` another 11: the first byte that is not UTF-8 is number 17.
    assert!(done.code == 2 && done.stderr.contains("latin1.toml: byte offset 17: not UTF-8"), "{}", done.stderr);
    bench.file("table.toml", "[[kinect]]\ndepth_table = \"mine.csv\"\n");
    let done = bench.run(&["config", "check", "table.toml"]);
    assert!(done.code == 2 && done.stderr.contains("mine.csv is not there"), "{}", done.stderr);
    bench.file("mine.csv", "raw11,depth_mm\n");
    assert_eq!(bench.run(&["config", "check", "table.toml"]).code, 0);
}

#[test]
fn two_listeners_on_one_port_need_two_senders() {
    let two = |first: &str, second: &str| {
        check_report(&format!("[[lidar]]\nid = 'a'\n{first}\n[[lidar]]\nid = 'b'\n{second}\n")).1.errors
    };
    // Both ports are the defaults: data and positions clash.
    assert_eq!(two("", ""), 2);
    assert_eq!(two("source = '10.0.0.1'", ""), 2);
    assert_eq!(two("source = '10.0.0.1'", "source = '10.0.0.2'"), 0);
    assert_eq!(two("source = '10.0.0.1'", "source = '10.0.0.1'"), 2);
    assert_eq!(two("", "port = 2369\nposition_port = 8309"), 0);
    assert_eq!(two("", "port = 8308\nposition_port = 2368"), 2);
    // Any free port clashes with none, not even with another 0.
    assert_eq!(two("port = 0\nposition_port = 0", "port = 0\nposition_port = 0"), 0);
    // Within one LiDAR the sender cannot tell them apart.
    assert_eq!(check_report("[[lidar]]\nport = 9000\nposition_port = 9000\nsource = '10.0.0.1'\n").1.errors, 1);
}

#[test]
fn several_kinects_need_their_serials() {
    let two = |first: &str, second: &str| {
        check_report(&format!("[[kinect]]\nid = 'a'\n{first}\n[[kinect]]\nid = 'b'\n{second}\n")).1.errors
    };
    assert_eq!(two("", ""), 2);
    assert_eq!(two("serial = 'A1'", ""), 1);
    assert_eq!(two("serial = 'A1'", "serial = 'A1'"), 1);
    assert_eq!(two("serial = 'A1'", "serial = 'A2'"), 0);
}

#[test]
fn an_hdl64e_needs_the_calibration_file_it_names_and_others_do_not() {
    let report = |model: &str| check_report(&format!("[[lidar]]\nmodel = '{model}'\ncalibration = 'no.csv'\n")).1;
    assert_eq!(report("hdl-64e").errors, 1);
    for model in ["auto", "vlp-16"] {
        let report = report(model);
        assert_eq!((report.errors, report.warnings), (0, 1), "{model}");
        assert_eq!(report.problems[0].gravity, Gravity::Warning);
    }
}

#[test]
fn warnings_are_shown_unless_only_errors_are_wanted() {
    let bench = Workbench::new();
    bench.file("rig.toml", "[[lidar]]\ncalibration = 'no.csv'\n");
    assert!(bench.run(&["config", "check", "rig.toml", "-q"]).stderr.contains("no.csv"));
    assert_eq!(bench.run(&["config", "check", "rig.toml", "-qq"]).stderr, "");
}

#[test]
fn schema_is_printed_as_committed() {
    let done = Workbench::new().run(&["config", "schema"]);
    assert_eq!((done.code, done.stdout), (0, tumbled::schema::config().text()));
}

#[test]
fn init_writes_the_commented_default_and_never_over_a_file() {
    let bench = Workbench::new();
    assert_eq!(bench.run(&["config", "init"]).code, 0);
    assert_eq!(bench.read("rig.toml"), COMMENTED_DEFAULT);
    assert_eq!(bench.run(&["config", "check", "rig.toml"]).code, 0);

    bench.file("lab.toml", "mine");
    let refused = bench.run(&["config", "init", "lab.toml"]);
    insta::assert_snapshot!("init_refused", refused.transcript());
    assert_eq!(bench.read("lab.toml"), "mine");

    assert_eq!(bench.run(&["config", "init", "lab.toml", "--force"]).code, 0);
    assert_eq!(bench.read("lab.toml"), COMMENTED_DEFAULT);
    assert_eq!(bench.run(&["config", "init", "no/such/folder/rig.toml"]).code, 1);
}

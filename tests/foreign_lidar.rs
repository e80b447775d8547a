//! Simulated packets through a decoder that is not ours: velodyne-decoder 3.1.0 of PyPI.
//!
//! Wants `TUMBLED_FOREIGN_PYTHON`, a Python that has the package:
//! `python3 -m venv venv && venv/bin/pip install velodyne-decoder==3.1.0`, then
//! `TUMBLED_FOREIGN_PYTHON=venv/bin/python cargo test --test main foreign_lidar -- --nocapture`.
//! Without it the tests print that they were skipped.

use std::path::{Path, PathBuf};
use std::process::Command;

use nalgebra::{Point3, Vector3};
use tumbled_io::foreign::PcapFile;
use tumbled_model::{LidarTime, Span};
use tumbled_sim::lidar::{Head, LidarConfig, LidarModel, LidarParameters, made_calibration};
use tumbled_sim::scene::{Scene, SceneConfig};
use tumbled_sim::world::{Ray, World};
use tumbled_velodyne::beams::BeamTable;
use tumbled_velodyne::hdl64::Generation;
use tumbled_velodyne::stream::{Decoded, Settings, StreamDecoder};

use crate::support::{Workbench, repository};

fn python() -> Option<PathBuf> {
    crate::support::foreign::python("velodyne_decoder, numpy, yaml", "velodyne-decoder")
}

/// A decoded point.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Point {
    /// The device's counter, ns past the hour.
    counter_ns: i64,
    /// Sensor's frame, m.
    xyz: [f32; 3],
    ring: u8,
    /// 1 strongest, 2 last, 3 both.
    returned: u8,
    intensity: u8,
}

impl Point {
    fn azimuth_deg(&self) -> f64 {
        let [x, y, _] = self.xyz.map(f64::from);
        (-y).atan2(x).to_degrees().rem_euclid(360.0)
    }

    fn range_m(&self) -> f64 {
        Vector3::from(self.xyz.map(f64::from)).norm()
    }
}

/// The box bus at 20 °/s on a turntable in a room, one head that looks all round, its ranges with σ 15 mm.
fn scene(model: &str, returns: &str, footprint_mrad: f64) -> String {
    format!(
        r#"
name = "foreign"
about = "a box bus at 20 degrees a second in a room"
seed = 3
duration_s = 1.2
unix_ns_at_zero = 1_795_341_600_000_000_000
roi_center_m = [2.2, 0.0, 0.0]
roi_radius_m = 1.0

[target]
shape = "box_bus"

[motion]
kind = "turntable"
axis = [0.0, 0.0, 1.0]
center_m = [2.2, 0.0, 0.0]
profile = {{ kind = "constant", rate_dps = 20.0 }}

[room]
floor_m = [0.5, 0.0, -1.2]
size_m = [7.0, 6.0, 5.0]

[[lidar]]
id = "front"
model = "{model}"
returns = "{returns}"
rpm = 600
t_rig_lidar = {{ translation_m = [0.1, -0.2, 0.05], rotation_xyzw = [0.010004283, -0.020008566, 0.150064242, 0.988423132] }}
clock = {{ offset_ns = {OFFSET_NS}, skew_ppm = 12.0 }}
parameters = {{ beam_bias_sigma_m = 0.0, footprint_mrad = {footprint_mrad:?} }}
"#
    )
}

/// The head's counter at the start: 12 min 34 s past the hour.
const OFFSET_NS: i64 = 754_000_000_000;

fn built(text: &str) -> Scene {
    let config: SceneConfig = toml::from_str(text).expect("keys of a scene");
    Scene::build(config).expect("a scene")
}

/// What the other decoder makes of a capture.
fn theirs(python: &Path, capture: &Path) -> Vec<Point> {
    let points = capture.with_extension("bin");
    let script = repository().join("tests/foreign/velodyne_decoder.py");
    let output = Command::new(python).arg(script).args([capture, &points]).output().expect("Python runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let bytes = std::fs::read(&points).expect("points");
    let point = |record: &[u8]| {
        let float = |at: usize| f32::from_le_bytes(record[at..at + 4].try_into().expect("four bytes"));
        let seconds = f64::from_le_bytes(record[..8].try_into().expect("eight bytes"));
        // Seconds since 1970 have steps of 0.24 µs.
        let past_the_hour = seconds.rem_euclid(3_600.0);
        let [ring, returned, intensity] = [record[20], record[21], record[22]];
        let xyz = [float(8), float(12), float(16)];
        Point { counter_ns: (past_the_hour * 1e9).round() as i64, xyz, ring, returned, intensity }
    };
    bytes.chunks_exact(24).map(point).collect()
}

/// What `export` makes of it.
fn exported(bench: &Workbench, capture: &str, config: &str) -> Vec<Point> {
    let output = ["--what", "lidar-points", "--format", "csv", "-o", "points.csv"];
    let done = bench.run(&[&["export", capture, "--config", config], &output[..]].concat());
    assert_eq!(done.code, 0, "{}", done.stderr);
    let text = bench.read("points.csv");
    let mut lines = text.lines();
    let names = "x,y,z,intensity,ring,return,laser,column,packet,stamp_us,dt_ns,range_m,azimuth_deg,flags";
    assert_eq!(lines.next(), Some(names));
    let point = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        let int = |at: usize| cells[at].parse::<i64>().expect("a whole number");
        let xyz = [0, 1, 2].map(|at: usize| cells[at].parse().expect("a number"));
        let counter_ns = int(9) * 1_000 + int(10);
        Point { counter_ns, xyz, ring: int(4) as u8, returned: int(5) as u8, intensity: int(3) as u8 }
    };
    lines.map(point).collect()
}

/// Point by point: the same ring, return and intensity, and how far apart the rest is at most.
fn assert_the_same(name: &str, ours: &[Point], theirs: &[Point]) {
    assert_eq!(ours.len(), theirs.len(), "{name}");
    let (mut azimuth, mut range, mut height, mut time) = (0.0_f64, 0.0_f64, 0.0_f64, 0);
    for (n, (our, their)) in ours.iter().zip(theirs).enumerate() {
        let same = (our.ring, our.returned, our.intensity) == (their.ring, their.returned, their.intensity);
        assert!(same, "{name}, point {n}: {our:?}, theirs {their:?}");
        let turned = (our.azimuth_deg() - their.azimuth_deg() + 180.0).rem_euclid(360.0) - 180.0;
        azimuth = azimuth.max(turned.abs());
        range = range.max((our.range_m() - their.range_m()).abs());
        height = height.max(f64::from((our.xyz[2] - their.xyz[2]).abs()));
        time = time.max((our.counter_ns - their.counter_ns).abs());
    }
    println!(
        "{name}: {} points; at most apart: azimuth {azimuth:.3}°, range {:.3} mm, height {:.4} mm, time {time} ns",
        ours.len(),
        1e3 * range,
        1e3 * height
    );
    // They round azimuths to 0.01° and take one mean speed a packet, in which the encoder's noise, three of its 0.007° at
    // most, is smoothed: 0.02° and 0.01° and a little. Their times have steps of 0.24 µs and end in 32-bit sums.
    assert!(azimuth < 0.05 && range < 5e-4 && height < 5e-4 && time < 1_000, "{name}");
}

/// Range less the distance to what the beam meets at the point's own time, at every azimuth.
///
/// `lever`: how far to the left of its direction and above the centre the beam of a ring leaves, m.
fn assert_residuals(name: &str, points: &[Point], model: &LidarModel, world: &World, lever: impl Fn(u8) -> (f64, f64)) {
    let config = model.config();
    let mut sectors = vec![Vec::new(); 12];
    let mut astray = 0;
    for point in points {
        let (left_m, height_m) = lever(point.ring);
        let [x, y, z] = point.xyz.map(f64::from);
        let level = (x * x + y * y - left_m * left_m).sqrt();
        let (sin, cos) = (y.atan2(x) - left_m.atan2(level)).sin_cos();
        let origin = Point3::new(-sin * left_m, cos * left_m, height_m);
        let along = Point3::new(x, y, z) - origin;
        let ray = Ray { origin: config.t_rig_lidar * origin, direction: config.t_rig_lidar * along.normalize() };
        let t = config.clock.instant(point.counter_ns - OFFSET_NS);
        let residual = world.cast_at(t, &ray, 0.1).map(|hit| along.norm() - hit.range_m);
        // At an edge the least turn decides which surface is met: no error of the range.
        match residual.filter(|residual| residual.abs() < 0.1) {
            Some(residual) => sectors[(point.azimuth_deg() / 30.0) as usize % 12].push(residual),
            None => astray += 1,
        }
    }
    assert!(astray * 200 < points.len(), "{name}: {astray} of {} points lie on no surface", points.len());
    let mut sigmas = Vec::new();
    for (sector, residuals) in sectors.iter().enumerate() {
        assert!(residuals.len() > 2_000, "{name}, sector {sector}: {} points", residuals.len());
        let mean = residuals.iter().sum::<f64>() / residuals.len() as f64;
        let square = residuals.iter().map(|residual| (residual - mean).powi(2)).sum::<f64>();
        let sigma = (square / residuals.len() as f64).sqrt();
        // Injected: 15 mm. The mean to five standard errors of 15 mm/√2000.
        assert!((sigma / 0.015 - 1.0).abs() < 0.1 && mean.abs() < 1.7e-3, "{name}, sector {sector}: {mean} ± {sigma}");
        sigmas.push(sigma);
    }
    let (least, most) = sigmas.iter().fold((f64::MAX, 0.0_f64), |(low, high), s| (low.min(*s), high.max(*s)));
    println!("{name}: σ along the beam {:.2} to {:.2} mm in 12 sectors, injected 15 mm", 1e3 * least, 1e3 * most);
}

#[test]
fn simulated_vlps_decode_as_in_velodyne_decoder_with_the_injected_sigma_at_every_azimuth() {
    let Some(python) = python() else { return };
    for model in ["vlp-32c", "vlp-16"] {
        let bench = Workbench::new();
        let text = scene(model, "strongest", 0.0);
        bench.file("scene.toml", &text);
        let done = bench.run(&["simulate", "scene.toml", "-o", "out"]);
        assert_eq!(done.code, 0, "{}", done.stderr);
        let points = theirs(&python, &bench.path("out/velodyne.pcap"));
        assert_the_same(model, &exported(&bench, "out/velodyne.pcap", "out/rig.toml"), &points);
        let scene = built(&text);
        let lidar = &scene.lidars[0].model;
        let spec = lidar.config().model().spec().expect("built in");
        let table = BeamTable::new(spec, lidar.config().model().vertical_offsets_default());
        let beam_of_ring = |ring| (0..).map_while(|slot| table.beam(slot)).find(|beam| beam.ring == ring);
        let heights: Vec<f64> = (0..32).map_while(beam_of_ring).map(|beam| beam.height_m).collect();
        assert_residuals(model, &points, lidar, &scene.world, |ring| (0.0, heights[usize::from(ring)]));
    }
}

#[test]
fn simulated_dual_returns_decode_as_in_velodyne_decoder() {
    let Some(python) = python() else { return };
    for model in ["vlp-32c", "vlp-16"] {
        let bench = Workbench::new();
        bench.file("scene.toml", scene(model, "dual", 3.0));
        let done = bench.run(&["simulate", "scene.toml", "-o", "out", "--duration", "600ms"]);
        assert_eq!(done.code, 0, "{}", done.stderr);
        let points = theirs(&python, &bench.path("out/velodyne.pcap"));
        let pairs = points.iter().filter(|point| point.returned == 2).count();
        assert!(pairs > 100, "{model}: {pairs} firings with two returns");
        assert_the_same(
            &format!("{model}, dual return"),
            &exported(&bench, "out/velodyne.pcap", "out/rig.toml"),
            &points,
        );
    }
}

#[test]
fn simulated_hdl64es_decode_as_in_velodyne_decoder_by_the_calibration_they_send() {
    let Some(python) = python() else { return };
    let scene = built(&scene("vlp-32c", "strongest", 0.0));
    let calibration = made_calibration().expect("plausible");
    for generation in [Generation::S2, Generation::S3] {
        let name = format!("HDL-64E {generation:?}");
        let of_scene = scene.lidars[0].model.config().clone();
        let head = Head::Hdl64e { generation, calibration: Box::new(calibration.clone()) };
        let parameters = LidarParameters { range_sigma_m: 0.015, ..of_scene.parameters };
        let model = LidarModel::new(LidarConfig { head, parameters, ..of_scene }).expect("a head");
        // Its calibration is sent once in 4160 packets, and is looked for before anything is decoded.
        let bench = Workbench::new();
        let capture = bench.path("velodyne.pcap");
        let mut pcap = PcapFile::create(&capture).expect("creates");
        let settings = Settings { hdl64e_calibration: Some(calibration.clone()), ..Settings::default() };
        let (mut decoder, mut decoded) = (StreamDecoder::new(settings), Decoded::default());
        for index in 0..4_400 {
            let packet = model.packet(&scene.world, index, 3);
            let arrived = packet.end + Span(100_000);
            let host = scene.unix_at_zero() + Span(arrived.0);
            pcap.write(host, 2_368, &packet.bytes).expect("writes");
            assert_eq!(decoder.push(&packet.bytes, arrived, &mut decoded), None);
        }
        pcap.finish().expect("ends");
        decoder.finish(&mut decoded);
        let mut ours = Vec::new();
        for info in &decoded.packets {
            let LidarTime(stamp_us) = info.stamp.expect("it has a clock");
            ours.extend(decoded.points.iter_range(info.points.clone()).map(|point| Point {
                counter_ns: i64::from(stamp_us) * 1_000 + i64::from(point.dt_ns),
                xyz: point.xyz,
                ring: point.ring,
                returned: point.ret as u8,
                intensity: point.intensity,
            }));
        }
        let points = theirs(&python, &capture);
        // The second packet tells an S3 from an S2: until then its firings are timed as an S2's.
        let first = decoded.packets.first().map_or(0, |info| info.points.len());
        assert_the_same(&name, &ours[first..], &points[first..]);
        let rings = calibration.rings();
        let lever = |ring: u8| {
            let laser = rings.iter().position(|of_laser| *of_laser == ring).expect("a ring");
            let laser = &calibration.lasers()[laser];
            (laser.horizontal_offset_m, laser.vertical_offset_m)
        };
        assert_residuals(&name, &points, &model, &scene.world, lever);
    }
}

//! The pictures and figures of `docs/simulation.md`, the LiDARs' part:
//! `cargo run --release -p tumbled-sim --example lidar_picture -- docs/simulation`.
//!
//! Everything drawn and measured has gone through packets and the decoder of real ones.

#[path = "../tests/support/mod.rs"]
mod support;

use core::f64::consts::TAU;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use std::error::Error;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use support::{config, cuboid, decode, hdl64e, quiet, sensor, still};
use tumbled_model::RigNs;
use tumbled_sim::lidar::{Head, LidarConfig, LidarModel, LidarParameters, View};
use tumbled_sim::motion::Still;
use tumbled_sim::motion::path::Walk;
use tumbled_sim::room::{self, Room};
use tumbled_sim::shape::Material;
use tumbled_sim::target::TargetKind;
use tumbled_sim::world::{Body, Ray, Role, World};
use tumbled_velodyne::beams::BeamTable;
use tumbled_velodyne::hdl64::{self, Generation};
use tumbled_velodyne::{LidarPoint, Model, Return, ReturnMode};

fn main() -> Result<(), Box<dyn Error>> {
    let folder =
        PathBuf::from(std::env::args().nth(1).ok_or("name the folder for the pictures, e.g. docs/simulation")?);
    let heads = || {
        [
            ("vlp32c", Head::BuiltIn(Model::Vlp32c)),
            ("vlp16", Head::BuiltIn(Model::Vlp16)),
            ("hdl64e", hdl64e(Generation::S2)),
        ]
    };
    for (name, head) in heads() {
        turn(&folder.join(format!("lidar-{name}.png")), head.clone())?;
        figures(name, head)?;
    }
    residual_histograms(&folder.join("lidar-residuals.png"), heads().map(|(_, head)| head))?;
    edges(&folder.join("lidar-edges.png"))?;
    materials();
    limited_view();
    Ok(())
}

/// The box bus 2.2 m ahead on a stage, a room, a person.
fn scene() -> World {
    let turned = UnitQuaternion::from_euler_angles(0.2, -0.25, 0.7);
    let place = Isometry3::from_parts(Vector3::new(2.2, 0.0, 0.05).into(), turned);
    let mesh = Arc::new(TargetKind::BoxBus.mesh());
    let target = Body { role: Role::Target, mesh, motion: Arc::new(Still(place)) };
    let room = Room { floor: Point3::new(1.0, 0.0, -1.2), size_m: Vector3::new(7.0, 6.0, 3.0) };
    let way = [Point3::new(2.6, -1.7, -1.2), Point3::new(2.6, 1.7, -1.2)];
    let person = room::person(Arc::new(Walk::new(&way, 0.0, RigNs(0))));
    World::new(vec![target, room.body(), room::stage(Point3::new(2.2, 0.0, -0.55), 0.25, -1.2), person])
}

/// Colours by pixel.
struct Picture {
    width: usize,
    pixels: Vec<[u8; 3]>,
}

impl Picture {
    fn new(width: usize, height: usize, colour: [u8; 3]) -> Self {
        Self { width, pixels: vec![colour; width * height] }
    }

    /// Fills a rectangle; what lies outside is cut off.
    fn fill(&mut self, [left, top]: [i64; 2], [wide, high]: [i64; 2], colour: [u8; 3]) {
        let columns = left.clamp(0, self.width as i64) as usize..(left + wide).clamp(0, self.width as i64) as usize;
        for row in
            self.pixels.chunks_mut(self.width).skip(top.max(0) as usize).take((high + top.min(0)).max(0) as usize)
        {
            row.get_mut(columns.clone()).into_iter().for_each(|pixels| pixels.fill(colour));
        }
    }

    fn write(&self, file: &Path) -> Result<(), Box<dyn Error>> {
        let height = self.pixels.len() / self.width;
        let mut encoder = png::Encoder::new(File::create(file)?, self.width as u32, height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_compression(png::Compression::High);
        encoder.write_header()?.write_image_data(&self.pixels.concat())?;
        Ok(())
    }
}

/// Near: yellow; far: dark blue.
fn by_range(metres: f64, [nearest, farthest]: [f64; 2]) -> [u8; 3] {
    let near = ((farthest - metres) / (farthest - nearest)).clamp(0.0, 1.0);
    [40.0 + 215.0 * near, 60.0 + 170.0 * near, 160.0 - 110.0 * near].map(|x| x as u8)
}

/// A head's settings as they come: every fault of a real one.
fn usual(head: Head, mode: ReturnMode) -> LidarConfig {
    LidarConfig { parameters: LidarParameters::default(), start_azimuth_deg: 180.0, ..config(head, mode, 600) }
}

/// How many packets a head sends in a second.
fn packets_per_s(model: &LidarModel) -> u64 {
    model.first_packet_at(RigNs(1_000_000_000))
}

/// One turn's half that looks ahead: 180°, a row a ring, 0.2° a column.
fn turn(file: &Path, head: Head) -> Result<(), Box<dyn Error>> {
    const HEIGHT: i64 = 256;
    let model = sensor(usual(head, ReturnMode::Strongest));
    let (_, out, _) = decode(&model, &scene(), packets_per_s(&model) / 10, 1);
    let rings = out.points.ring.iter().copied().max().map_or(1, |ring| i64::from(ring) + 1);
    let row = HEIGHT / rings;
    let mut picture = Picture::new(900, HEIGHT as usize, [0; 3]);
    for point in out.points.iter_range(0..out.points.len()) {
        // Where it lies, not where its beam looks: an HDL-64E's leave beside each other.
        let [x, y, _] = point.xyz.map(f64::from);
        let ahead_deg = libm::atan2(-y, x).to_degrees() + 90.0;
        let place = [(ahead_deg * 5.0) as i64, row * (rings - 1 - i64::from(point.ring))];
        // Two columns: firings are 0.17° to 0.2° apart.
        picture.fill(place, [2, row], by_range(f64::from(point.range_m), [1.4, 5.0]));
    }
    picture.write(file)
}

/// Range less the distance to what the point's beam met at the point's own time.
fn residuals(model: &LidarModel, world: &World, packets: u64) -> Vec<(LidarPoint, f64)> {
    let (_, out, times) = decode(model, world, packets, 5);
    let table = model
        .config()
        .model()
        .spec()
        .map(|spec| BeamTable::new(spec, model.config().model().vertical_offsets_default()));
    let calibrated = match &model.config().head {
        Head::Hdl64e { calibration, .. } => Some((hdl64::Beams::new(calibration), calibration)),
        Head::BuiltIn(_) => None,
    };
    let ray = |point: &LidarPoint| match (&calibrated, &table) {
        (Some((beams, calibration)), _) => {
            let turned = calibration.lasers().get(usize::from(point.laser))?.rotation_rad;
            let ray = beams.ray(point.laser, f64::from(point.azimuth_rad) + turned)?;
            Some(Ray { origin: Point3::from(ray.origin), direction: Vector3::from(ray.direction) })
        }
        (None, table) => {
            let height_m = table.as_ref()?.beam(usize::from(point.laser))?.height_m;
            let origin = Point3::new(0.0, 0.0, height_m);
            let along = Point3::from(point.xyz.map(f64::from)) - origin;
            Some(Ray { origin, direction: along.normalize() })
        }
    };
    let mut residuals = Vec::new();
    for info in &out.packets {
        let Some(t) = times.get(info.index as usize) else { continue };
        for point in out.points.iter_range(info.points.clone()) {
            let at = RigNs(t.0 + i64::from(point.dt_ns));
            if let Some(hit) = ray(&point).and_then(|ray| world.cast_at(at, &ray, 0.1)) {
                residuals.push((point, f64::from(point.range_m) - hit.range_m));
            }
        }
    }
    residuals
}

fn sigma(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let count = values.clone().count().max(1) as f64;
    let mean = values.clone().sum::<f64>() / count;
    (values.map(|value| (value - mean) * (value - mean)).sum::<f64>() / count).sqrt()
}

/// A row of the table: what can be read off a second of packets.
fn figures(name: &str, head: Head) -> Result<(), Box<dyn Error>> {
    let model = sensor(usual(head.clone(), ReturnMode::Strongest));
    let packets = packets_per_s(&model);
    let (_, out, _) = decode(&model, &support::room(), packets, 5);
    let stamps: Vec<u32> = out.packets.iter().filter_map(|info| info.stamp).map(|stamp| stamp.0).collect();
    let period_us =
        f64::from(stamps.last().ok_or("packets")? - stamps.first().ok_or("packets")?) / (stamps.len() - 1) as f64;
    // A laser's ranges differ by whole counts, whatever its corrections.
    let mut first = [None; 64];
    let lattice = out.points.iter_range(0..out.points.len()).map(|point| {
        let mm = (point.range_m * 1e3).round() as i32;
        first.get_mut(usize::from(point.laser)).map_or(0, |first| mm.abs_diff(*first.get_or_insert(mm)))
    });
    let unit_mm = lattice.fold(0, gcd);
    let parameters = LidarParameters { beam_bias_sigma_m: 0.0, footprint_mrad: 0.0, ..LidarParameters::default() };
    let white = sensor(LidarConfig { parameters, ..usual(head.clone(), ReturnMode::Strongest) });
    let white = residuals(&white, &support::room(), packets / 5);
    let sectors = (0..12).map(|sector| {
        let inside = |point: &LidarPoint| (f64::from(point.azimuth_rad) / TAU * 12.0) as usize == sector;
        1e3 * sigma(white.iter().filter(|(point, _)| inside(point)).map(|(_, residual)| *residual))
    });
    let (least, most) = sectors.fold((f64::MAX, 0.0_f64), |(low, high), s| (low.min(s), high.max(s)));
    // Azimuths of the packets' first blocks less the line through them.
    let azimuths = encoder(head);
    println!(
        "{name}: a packet every {period_us:.2} µs, {:.1} k slots/s, lattice {unit_mm} mm, σ {least:.2} to {most:.2} mm in 12 \
         sectors, azimuths of blocks ±{:.3}°, at most {:.3}°",
        384e3 / period_us,
        sigma(azimuths.iter().copied()),
        azimuths.iter().fold(0.0_f64, |most, off| most.max(off.abs()))
    );
    Ok(())
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// What the azimuths of the packets' first blocks are off by, degrees, read off the bytes.
fn encoder(head: Head) -> Vec<f64> {
    let model = sensor(usual(head.clone(), ReturnMode::Strongest));
    let still = sensor(LidarConfig { parameters: quiet(), ..usual(head, ReturnMode::Strongest) });
    let read = |model: &LidarModel, index| {
        let packet = model.packet(&World::default(), index, 5);
        let [low, high] = [2, 3].map(|at| packet.bytes.get(at).copied().unwrap_or_default());
        f64::from(u16::from_le_bytes([low, high])) * 0.01
    };
    (0..1_500).map(|index| (read(&model, index) - read(&still, index) + 180.0).rem_euclid(360.0) - 180.0).collect()
}

/// Side by side: residuals of each head, −60 to 60 mm, and the normal density of the σ that was put in.
fn residual_histograms(file: &Path, heads: [Head; 3]) -> Result<(), Box<dyn Error>> {
    const BINS: usize = 120;
    const HEIGHT: f64 = 200.0;
    let mut picture = Picture::new(900, HEIGHT as usize, [255; 3]);
    for (panel, head) in (0_i64..).zip(heads) {
        let parameters = LidarParameters { beam_bias_sigma_m: 0.0, footprint_mrad: 0.0, ..LidarParameters::default() };
        let model = sensor(LidarConfig { parameters, ..usual(head, ReturnMode::Strongest) });
        let found = residuals(&model, &support::room(), packets_per_s(&model) / 5);
        let mut bins = [0_u32; BINS];
        for (_, residual) in &found {
            let bin = (residual * 1e3 + 60.0).floor();
            if let Some(bin) = (bin >= 0.0).then(|| bins.get_mut(bin as usize)).flatten() {
                *bin += 1;
            }
        }
        // The density's top, 1/(15 mm · √2π) = 0.0266 a millimetre, at nine tenths of the height.
        let scale = 0.9 * HEIGHT * 15.0 * TAU.sqrt();
        for (bin, count) in (0_i64..).zip(bins) {
            let left = 300 * panel + 30 + 2 * bin;
            let high = scale * f64::from(count) / found.len() as f64;
            picture.fill([left, (HEIGHT - high) as i64], [2, high.ceil() as i64], [120, 150, 200]);
            let z = (bin as f64 - 59.5) / 15.0;
            let expected = scale * libm::exp(-0.5 * z * z) / (15.0 * TAU.sqrt());
            picture.fill([left, (HEIGHT - expected) as i64 - 1], [2, 2], [200, 30, 30]);
        }
        // Zero, and one σ to either side.
        for (mm, colour) in [(0, [60; 3]), (-15, [190; 3]), (15, [190; 3])] {
            picture.fill([300 * panel + 150 + 2 * mm, 0], [1, 12], colour);
        }
    }
    picture.write(file)
}

/// From above: a board 1 m wide at 2.5 m before another 0.5 m (left) and 1.5 m (right) farther, a VLP-32C with dual return.
fn edges(file: &Path) -> Result<(), Box<dyn Error>> {
    const PER_M: f64 = 200.0;
    let mut picture = Picture::new(900, 400, [0; 3]);
    for (panel, behind_m) in [(0.0, 0.5), (450.0, 1.5)] {
        let board = |x: f64, width| still(cuboid([0.01, width, 1.0], Material::Matt), Role::Target, [x, 0.0, 0.0]);
        let world = World::new(vec![board(2.5, 1.0), board(2.5 + behind_m, 4.0)]);
        let model = sensor(LidarConfig { rpm: 300, ..usual(Head::BuiltIn(Model::Vlp32c), ReturnMode::Dual) });
        let (_, out, _) = decode(&model, &world, packets_per_s(&model), 2);
        let mut counts = [0_usize; 3];
        for point in out.points.iter_range(0..out.points.len()) {
            let [x, y, _] = point.xyz.map(f64::from);
            // Two returns of one firing, one return between the boards (more than four σ from either), one return on one.
            let between = (2.57..2.5 + behind_m - 0.07).contains(&x) && y.abs() < 0.6;
            let (kind, colour) = match point.ret {
                Return::Last | Return::Strongest => (0, [80, 200, 255]),
                Return::Both if between => (1, [255, 90, 60]),
                Return::Both => (2, [200, 190, 120]),
            };
            if let Some(count) = counts.get_mut(kind) {
                *count += 1;
            }
            let across = panel + 225.0 - PER_M * y;
            if (panel..panel + 446.0).contains(&across) {
                picture.fill([across as i64, (390.0 - PER_M * (x - 2.35)) as i64], [2, 2], colour);
            }
        }
        let [two, mixed, one] = counts;
        println!(
            "edge {behind_m} m before the next: {one} points of one return, {mixed} between, {two} of two returns"
        );
    }
    picture.fill([447, 0], [6, 400], [255; 3]);
    picture.write(file)
}

/// Shares of firings that come back from a board at 3 m, by material and incidence.
fn materials() {
    let points = |material, deg: f64, always: bool| {
        let mut config = config(Head::BuiltIn(Model::Vlp32c), ReturnMode::Strongest, 600);
        if always {
            (config.parameters.surfaces.matt.sure_deg, config.parameters.surfaces.matt.blind_deg) = (89.9, 90.0);
        }
        let place = Isometry3::new(Vector3::new(3.0, 0.0, 0.0), Vector3::z() * deg.to_radians());
        let motion = Arc::new(Still(place));
        let board = Body { role: Role::Target, mesh: cuboid([0.001, 1.0, 1.0], material), motion };
        decode(&sensor(config), &World::new(vec![board]), 1_500, 4).1.points.len() as f64
    };
    for material in [Material::Matt, Material::Dark, Material::Foil] {
        // Against a surface at the same place that always answers.
        let shares =
            [0.0, 30.0, 45.0, 60.0].map(|deg| 100.0 * points(material, deg, false) / points(Material::Matt, deg, true));
        println!("{material:?} at 3 m: {shares:.0?} % of the firings come back at 0, 30, 45, 60°");
    }
}

/// The jump and the silence of a VLP-32C that looks at 180°, as in a recorded capture.
fn limited_view() {
    let view = View::Sector { from_deg: 270.12, to_deg: 450.95 };
    let model = sensor(LidarConfig { view, ..usual(Head::BuiltIn(Model::Vlp32c), ReturnMode::Strongest) });
    let stamps: Vec<u32> = (0..400)
        .map(|index| model.packet(&World::default(), index, 1).bytes)
        .filter_map(|bytes| Some(u32::from_le_bytes(bytes.get(1_200..1_204)?.try_into().ok()?)))
        .collect();
    let steps = stamps.iter().zip(stamps.iter().skip(1)).map(|(before, after)| after - before);
    let pauses: Vec<u32> = steps.filter(|us| *us > 2_000).collect();
    println!("view from 270.12° to 90.95°: from stamp to stamp across the blind half {pauses:?} µs");
}

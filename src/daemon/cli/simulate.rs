//! `tumbled simulate`: a simulated session as files, for this program and for others, with the truth beside them.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::Args as ClapArgs;
use indicatif::{ProgressBar, ProgressStyle};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_io::foreign::{FakenectFolder, PcapFile};
use tumbled_io::recording::{FileSystem, Recorder, RecordingHeader, Storage};
use tumbled_kinect::{PIXELS, RawImage, decode_raw};
use tumbled_model::{Body, Event, SensorId, Span, UnixNs};
use tumbled_serial::log::{LogEntry, Side};
use tumbled_serial::zaber::is_request;
use tumbled_sim::faults::{FaultInjector, FaultTruth};
use tumbled_sim::scene::Scene;
use tumbled_velodyne::wire::POSITION_LEN;

use super::{Failure, FaultArgs, Outcome, VERSION, import, output};
use crate::quantity;
use crate::simulation::truth::samples;
use crate::simulation::{SimulatedLedger, faults, rig, scenes};

/// What `simulate` is asked for.
#[derive(Debug, ClapArgs)]
#[command(
    after_help = "Examples:\n  tumbled simulate demo -o demo/ --duration 10s\n  tumbled simulate my-scene.toml -o out/ --seed 7\n  \
    tumbled simulate demo -o rehearsal/ --duration 30s --faults lost-target\n\n\
    Writes capture.mcap, velodyne.pcap, kinect/ (a fakenect folder), serial.log (with a turntable), truth.csv, mesh.ply, \
    rig.toml (what an operator would have), rig-true.toml, db.xml (an HDL-64E's calibration), faults.json (with --faults: \
    what was done) and scene-faults.json (the same of the scene's own faults). The same scene and seed give the same bytes."
)]
pub struct Args {
    /// A scene of the program's (demo, tumble, turntable-5dps, …; a name that is none lists them) or a file.
    #[arg(value_name = "SCENE")]
    scene: String,
    /// The folder to write; it is made if it is not there.
    #[arg(short = 'o', long = "output", value_name = "DIR")]
    output: PathBuf,
    /// Simulate so long, whatever the scene says, e.g. 10s.
    #[arg(long, value_parser = quantity::duration, value_name = "TIME")]
    duration: Option<Duration>,
    /// Another seed than the scene's.
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    #[command(flatten)]
    faults: FaultArgs,
    /// Write into a folder that is not empty: files of the same names are replaced.
    #[arg(long)]
    force: bool,
    /// Threads; 0 = one for each processor. Changes no byte.
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,
    /// Report on stdout as JSON.
    #[arg(long)]
    json: bool,
}

/// What was simulated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "tumbled simulate --json")]
pub struct SimulateReport {
    /// The scene.
    pub scene: String,
    /// Its seed.
    pub seed: u64,
    /// How long it lasted, s.
    pub duration_s: f64,
    /// Packets, frames and chunks by sensor.
    pub items: BTreeMap<String, u64>,
    /// What was injected; null: nothing was asked for.
    pub faults: Option<FaultTruth>,
    /// Frames in the recording alone: of a wrong length, a fakenect folder cannot hold them.
    pub frames_left_out: u64,
    /// What was written, in the folder.
    pub files: Vec<PathBuf>,
}

/// Simulates.
///
/// # Errors
/// Exit code 2: a scene that is none, a folder that is not empty. 1: what cannot be written.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let scene = scenes::load_with(&args.scene, args.seed, args.duration)?;
    let loaded = rig::operators(&scene, Path::new("rig.toml"), &[])?;
    let script = args.faults.faults.as_ref();
    let script = script.map(|path| faults::read_for(path, &faults::sensors(&loaded.config))).transpose()?;
    prepare(&args.output, args.force)?;
    let free = FileSystem.free_bytes(&args.output.join("capture.mcap"));
    fits(&scene, free.map_err(Failure::failed)?)?;
    let pool = scenes::pool(args.threads)?;
    // Of the recording: nothing of this machine, and nothing of this instant, is in it; the program without its commit.
    let program = VERSION.split(' ').next().unwrap_or_default();
    let mut header = rig::header(&scene, &loaded, program);
    if let Some(script) = &script {
        faults::mark(script, &mut header);
    }
    let mut files = Files::create(&args.output, &scene, header, args.force)?;
    files.describe(&scene).map_err(Failure::failed)?;
    let (asked_for, ledger) = (script.is_some(), SimulatedLedger::new(scene, Some(pool)));
    let mut events = FaultInjector::new(ledger, script.unwrap_or_default()).map_err(Failure::input)?;
    let mut items: BTreeMap<String, u64> = BTreeMap::new();
    let progress = progress(events.source().scene().duration());
    for event in events.by_ref() {
        progress.set_position(u64::try_from(event.arrived.0 / 1_000_000).unwrap_or(0));
        if let (Some(sensor), true) = (event.body.sensor(), is_item(&event.body)) {
            *items.entry(sensor.to_string()).or_default() += 1;
        }
        files.write(&event).map_err(Failure::failed)?;
    }
    progress.finish_and_clear();
    let truth = asked_for.then(|| events.truth().clone());
    if let Some(truth) = &truth {
        files
            .file("faults.json", |file| serde_json::to_writer_pretty(file, truth).map_err(io::Error::from))
            .map_err(Failure::failed)?;
    }
    if let Some(truth) = events.source().faults() {
        let fill = |file: &mut BufWriter<File>| serde_json::to_writer_pretty(file, truth).map_err(io::Error::from);
        files.file("scene-faults.json", fill).map_err(Failure::failed)?;
    }
    let config = &events.source().scene().config;
    let report = SimulateReport {
        scene: config.name.clone(),
        seed: config.seed,
        duration_s: config.duration_s,
        items,
        faults: truth,
        frames_left_out: files.frames_left_out,
        files: files.finish()?,
    };
    output::report(&report, args.json, || text(&report, &args.output))?;
    Ok(Outcome::Fine)
}

/// Whether a sensor has sent it.
fn is_item(body: &Body) -> bool {
    matches!(body, Body::LidarPacket { .. } | Body::DepthFrame { .. } | Body::SerialChunk { .. })
}

fn prepare(folder: &Path, force: bool) -> Result<(), Failure> {
    let failed = |error: io::Error| Failure::failed(format!("cannot make {}: {error}", folder.display()));
    fs::create_dir_all(folder).map_err(failed)?;
    let is_empty = fs::read_dir(folder).map_err(failed)?.next().is_none();
    if is_empty || force {
        return Ok(());
    }
    Err(Failure::input(format!("{} is not empty", folder.display())).with_help("give -o another folder, or --force"))
}

/// Refuses what cannot be written: nobody wants a full disk after an hour. Counted is what is stored as it is, and not the
/// recording, which is compressed: frames of 16 bits and LiDAR packets with what a capture puts around them.
fn fits(scene: &Scene, free: u64) -> Result<(), Failure> {
    const FRAMES_HZ: f64 = 30.0;
    const CAPTURED: f64 = (16 + 42 + 1206) as f64;
    let frames = scene.kinects.len() as f64 * FRAMES_HZ * (2 * PIXELS) as f64;
    let packets: f64 = scene.lidars.iter().map(|lidar| CAPTURED / lidar.model.packet_span().as_secs_f64()).sum();
    let needed = (frames + packets) * scene.duration().as_secs_f64();
    if needed <= free as f64 {
        return Ok(());
    }
    let (config, gigabytes) = (&scene.config, |bytes: f64| format!("{:.1} GB", bytes / 1e9));
    let (needed, free) = (gigabytes(needed), gigabytes(free as f64));
    let message = format!("{} s of {} take more than {needed}, and {free} are free", config.duration_s, config.name);
    Err(Failure::input(message)
        .with_help("simulate less of it, e.g. --duration 10s, or give -o a folder on another disk"))
}

fn progress(duration: Span) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:40} {percent} %  {eta} left");
    let length = u64::try_from(duration.0 / 1_000_000).unwrap_or(0);
    let bar = ProgressBar::new(length).with_style(style.unwrap_or_else(|_error| ProgressStyle::default_bar()));
    bar.enable_steady_tick(Duration::from_millis(250)); // draws on a terminal only
    bar
}

/// The files of a simulated session.
struct Files {
    folder: PathBuf,
    unix_at_zero: UnixNs,
    recorder: Recorder,
    pcaps: BTreeMap<SensorId, PcapFile>,
    dumps: BTreeMap<SensorId, FakenectFolder>,
    serial: Option<BufWriter<File>>,
    frames_left_out: u64,
    raw: RawImage,
    written: Vec<PathBuf>,
}

impl Files {
    fn create(folder: &Path, scene: &Scene, header: RecordingHeader, replace: bool) -> Result<Self, Failure> {
        let mut written = vec![PathBuf::from("capture.mcap")];
        let recorder = import::create(&folder.join("capture.mcap"), header, replace)?;
        let mut named = |first: &str, other: String, n: usize| {
            let name = PathBuf::from(if n == 0 { first.to_owned() } else { other });
            written.push(name.clone());
            folder.join(name)
        };
        let mut pcaps = BTreeMap::new();
        for (n, lidar) in scene.lidars.iter().enumerate() {
            let path = named("velodyne.pcap", format!("velodyne-{}.pcap", lidar.id), n);
            pcaps.insert(lidar.id.clone(), PcapFile::create(&path).map_err(Failure::failed)?);
        }
        let mut dumps = BTreeMap::new();
        for (n, kinect) in scene.kinects.iter().enumerate() {
            let path = named("kinect", format!("kinect-{}", kinect.id), n);
            dumps.insert(kinect.id.clone(), FakenectFolder::create(&path).map_err(Failure::failed)?);
        }
        let serial = match scene.stage() {
            Some(_) => {
                let path = named("serial.log", String::new(), 0);
                Some(BufWriter::new(File::create(path).map_err(Failure::failed)?))
            }
            None => None,
        };
        let (folder, unix_at_zero) = (folder.to_owned(), scene.unix_at_zero());
        let (raw, frames_left_out) = (RawImage::new(), 0);
        Ok(Self { folder, unix_at_zero, recorder, pcaps, dumps, serial, frames_left_out, raw, written })
    }

    /// What does not come with time: truth, mesh, configs, calibrations.
    fn describe(&mut self, scene: &Scene) -> io::Result<()> {
        self.file("truth.csv", |file| truth(scene, file))?;
        self.file("mesh.ply", |file| mesh(scene, file))?;
        self.file("rig.toml", |file| file.write_all(rig::toml(scene, rig::View::Operator).as_bytes()))?;
        self.file("rig-true.toml", |file| file.write_all(rig::toml(scene, rig::View::Truth).as_bytes()))?;
        for (n, lidar) in scene.lidars.iter().enumerate() {
            if let Some(text) = &lidar.db_xml {
                self.file(&rig::calibration_file(scene, n), |file| file.write_all(text.as_bytes()))?;
            }
        }
        Ok(())
    }

    fn file(&mut self, name: &str, fill: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>) -> io::Result<()> {
        let mut file = BufWriter::new(File::create(self.folder.join(name))?);
        fill(&mut file)?;
        self.written.push(name.into());
        file.flush()
    }

    fn write(&mut self, event: &Event) -> io::Result<()> {
        self.recorder.write(event);
        let host = self.unix_at_zero + Span(event.arrived.0);
        match &event.body {
            Body::LidarPacket { sensor, bytes } => {
                let port = if bytes.len() == POSITION_LEN { 8308 } else { 2368 };
                self.pcaps.get_mut(sensor).map_or(Ok(()), |pcap| pcap.write(host, port, bytes))
            }
            Body::DepthFrame { sensor, ticks, encoding, lost_packets, bytes } => {
                if decode_raw(*encoding, bytes, lost_packets, &mut self.raw).is_err() {
                    self.frames_left_out += 1;
                    return Ok(());
                }
                let codes = self.raw.pixels().iter().map(|code| code.0);
                let dump = self.dumps.get_mut(sensor);
                dump.map_or(Ok(()), |dump| dump.frame(host, ticks.unwrap_or_default(), codes))
            }
            Body::SerialChunk { bytes, .. } => {
                let (at, bytes) = (event.arrived, bytes.to_vec());
                let side = if is_request(&bytes) { Side::Host } else { Side::Device };
                self.serial.as_mut().map_or(Ok(()), |serial| writeln!(serial, "{}", LogEntry { at, side, bytes }))
            }
            _ => Ok(()),
        }
    }

    fn finish(mut self) -> Result<Vec<PathBuf>, Failure> {
        for pcap in self.pcaps.into_values() {
            pcap.finish().map_err(Failure::failed)?;
        }
        if let Some(serial) = &mut self.serial {
            serial.flush().map_err(Failure::failed)?;
        }
        for dump in self.dumps.into_values() {
            dump.finish().map_err(Failure::failed)?;
        }
        import::written(&self.recorder.finish())?;
        Ok(self.written)
    }
}

/// A line for each sample of the truth.
fn truth(scene: &Scene, file: &mut impl Write) -> io::Result<()> {
    writeln!(file, "t_ns,unix_ns,px,py,pz,qx,qy,qz,qw,wx,wy,wz")?;
    for sample in samples(scene) {
        let (p, q, w) =
            (sample.t_rig_target.translation.vector, sample.t_rig_target.rotation, sample.angular_velocity_rps);
        write!(file, "{},{}", sample.t.0, scene.unix_at_zero().0 + sample.t.0)?;
        for value in [p.x, p.y, p.z, q.i, q.j, q.k, q.w, w.x, w.y, w.z] {
            write!(file, ",{value:?}")?;
        }
        writeln!(file)?;
    }
    Ok(())
}

/// The target's surface, PLY.
fn mesh(scene: &Scene, file: &mut impl Write) -> io::Result<()> {
    let mesh = &scene.surface;
    writeln!(file, "ply\nformat ascii 1.0\nelement vertex {}", mesh.vertices.len())?;
    writeln!(file, "property double x\nproperty double y\nproperty double z")?;
    writeln!(file, "element face {}\nproperty list uchar int vertex_indices\nend_header", mesh.triangles.len())?;
    for vertex in &mesh.vertices {
        writeln!(file, "{:?} {:?} {:?}", vertex.x, vertex.y, vertex.z)?;
    }
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle.corners;
        writeln!(file, "3 {a} {b} {c}")?;
    }
    Ok(())
}

fn text(report: &SimulateReport, folder: &Path) -> String {
    let mut text =
        format!("{} (seed {}), {:.1} s -> {}\n", report.scene, report.seed, report.duration_s, folder.display());
    for (sensor, items) in &report.items {
        text.push_str(&format!("  {sensor}: {items} items\n"));
    }
    for line in report.faults.iter().flat_map(faults::lines) {
        text.push_str(&format!("  faults at {line}\n"));
    }
    if report.frames_left_out > 0 {
        let count = report.frames_left_out;
        text.push_str(&format!(
            "  {count} frames of a wrong length are in the recording and not in the fakenect folder\n"
        ));
    }
    let files: Vec<String> = report.files.iter().map(|file| file.display().to_string()).collect();
    text + &format!("  {}\n", files.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_disk_cannot_hold_is_refused_before_it_is_full() {
        let scene = scenes::load("demo").expect("a scene");
        // 120 s: 30 frames a second of 640 x 480 x 2 bytes, and a packet of 1264 bytes every 663.552 us: 18.4 and 1.9 MB/s,
        // 2.44 GB. A percent to either side, since a packet is over a little before the next begins.
        let needed = 120.0 * (30.0 * 614_400.0 + 1_264.0 / 663.552e-6);
        assert!(fits(&scene, (1.01 * needed) as u64).is_ok());
        let refused = fits(&scene, (0.99 * needed) as u64).expect_err("refused").to_string();
        assert!(refused.contains("120 s of demo take more than 2.4 GB"), "{refused}");
    }
}

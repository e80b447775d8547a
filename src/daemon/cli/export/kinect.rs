//! Kinect depth and points: one file a frame.

use std::path::{Path, PathBuf};

use tumbled_kinect::{HEIGHT, MmImage, Points, WIDTH};
use tumbled_model::{Body, UnixNs};

use super::outfile::OutFile;
use super::protected::Protected;
use super::table::{Column, Kind, TableFile, Value};
use super::{Args, Format, Report, What, choose, names, nothing_exported};
use crate::cli::Failure;
use crate::config::Config;
use crate::decoding::Inputs;
use crate::decoding::kinect::{Frame, KinectDecoder};

const COLUMNS: &[Column] = &[
    Column { name: "x", kind: Kind::F32 },
    Column { name: "y", kind: Kind::F32 },
    Column { name: "z", kind: Kind::F32 },
    Column { name: "sigma_z", kind: Kind::F32 },
    Column { name: "u", kind: Kind::U16 },
    Column { name: "v", kind: Kind::U16 },
];

/// At most so many frames that cannot be decoded are told of one by one.
const REFUSALS_TOLD: u64 = 8;

/// The file of host times that is read beside depth frames.
const TIMES: &str = "times.txt";

/// Decodes one Kinect's frames and writes each wanted one.
pub(super) fn export(
    args: &Args,
    config: &Config,
    protected: &Protected,
    inputs: &mut Inputs,
) -> Result<Report, Failure> {
    let sensor = choose(&config.kinects, |kinect| kinect.id.as_str(), args.sensor.as_deref(), "Kinect")?;
    let mut decoder = KinectDecoder::new(sensor)?;
    let mut files = Files::new(args, protected);
    let mut report = Report {
        what: args.what,
        format: args.format,
        sensor: sensor.id.to_string(),
        files: Vec::new(),
        records: 0,
        points: 0,
        lost: 0,
        not_decoded: 0,
        complete: true, // the rest is judged with the inputs, by the caller
        warnings: Vec::new(),
    };
    // Without times of their own the frames would get made-up ones.
    let epoch = inputs.epoch().filter(|_| inputs.have_host_times());
    let mut number = 0;
    while let Some(event) = inputs.next_event()? {
        let Body::DepthFrame { sensor: id, ticks, encoding, lost_packets, bytes } = &event.body else { continue };
        if *id != sensor.id {
            continue;
        }
        let frame_number = number;
        number += 1;
        if !args.frames.contains(frame_number) {
            continue;
        }
        let frame = Frame { ticks: *ticks, encoding: *encoding, lost: lost_packets, bytes };
        let written = match args.what {
            What::KinectDepth => decoder.millimetres(frame).map(|image| files.depth(frame_number, image)),
            _ => decoder.points(frame).map(|points| files.points(frame_number, points)),
        };
        match written {
            Ok(points) => {
                report.points += points?;
                files.times.extend(epoch.map(|epoch| UnixNs(epoch.0 + event.arrived.0)));
            }
            Err(reason) => {
                report.not_decoded += 1;
                if report.not_decoded <= REFUSALS_TOLD {
                    report.warnings.push(format!("frame {frame_number} not decoded: {reason}"));
                }
            }
        }
    }
    if report.not_decoded > REFUSALS_TOLD {
        report.warnings.push(format!("{} more frames not decoded", report.not_decoded - REFUSALS_TOLD));
    }
    let counts = decoder.counts();
    report.records = counts.frames;
    report.lost = counts.lost_packets;
    if counts.lost_packets > 0 {
        let (packets, frames) = (counts.lost_packets, counts.frames_with_loss);
        report.warnings.push(format!("{packets} USB packets missing in {frames} frames: their pixels have no data"));
    }
    if decoder.repeated() > 0 {
        report.warnings.push(format!("{} frames repeat the frame before them", decoder.repeated()));
    }
    if report.records == 0 {
        let why = report.warnings.first().cloned().unwrap_or_else(|| {
            if number == 0 {
                "the inputs hold no depth frames".to_owned()
            } else {
                format!("the inputs hold {number} frames, none in --frames")
            }
        });
        return Err(nothing_exported(&why, inputs).with_help("`tumbled info INPUT` lists what is in it"));
    }
    let (written, warning) = files.finish()?;
    report.files = names(&written);
    report.warnings.extend(warning);
    Ok(report)
}

/// Names the files: PATH itself for one frame, `frame-NNNNNN.EXT` in the folder PATH for several.
///
/// Whether there are several is known with the second frame. If PATH has the format's extension the first waits until
/// the end before it takes its name: an export that is refused for its second frame must not leave, or overwrite, a file.
struct Files<'a> {
    args: &'a Args,
    protected: &'a Protected,
    single: bool,
    waiting: Option<Written>,
    written: Vec<PathBuf>,
    /// Host times of the frames, in their order; empty when the inputs have none.
    times: Vec<UnixNs>,
}

/// A file whose content is there.
enum Written {
    Image(OutFile),
    Table(TableFile),
}

impl Written {
    fn finish(self) -> Result<PathBuf, Failure> {
        match self {
            Self::Image(file) => file.finish(&[]),
            Self::Table(table) => table.finish(),
        }
    }
}

impl<'a> Files<'a> {
    fn new(args: &'a Args, protected: &'a Protected) -> Self {
        let named_as_file = args.output.extension().is_some_and(|e| e.eq_ignore_ascii_case(args.format.extension()));
        // A device or a pipe takes one frame, whatever it is called.
        let is_special = args.output.metadata().is_ok_and(|found| !found.is_file() && !found.is_dir());
        let single = is_special || (named_as_file && !args.output.is_dir());
        Self { args, protected, single, waiting: None, written: Vec::new(), times: Vec::new() }
    }

    /// The place of a frame's file.
    fn path(&self, number: u64) -> Result<PathBuf, Failure> {
        if !self.single {
            return Ok(self.args.output.join(format!("frame-{number:06}.{}", self.args.format.extension())));
        }
        if self.waiting.is_none() {
            return Ok(self.args.output.clone());
        }
        let example = Path::new(&self.args.output).with_extension("");
        Err(Failure::input(format!("the inputs hold several frames, {} is one file", self.args.output.display()))
            .with_help(format!("give a folder (-o {}/) or one frame (--frames 0..1)", example.display())))
    }

    fn depth(&mut self, number: u64, image: &MmImage) -> Result<u64, Failure> {
        let path = self.path(number)?;
        let mut file = OutFile::create(&path, false, self.protected)?;
        if self.args.format == Format::Png {
            file.write(&png(image)?)?;
        } else {
            for row in image.pixels().chunks(WIDTH) {
                let cells: Vec<String> = row.iter().map(ToString::to_string).collect();
                file.write(format!("{}\n", cells.join(",")).as_bytes())?;
            }
        }
        self.keep(Written::Image(file))?;
        Ok(image.pixels().iter().filter(|mm| **mm != 0).count() as u64)
    }

    fn points(&mut self, number: u64, points: &Points) -> Result<u64, Failure> {
        let comments = vec![
            "tumbled kinect-points: metres, x right, y down, z forward (depth camera frame)".to_owned(),
            "sigma_z: standard deviation of z, metres; u, v: pixel".to_owned(),
        ];
        let mut table = TableFile::create(&self.path(number)?, self.args.format, COLUMNS, comments, self.protected)?;
        let coordinates = points.x().iter().zip(points.y()).zip(points.z()).zip(points.sigma_z());
        for ((((x, y), z), sigma_z), pixel) in coordinates.zip(points.pixel()) {
            let (u, v) = (*pixel as usize % WIDTH, *pixel as usize / WIDTH);
            table.row(&[
                Value::F32(*x),
                Value::F32(*y),
                Value::F32(*z),
                Value::F32(*sigma_z),
                Value::U16(u as u16),
                Value::U16(v as u16),
            ])?;
        }
        self.keep(Written::Table(table))?;
        Ok(points.len() as u64)
    }

    fn keep(&mut self, file: Written) -> Result<(), Failure> {
        if self.single {
            self.waiting = Some(file);
        } else {
            self.written.push(file.finish()?);
        }
        Ok(())
    }

    /// Puts the last files in their places; the files, and what is wrong with the folder as an input if anything is.
    fn finish(mut self) -> Result<(Vec<PathBuf>, Option<String>), Failure> {
        if let Some(only) = self.waiting.take() {
            self.written.push(only.finish()?);
            return Ok((self.written, None));
        }
        let folder = &self.args.output;
        let times = folder.join(TIMES);
        if !self.times.is_empty() {
            let mut file = OutFile::create(&times, false, self.protected)?;
            for UnixNs(ns) in &self.times {
                file.write(format!("{}.{:09}\n", ns / 1_000_000_000, ns % 1_000_000_000).as_bytes())?;
            }
            file.finish(&[])?;
        }
        let warning = if self.times.is_empty() && times.exists() {
            Some(format!("{} is not of these frames, whose times are unknown: remove it", times.display()))
        } else {
            match self.other_files() {
                0 => None,
                others => Some(format!(
                    "{} holds {others} more .{} files than this export wrote: they are no part of it",
                    folder.display(),
                    self.args.format.extension()
                )),
            }
        };
        Ok((self.written, warning))
    }

    /// Files in the folder that could be taken for frames of this export.
    fn other_files(&self) -> usize {
        let extension = self.args.format.extension();
        let is_frame = |path: &Path| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension));
        let hidden = |path: &Path| path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
        let Ok(entries) = self.args.output.read_dir() else { return 0 };
        let frames = entries.flatten().map(|entry| entry.path()).filter(|path| is_frame(path) && !hidden(path));
        frames.count().saturating_sub(self.written.len())
    }
}

/// A 16-bit grey PNG.
fn png(image: &MmImage) -> Result<Vec<u8>, Failure> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, WIDTH as u32, HEIGHT as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    let big_endian: Vec<u8> = image.pixels().iter().flat_map(|mm| mm.to_be_bytes()).collect();
    encoder
        .write_header()
        .and_then(|mut writer| {
            writer.write_image_data(&big_endian)?;
            writer.finish()
        })
        .map_err(Failure::failed)?;
    Ok(bytes)
}

//! LiDAR points: per packet, in the sensor's frame, nothing moved, nothing filtered.

use std::path::PathBuf;

use tumbled_model::{Body, Event};
use tumbled_velodyne::LidarPoint;
use tumbled_velodyne::stream::{Decoded, PacketInfo, Refused, StreamDecoder};
use tumbled_velodyne::track::Order;

use super::outfile::OutFile;
use super::protected::Protected;
use super::table::{Column, Kind, TableFile, Value};
use super::turns::Turns;
use super::{Args, Format, Report, choose, names, nothing_exported};
use crate::cli::Failure;
use crate::config::Config;
use crate::decoding::{Inputs, lidar};

const COLUMNS: &[Column] = &[
    Column { name: "x", kind: Kind::F32 },
    Column { name: "y", kind: Kind::F32 },
    Column { name: "z", kind: Kind::F32 },
    Column { name: "intensity", kind: Kind::U8 },
    Column { name: "ring", kind: Kind::U8 },
    Column { name: "return", kind: Kind::U8 },
    Column { name: "laser", kind: Kind::U8 },
    Column { name: "column", kind: Kind::U8 },
    Column { name: "packet", kind: Kind::U32 },
    Column { name: "stamp_us", kind: Kind::U32 },
    Column { name: "dt_ns", kind: Kind::I32 },
    Column { name: "range_m", kind: Kind::F32 },
    Column { name: "azimuth_deg", kind: Kind::F32 },
    Column { name: "flags", kind: Kind::U16 },
];

/// Bit 0 of the flags: the packet holds an azimuth jump.
const FLAG_JUMP: u16 = 1;

/// Decodes one LiDAR's packets and writes its points.
pub(super) fn export(
    args: &Args,
    config: &Config,
    protected: &Protected,
    inputs: &mut Inputs,
) -> Result<Report, Failure> {
    let sensor = choose(&config.lidars, |lidar| lidar.id.as_str(), args.sensor.as_deref(), "LiDAR")?;
    let mut decoder = StreamDecoder::new(lidar::settings(sensor)?);
    let mut decoded = Decoded::default();
    let mut sink = Sink::create(args, protected)?;
    let mut turns = Turns::default();
    let mut lost: u64 = 0;
    loop {
        let event = inputs.next_event()?;
        match &event {
            Some(Event { body: Body::LidarPacket { sensor: id, bytes }, arrived, .. }) if *id == sensor.id => {
                decoder.push(bytes, *arrived, &mut decoded);
            }
            Some(_) => continue,
            None => decoder.finish(&mut decoded),
        }
        for packet in &decoded.packets {
            let turn = turns.of(packet, decoder.tracker().rpm());
            if args.frames.contains(turn) {
                sink.packet(packet, &decoded)?;
                match packet.order {
                    Order::Next { lost: before } => lost += before,
                    // It was counted as lost when its successor came.
                    Order::Late => lost = lost.saturating_sub(1),
                    Order::Duplicate | Order::Doubtful | Order::Reset => {}
                }
            }
        }
        decoded.clear();
        if event.is_none() {
            break;
        }
    }
    refuse_nothing(&decoder, inputs)?;
    if sink.packets == 0 {
        let seen = turns.seen();
        let why = format!("the inputs hold {seen} turns of the head, begun ones counted, none in --frames");
        return Err(nothing_exported(&why, inputs).with_help("turns are counted from 0"));
    }
    let whole = args.frames.contains(0) && !args.frames.is_behind(u64::MAX - 1);
    let lost_of_all = decoder.tracker().totals().lost;
    Ok(Report {
        what: args.what,
        format: args.format,
        sensor: sensor.id.to_string(),
        records: sink.packets,
        points: sink.points,
        // A silence may count as loss until the field of view is known; of all packets together that is then corrected.
        lost: if whole { lost_of_all } else { lost.min(lost_of_all) },
        not_decoded: decoder.counts().refused(),
        complete: true, // the rest is judged with the inputs, by the caller
        warnings: warnings(&decoder),
        files: names(&[sink.finish()?]),
    })
}

/// An export without a single packet is a mistake to be told, not an empty file to be found later.
fn refuse_nothing(decoder: &StreamDecoder, inputs: &Inputs) -> Result<(), Failure> {
    if decoder.counts().data_packets > 0 {
        return Ok(());
    }
    let remedy = inputs.captures().find_map(|capture| capture.summary().hint()).map(|hint| hint.to_string());
    let why = match decoder.counts().rejected.values().max_by_key(|refused| refused.count) {
        Some(Refused { count, first }) => {
            format!("none of the LiDAR's packets can be decoded ({count} like the first: {first})")
        }
        None => "the inputs hold no LiDAR packets".to_owned(),
    };
    let remedy = remedy.unwrap_or_else(|| "`tumbled info INPUT` lists what is in it".to_owned());
    Err(nothing_exported(&why, inputs).with_help(remedy))
}

/// What the decoder noticed that the person should know.
fn warnings(decoder: &StreamDecoder) -> Vec<String> {
    let mut warnings = Vec::new();
    warnings.extend(decoder.period_mismatch().map(|mismatch| mismatch.to_string()));
    if let (Some(says), Some(model)) = (decoder.contradiction(), decoder.model()) {
        warnings.push(format!("the packets say {says}, lidar.model says {model}: decoded as {model}"));
    }
    for (kind, Refused { count, first }) in &decoder.counts().rejected {
        warnings.push(format!("{count} payloads not decoded ({kind}), the first: {first}"));
    }
    let totals = decoder.tracker().totals();
    if totals.lost > 0 {
        warnings.push(format!("{} packets lost in {} places, by their stamps", totals.lost, totals.gaps));
    }
    if totals.duplicates > 0 {
        warnings.push(format!("{} packets came twice: both are exported", totals.duplicates));
    }
    if totals.late > 0 {
        warnings
            .push(format!("{} packets came after later ones: they are exported in the order they came", totals.late));
    }
    if totals.resets > 0 {
        warnings.push(format!("the sensor's clock was set anew {} times: losses around it are unknown", totals.resets));
    }
    warnings
}

/// Where the points go.
struct Sink {
    file: File,
    packets: u64,
    points: u64,
}

enum File {
    Pts(OutFile),
    Table(TableFile),
}

impl Sink {
    fn create(args: &Args, protected: &Protected) -> Result<Self, Failure> {
        let comments = || {
            vec![
                "tumbled lidar-points: metres, x forward, y left, z up (sensor frame), one row per return".to_owned(),
                "ring 0 = lowest; return 1 strongest, 2 last, 3 both the same; dt_ns after stamp_us (us past the hour)"
                    .to_owned(),
                "flags bit 0: the packet holds an azimuth jump".to_owned(),
            ]
        };
        let file = match args.format {
            Format::Pts => File::Pts(OutFile::create(&args.output, false, protected)?),
            format => File::Table(TableFile::create(&args.output, format, COLUMNS, comments(), protected)?),
        };
        Ok(Self { file, packets: 0, points: 0 })
    }

    fn packet(&mut self, packet: &PacketInfo, decoded: &Decoded) -> Result<(), Failure> {
        self.packets += 1;
        self.points += packet.points.len() as u64;
        let flags = if packet.azimuth_jump { FLAG_JUMP } else { 0 };
        for point in decoded.points.iter_range(packet.points.clone()) {
            match &mut self.file {
                File::Pts(file) => file.write(&pts_record(packet, &point, flags))?,
                File::Table(table) => table.row(&row(packet, &point, flags))?,
            }
        }
        Ok(())
    }

    fn finish(self) -> Result<PathBuf, Failure> {
        match self.file {
            File::Pts(file) => file.finish(&[]),
            File::Table(table) => table.finish(),
        }
    }
}

/// The 24-byte record: f32 x, y, z; i32 ns after the packet's stamp; u16 packet; u8 column, ring, intensity, return; u16 flags.
fn pts_record(packet: &PacketInfo, point: &LidarPoint, flags: u16) -> [u8; 24] {
    let mut record = [0; 24];
    let [x, y, z] = point.xyz.map(f32::to_le_bytes);
    let index = (packet.index % 65_536) as u16;
    let fields = [
        x.as_slice(),
        &y,
        &z,
        &point.dt_ns.to_le_bytes(),
        &index.to_le_bytes(),
        &[point.column, point.ring, point.intensity, point.ret as u8],
        &flags.to_le_bytes(),
    ];
    for (place, byte) in record.iter_mut().zip(fields.into_iter().flatten()) {
        *place = *byte;
    }
    record
}

fn row(packet: &PacketInfo, point: &LidarPoint, flags: u16) -> [Value; 14] {
    let [x, y, z] = point.xyz;
    [
        Value::F32(x),
        Value::F32(y),
        Value::F32(z),
        Value::U8(point.intensity),
        Value::U8(point.ring),
        Value::U8(point.ret as u8),
        Value::U8(point.laser),
        Value::U8(point.column),
        Value::U32(packet.index as u32),
        Value::U32(packet.stamp.map_or(0, |stamp| stamp.0)),
        Value::I32(point.dt_ns),
        Value::F32(point.range_m),
        Value::F32(point.azimuth_rad.to_degrees()),
        Value::U16(flags),
    ]
}

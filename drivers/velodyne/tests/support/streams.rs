//! Streams of the synthetic sensor, run through the decoder.

use super::synth::{Packet, Sensor};
use tumbled_model::RigNs;
use tumbled_velodyne::stream::{Decoded, Settings, StreamDecoder};
use tumbled_velodyne::{Model, ReturnMode};

pub(crate) fn run(packets: &[Packet], settings: Settings) -> (StreamDecoder, Decoded) {
    let mut decoder = StreamDecoder::new(settings);
    let mut out = Decoded::default();
    for packet in packets {
        // The packet leaves when its last block has fired.
        let arrived = RigNs(packet.group_t_ns.last().copied().unwrap_or(0) + 100_000);
        decoder.push(&packet.bytes, arrived, &mut out);
    }
    decoder.finish(&mut out);
    (decoder, out)
}

/// Packets of three turns and a bit. A pause that falls exactly between two packets is told from loss by the next one:
/// one turn alone may not show the view's limits.
pub(crate) fn turns(sensor: &Sensor, turns: f64) -> Vec<Packet> {
    let view = sensor.silent_deg.map_or(360.0, |(from, to)| 360.0 - (to - from).rem_euclid(360.0));
    let period = tumbled_velodyne::detect::packet_period_ns(sensor.model, sensor.mode).expect("built-in");
    let per_turn = view / 360.0 * 60e9 / sensor.rpm / period as f64;
    sensor.packets((turns * per_turn) as usize, far)
}

/// Whether the view ends or begins in or right beside packet `k`.
pub(crate) fn at_limit(packets: &[Packet], k: usize) -> bool {
    let pause_before = |k: usize| {
        k > 0 && k < packets.len() && {
            let (last, next) = (&packets[k - 1].group_t_ns, packets[k].group_t_ns[0]);
            next - last[last.len() - 1] > last[1] - last[0] && next - last[last.len() - 1] > last[2] - last[1]
        }
    };
    packets[k].has_jump || pause_before(k) || pause_before(k + 1)
}

pub(crate) fn far(_slot: usize, _t: i64) -> (u16, u16) {
    (1_000, 1_000)
}

/// Four sensors: model, mode, limited view.
pub(crate) fn sensors() -> Vec<Sensor> {
    let views = [None, Some((91.0, 270.0)), Some((10.0, 350.0)), Some((200.0, 230.0))];
    let kinds = [
        (Model::Vlp32c, ReturnMode::Strongest),
        (Model::Vlp32c, ReturnMode::Dual),
        (Model::Vlp16, ReturnMode::Last),
        (Model::Vlp16, ReturnMode::Dual),
        (Model::Vlp16HiRes, ReturnMode::Strongest),
        (Model::Hdl32e, ReturnMode::Strongest),
    ];
    let mut sensors = Vec::new();
    for rpm in [300.0, 600.0, 1_200.0] {
        for silent_deg in views {
            for (model, mode) in kinds {
                let start_deg = if silent_deg == Some((10.0, 350.0)) { 355.0 } else { 300.0 };
                sensors.push(Sensor { rpm, silent_deg, start_deg, ..Sensor::new(model, mode) });
            }
        }
    }
    sensors
}

/// Shifts the stamps and not the arrivals of all packets from `from` on.
pub(crate) fn set_clock(packets: &mut [Packet], from: usize, shift_us: i32) {
    for packet in packets.iter_mut().skip(from) {
        let stamp = u32::from_le_bytes(packet.bytes[1200..1204].try_into().expect("four bytes"));
        packet.bytes[1200..1204].copy_from_slice(&stamp.wrapping_add_signed(shift_us).to_le_bytes());
    }
}

/// Times of all points after the sensor's first firing, against the truth.
pub(crate) fn worst_time_error(sensor: &Sensor, packets: &[Packet], out: &Decoded) -> i64 {
    let beams = tumbled_velodyne::beams::BeamTable::new(sensor.model.spec().expect("built-in"), false);
    let lasers = sensor.model.lasers();
    let columns = 32 / lasers;
    let mut worst = 0;
    for info in &out.packets {
        let packet = &packets[info.index as usize];
        for p in out.points.iter_range(info.points.clone()) {
            let slot = usize::from(p.laser) + usize::from(p.column) % columns * lasers;
            let group_ns = packet.group_t_ns[usize::from(p.column) / columns] - packet.t_ns;
            worst = worst.max((i64::from(p.dt_ns) - group_ns - i64::from(beams.beam(slot).expect("slot").dt_ns)).abs());
        }
    }
    worst
}

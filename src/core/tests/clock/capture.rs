//! The real VLP-32C with a limited field of view: three packets of the capture arrive up to 50 ms late against their stamps.

use std::fs;
use tumbled_core::clock::{ClockMode, ClockState, DeviceClock, DeviceClockKind, Pushed};
use tumbled_model::RigNs;

const CAPTURE: &str =
    concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data/velodyne/vlp32c_strongest_600rpm_fov180_a.pcap");

/// Stamp and arrival (ns since the first) of every data packet. The file is a little-endian pcap with nanosecond
/// stamps: 24 bytes, then for each packet 16 bytes (seconds, nanoseconds, bytes stored, bytes sent) and the packet, whose
/// UDP payload begins after 42 bytes of headers.
fn stamps(file: &[u8]) -> Vec<(u32, i64)> {
    let word = |at: usize| file.get(at..at + 4).map(|bytes| u32::from_le_bytes(bytes.try_into().expect("four bytes")));
    assert_eq!(word(0), Some(0xA1B2_3C4D));
    let (mut at, mut stamps) = (24, Vec::new());
    while let (Some(seconds), Some(ns), Some(stored)) = (word(at), word(at + 4), word(at + 8)) {
        let payload = at + 16 + 42;
        if stored == 42 + 1_206 {
            let arrived = i64::from(seconds) * 1_000_000_000 + i64::from(ns);
            stamps.push((word(payload + 1_200).expect("a whole packet"), arrived));
        }
        at += 16 + stored as usize;
    }
    let first = stamps.first().expect("data packets").1;
    stamps.iter().map(|&(raw, arrived)| (raw, arrived - first)).collect()
}

#[test]
fn the_pause_inside_a_real_packet_is_not_taken_for_delay() {
    let Ok(file) = fs::read(CAPTURE) else {
        println!("skipped: ../shared/data/velodyne/vlp32c_strongest_600rpm_fov180_a.pcap is not there");
        return;
    };
    let stamps = stamps(&file);
    assert_eq!(stamps.len(), 228);
    let mut clock = DeviceClock::new(DeviceClockKind::Velodyne, ClockMode::Hull);
    let (first, _) = stamps[0];
    let mut late = 0;
    for (index, &(raw, arrived)) in stamps.iter().enumerate() {
        let pushed = clock.push(raw, RigNs(arrived));
        assert_eq!(pushed, if index == 0 { Pushed::NewEpoch } else { Pushed::InOrder });
        let t = clock.map(raw).expect("just pushed").t.0;
        // Arrivals scatter by 0.2 ms downwards, so the offset may fall by as much and may not rise.
        let offset = t - i64::from(raw - first) * 1_000;
        assert!((-300_000..=0).contains(&offset), "packet {index}: {offset} ns");
        late += u32::from(arrived - t > 40_000_000);
    }
    assert_eq!(late, 3);
    assert_eq!(clock.report(RigNs(300_000_000)).state, ClockState::Acquiring);
}

//! Time a packet costs the mapper: pushed and mapped, all rebuilding of the hull included.

use divan::counter::ItemsCount;
use tumbled_core::clock::{ClockMode, DeviceClock, DeviceClockKind};
use tumbled_model::RigNs;

fn main() {
    divan::main();
}

/// A minute of VLP-32C packets (1507/s) with delays of up to 0.5 ms in a fixed pattern.
#[divan::bench(args = [ClockMode::Hull, ClockMode::Kalman])]
fn packet(bencher: divan::Bencher<'_, '_>, mode: ClockMode) {
    const PACKETS: u32 = 90_420;
    let mut clock = DeviceClock::new(DeviceClockKind::Velodyne, mode);
    let mut index = 0u32;
    bencher.counter(ItemsCount::new(PACKETS)).bench_local(|| {
        for _ in 0..PACKETS {
            let raw = (u64::from(index) * 663 % 3_600_000_000) as u32;
            let delay = i64::from(index.wrapping_mul(2_654_435_761) >> 13);
            clock.push(raw, RigNs(i64::from(index) * 663_000 + delay));
            divan::black_box(clock.map(raw));
            index += 1;
        }
    });
}

//! Microseconds per packet. `cargo bench -p tumbled-sim --bench lidar`.
//!
//! A VLP-32C sends a packet every 663.6 µs, a VLP-16 every 1327.1 µs, an HDL-64E S2 every 288 µs: the ratio is how much
//! faster than the sensor one core makes its packets. Each sample makes one turn at 600 rpm.

#[path = "../tests/support/mod.rs"]
mod support;

use divan::counter::ItemsCount;
use support::{config, hdl64e, room, sensor, target};
use tumbled_sim::lidar::{Head, LidarParameters};
use tumbled_sim::world::World;
use tumbled_velodyne::hdl64::Generation;
use tumbled_velodyne::{Model, ReturnMode};

fn main() {
    divan::main();
}

fn turn(bencher: divan::Bencher<'_, '_>, head: Head, packets: u64, world: &World) {
    let mut config = config(head, ReturnMode::Strongest, 600);
    config.parameters = LidarParameters::default();
    let model = sensor(config);
    bencher
        .counter(ItemsCount::new(packets))
        .bench_local(|| (0..packets).map(|index| usize::from(model.packet(world, index, 1).bytes[4])).sum::<usize>());
}

#[divan::bench]
fn vlp32c_target_alone(bencher: divan::Bencher<'_, '_>) {
    turn(bencher, Head::BuiltIn(Model::Vlp32c), 151, &target(0.1));
}

#[divan::bench]
fn vlp32c_room(bencher: divan::Bencher<'_, '_>) {
    turn(bencher, Head::BuiltIn(Model::Vlp32c), 151, &room());
}

#[divan::bench]
fn vlp16_target_alone(bencher: divan::Bencher<'_, '_>) {
    turn(bencher, Head::BuiltIn(Model::Vlp16), 75, &target(0.1));
}

#[divan::bench]
fn hdl64e_target_alone(bencher: divan::Bencher<'_, '_>) {
    turn(bencher, hdl64e(Generation::S2), 347, &target(0.1));
}

//! Each raw point is in exactly one epoch, and has its own time.

use crate::support::chance::Chance;
use crate::support::devices::{FIRING_NS, KINECT_POINTS, LASERS, Way, kinect, lidar, packets, vlp32c};
use crate::support::faults::{burst, lose, repeat, set_clock, swap};
use crate::support::ledger::{MS, S, Source, ledger, run_with, ticks};
use crate::support::rig::{self, LIDAR};
use crate::support::tally::Tally;
use crate::synth::{Packet, Sensor};
use proptest::prelude::*;
use tumbled_core::health::{EpochHealth, PointHealth};
use tumbled_core::{CoreHealth, Outputs, Pipeline, RegionOfInterest, Workers};
use tumbled_model::{Body, Event, Point, SensorId};
use tumbled_velodyne::ReturnMode;

/// Sum of what became of points.
fn accounted(points: &PointHealth) -> u64 {
    let PointHealth { decoded: _, in_epochs, duplicate, late, untimed, shed } = points;
    in_epochs + duplicate + late + untimed + shed
}

/// A sensor in the last report.
fn last<'a>(health: &'a [CoreHealth], id: &str) -> &'a tumbled_core::SensorHealth {
    let report = health.last().expect("a report");
    report.sensors.iter().find(|sensor| sensor.id == id).expect("a sensor of the rig")
}

#[test]
fn a_clean_session_gives_every_point_out_once_at_its_own_time() {
    for silent_deg in [None, Some((40.0, 320.0)), Some((350.0, 10.0)), Some((100.0, 200.0))] {
        for mode in [ReturnMode::Strongest, ReturnMode::Dual] {
            let sensor = Sensor { silent_deg, mode, ..vlp32c() };
            let packets = packets(&sensor, 4 * S);
            // The first two seconds are the clock's.
            let (mut early, mut tally) = (Tally::new(Way::PERFECT), Tally::new(Way::PERFECT));
            let events = ledger(&[lidar(&packets, Way::PERFECT, 0), ticks(4 * S)]);
            let (pipeline, _) = run_with(rig::lidar_only(), &events, |epoch| {
                if epoch.span.0.0 < 2_300 * MS { early.see(epoch) } else { tally.see(epoch) }
            });
            let firings: u64 = packets.iter().map(|packet| packet.group_t_ns.len() as u64).sum();
            let points = &pipeline.sensors()[0].points;
            assert_eq!(points.decoded, firings * LASERS.len() as u64, "{mode:?} {silent_deg:?}");
            assert_eq!(
                *points,
                PointHealth { decoded: points.decoded, in_epochs: points.decoded, ..PointHealth::default() }
            );
            assert_eq!((early.points + tally.points, early.twice + tally.twice), (points.decoded, 0));
            // A packet leaves when its last firing is over, so the least delay, which no clock can see, is twelve firings
            // (six in dual return); stamps are whole µs, and the least of their errors, −0.5 µs, is taken for none.
            let least = 12 / mode.blocks_per_firing() as i64 * FIRING_NS;
            let (low, high) = (tally.errors.0 - least, tally.errors.1 - least);
            assert!(low >= -1_100 && high <= 1_100, "{low}..{high} ns, {mode:?} {silent_deg:?}");
        }
    }
}

#[test]
fn behind_a_jittering_transport_times_are_within_what_the_clock_promises() {
    let packets = packets(&vlp32c(), 12 * S);
    let mut tally = Tally::new(Way::UDP);
    let mut sigma = 0;
    let (pipeline, _) = run_with(rig::lidar_only(), &ledger(&[lidar(&packets, Way::UDP, 5), ticks(12 * S)]), |epoch| {
        if epoch.span.0.0 > 4 * S {
            sigma = sigma.max(epoch.sigma.0);
            tally.see(epoch);
        }
    });
    assert_eq!(pipeline.sensors()[0].points.late, 0);
    let least = 12 * FIRING_NS + Way::UDP.least_ns;
    let (low, high) = (tally.errors.0 - least, tally.errors.1 - least);
    assert!(sigma < 10_000, "{sigma} ns");
    assert!(low >= -3 * sigma - 1_000 && high <= 3 * sigma + 1_000, "{low}..{high} ns, sigma {sigma} ns");
}

#[test]
fn every_frame_of_a_camera_is_an_epoch_and_every_pixel_in_it_once() {
    let events = ledger(&[kinect(3 * S, Way::USB, 8), ticks(6 * S)]);
    let (mut points, mut t) = (0, Vec::new());
    let (pipeline, out) = run_with(rig::kinect_only(), &events, |epoch| {
        points += epoch.scan.len() as u64;
        t.push(epoch.t.0);
        assert_eq!(epoch.rig.len(), epoch.scan.len());
    });
    assert_eq!((t.len(), points), (90, 90 * KINECT_POINTS));
    assert!(t.is_sorted());
    let expected = PointHealth { decoded: points, in_epochs: points, ..PointHealth::default() };
    assert_eq!(pipeline.sensors()[0].points, expected);
    assert_eq!(last(&out.health, "near").epochs, EpochHealth { given_out: 90, ..EpochHealth::default() });
}

/// What happens to a session's packets.
#[derive(Clone, Debug)]
enum Fault {
    None,
    Lose(u64),
    /// From a packet on, so many.
    Burst(usize, usize),
    Swap(u64),
    Repeat(u64),
    /// From a packet on, by so many µs.
    Set(usize, i64),
    /// From a time on, for so many ms: nothing comes.
    Silence(i64, i64),
    /// So many scans at a time.
    Skip(i64, u16),
    /// Another region of interest at a time.
    Configure(i64),
}

fn fault() -> impl Strategy<Value = Fault> {
    prop_oneof![
        Just(Fault::None),
        (1_000u64..300_000).prop_map(Fault::Lose),
        (10usize..3_000, 1usize..800).prop_map(|(from, lost)| Fault::Burst(from, lost)),
        (1_000u64..200_000).prop_map(Fault::Swap),
        (1_000u64..200_000).prop_map(Fault::Repeat),
        (10usize..3_000, prop_oneof![-10_000_000i64..10_000_000, -900_000i64..900_000])
            .prop_map(|(from, us)| Fault::Set(from, us)),
        (100i64..2_000, 20i64..6_000).prop_map(|(at, ms)| Fault::Silence(at, ms)),
        (100i64..2_000, 1u16..4).prop_map(|(at, scans)| Fault::Skip(at, scans)),
        (100i64..2_000).prop_map(Fault::Configure),
    ]
}

fn sensor() -> impl Strategy<Value = Sensor> {
    let views = prop_oneof![
        Just(None),
        Just(Some((40.0, 320.0))),
        Just(Some((350.0, 10.0))),
        Just(Some((300.0, 60.0))),
        Just(Some((20.0, 350.0))),
    ];
    let modes = prop_oneof![Just(ReturnMode::Strongest), Just(ReturnMode::Dual)];
    (views, modes, prop_oneof![Just(300.0), Just(600.0), Just(1_200.0)]).prop_map(|(silent_deg, mode, rpm)| Sensor {
        rpm,
        silent_deg,
        mode,
        start_deg: if silent_deg.is_some() { 15.0 } else { 180.0 },
        ..vlp32c()
    })
}

/// The session's sources after its faults, and when the config changes.
fn session(mut packets: Vec<Packet>, faults: &[Fault], seed: u64) -> (Vec<Source>, Vec<i64>) {
    let mut chance = Chance::new(seed);
    for fault in faults {
        match *fault {
            Fault::Set(from, us) => set_clock(&mut packets, from, us),
            // Its clock goes on in a silence.
            Fault::Silence(at, ms) => {
                let from = packets.partition_point(|packet| packet.t_ns < at * MS);
                set_clock(&mut packets, from, ms * 1_000);
            }
            _ => {}
        }
    }
    let mut front = lidar(&packets, Way::UDP, seed);
    let (mut skips, mut configs, mut shift) = (Vec::new(), Vec::new(), 0);
    for fault in faults {
        match *fault {
            Fault::None | Fault::Set(..) => {}
            Fault::Lose(ppm) => drop(lose(&mut front, ppm, &mut chance)),
            Fault::Burst(from, lost) => burst(&mut front, from, lost),
            Fault::Swap(ppm) => drop(swap(&mut front, ppm, &mut chance)),
            Fault::Repeat(ppm) => drop(repeat(&mut front, ppm, &mut chance)),
            Fault::Silence(at, ms) => {
                front.iter_mut().filter(|(t, _)| *t >= at * MS).for_each(|(t, _)| *t += ms * MS);
                shift += ms;
            }
            Fault::Skip(at, scans) => skips.push((at * MS, Body::Skip { sensor: SensorId::from(LIDAR), scans })),
            Fault::Configure(at) => configs.push(at * MS),
        }
    }
    skips.sort_by_key(|(t, _)| *t);
    configs.sort_unstable();
    let until = 2_500 * MS + shift * MS + 3 * S;
    (vec![skips, front, ticks(until)], configs)
}

/// Runs a session, with another region of interest from each of some times on.
fn run(events: &[Event], configs: &[i64], tally: &mut Tally) -> (Pipeline, Outputs) {
    let mut pipeline = Pipeline::new(rig::lidar_only(), Workers::none());
    let (mut out, mut all) = (Outputs::default(), Outputs::default());
    let mut due = configs.iter().enumerate();
    let mut next = due.next();
    for event in events {
        while let Some((n, at)) = next
            && event.arrived.0 >= *at
        {
            let center = [Point::new(0.0, 2.0, 0.0), Point::new(-2.0, 0.0, 0.0), Point::new(0.5, 0.0, 0.0)][n % 3];
            pipeline.configure(tumbled_core::CoreConfig {
                roi: RegionOfInterest { center, radius_m: 1.2 },
                ..rig::lidar_only()
            });
            next = due.next();
        }
        pipeline.step(event, &mut out);
        out.epochs.iter().for_each(|epoch| tally.see(epoch));
        all.health.append(&mut out.health);
        out.clear();
    }
    pipeline.finish(&mut out);
    out.epochs.iter().for_each(|epoch| tally.see(epoch));
    (pipeline, all)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, max_shrink_iters: 200, ..ProptestConfig::default() })]

    #[test]
    fn whatever_happens_each_point_is_in_one_epoch_or_counted_as_what_became_of_it(
        sensor in sensor(),
        faults in prop::collection::vec(fault(), 1..4),
        seed in any::<u64>(),
    ) {
        let (sources, configs) = session(packets(&sensor, 2_500 * MS), &faults, seed);
        let mut tally = Tally::of_a_short_session(Way::UDP);
        let (pipeline, out) = run(&ledger(&sources), &configs, &mut tally);
        let sensor = &pipeline.sensors()[0];
        prop_assert_eq!(tally.twice, 0);
        prop_assert_eq!(accounted(&sensor.points), sensor.points.decoded, "{:?}", sensor.points);
        // The last report tells of all of them: the ticks go on for more than two seconds. Only a packet that the decoder
        // held back to the end comes behind it, 12 firings at most; its scan may be the first that begins and be left out.
        let epochs = last(&out.health, LIDAR).epochs;
        let untold = sensor.points.in_epochs - tally.points - epochs.points_left_out;
        prop_assert!(untold <= 12 * LASERS.len() as u64, "{}: {:?}", untold, epochs);
        prop_assert_eq!(epochs.late, 0, "alone, none comes too late");
        let shed = faults.iter().any(|fault| matches!(fault, Fault::Skip(..)));
        prop_assert!(shed || sensor.points.shed == 0);
    }
}

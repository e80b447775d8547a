//! D2: however the sources' events lie among each other, the same bits.

use crate::support::chance::Chance;
use crate::support::devices::{Way, kinect, lidar, packets, serial, silent_between, vlp32c};
use crate::support::ledger::{MS, S, Source, anchors, ledger, record, shifted, ticks};
use crate::support::rig::{self, KINECT, LIDAR};
use crate::synth::Sensor;
use proptest::prelude::*;
use tumbled_core::{CoreConfig, LidarSetup, Timing, Workers};
use tumbled_model::{Body, LossPoint, SensorId, SourceState, Span};

/// What happens to one sensor in a session.
#[derive(Clone, Copy, Debug)]
enum Incident {
    Nothing,
    Never,
    /// Nothing is sent from 2.03 s on for so long.
    Silence(i64),
    /// The same, and its source says so.
    Lost(i64),
    /// What it sends from 2.03 s on for so long comes at the end of that time.
    Stall(i64),
    /// Packets are lost, repeated and swapped here and there.
    Rough,
    /// The host sheds so many scans, twice.
    Shed(u16),
    /// Its clock is set by so many µs, and it sends a little nonsense.
    Broken(i64),
}

const BEGIN: i64 = 2_030 * MS;

fn apply(source: &mut Source, id: &str, incident: Incident, seed: u64) {
    match incident {
        Incident::Nothing => {}
        Incident::Never => source.clear(),
        Incident::Silence(ns) => silent_between(source, BEGIN, BEGIN + ns),
        Incident::Lost(ns) => {
            silent_between(source, BEGIN, BEGIN + ns);
            let state = |state| Body::SensorState { sensor: SensorId::from(id), state };
            source.push((BEGIN + ns / 8, state(SourceState::Lost)));
            source.push((BEGIN + ns - 1, state(SourceState::Opened)));
            source.sort_by_key(|(arrived, _)| *arrived);
        }
        Incident::Stall(ns) => {
            for (arrived, _) in source.iter_mut().filter(|(arrived, _)| (BEGIN..BEGIN + ns).contains(arrived)) {
                *arrived = BEGIN + ns;
            }
        }
        Incident::Rough => roughen(source, id, seed),
        Incident::Shed(scans) => {
            let skip = Body::Skip { sensor: SensorId::from(id), scans };
            source.extend([(BEGIN, skip.clone()), (BEGIN + 700 * MS, skip)]);
            source.sort_by_key(|(arrived, _)| *arrived);
        }
        Incident::Broken(us) => break_clock(source, us),
    }
}

/// From 2.03 s on the stamps are others; and every 97th datum is cut short.
fn break_clock(source: &mut Source, us: i64) {
    for (n, (arrived, body)) in source.iter_mut().enumerate() {
        match body {
            Body::LidarPacket { bytes, .. } if *arrived >= BEGIN => {
                let mut set = bytes.to_vec();
                let stamp = u32::from_le_bytes(set[1_200..1_204].try_into().expect("four bytes"));
                let stamp = (i64::from(stamp) + us).rem_euclid(3_600_000_000) as u32;
                set[1_200..1_204].copy_from_slice(&stamp.to_le_bytes());
                *bytes = if n % 97 == 0 { set[..1_000].to_vec().into() } else { set.into() };
            }
            Body::DepthFrame { ticks: Some(ticks), bytes, .. } if *arrived >= BEGIN => {
                ticks.0 = ticks.0.wrapping_add((us * 60) as u32);
                if n % 97 == 0 {
                    *bytes = bytes.slice(..1_000);
                }
            }
            _ => {}
        }
    }
}

/// 1 % lost (every other time with the kernel's word on it), 1 % repeated, 1 % swapped with the next.
fn roughen(source: &mut Source, id: &str, seed: u64) {
    let mut chance = Chance::new(seed);
    let mut n = 1;
    while n + 1 < source.len() {
        if chance.happens(10_000) {
            let gap = Body::Gap { sensor: SensorId::from(id), lost: 1, place: LossPoint::Kernel };
            if chance.happens(500_000) {
                source[n].1 = gap;
            } else {
                source.remove(n);
            }
        } else if chance.happens(10_000) {
            source.insert(n, source[n].clone());
            n += 1;
        } else if chance.happens(10_000) {
            let (_, overtaken) = source.remove(n);
            source.insert(n + 1, (source[n].0, overtaken));
        }
        n += 1;
    }
}

fn incident() -> impl Strategy<Value = Incident> {
    let silences = prop_oneof![Just(200 * MS), Just(470 * MS), Just(S), Just(3 * S), Just(8 * S)];
    prop_oneof![
        2 => Just(Incident::Nothing),
        1 => Just(Incident::Never),
        3 => silences.clone().prop_map(Incident::Silence),
        1 => silences.prop_map(Incident::Lost),
        2 => (50i64..900).prop_map(|ms| Incident::Stall(ms * MS)),
        2 => Just(Incident::Rough),
        1 => (1u16..4).prop_map(Incident::Shed),
        2 => prop_oneof![-9_000_000i64..9_000_000, -400_000i64..400_000].prop_map(Incident::Broken),
    ]
}

fn sensor() -> impl Strategy<Value = Sensor> {
    // The whole turn; the cut in the silence; the middle in it; only half of the region.
    let views = prop_oneof![Just(None), Just(Some((40.0, 320.0))), Just(Some((350.0, 10.0))), Just(Some((0.0, 120.0)))];
    let rpm = prop_oneof![Just(600.0), Just(1_200.0), Just(300.0)];
    (views, rpm).prop_map(|(silent_deg, rpm)| Sensor { rpm, silent_deg, ..vlp32c() })
}

/// As long as what happens in it takes, and a second and a half more.
fn length(incidents: &[Incident]) -> i64 {
    let last = |incident: &Incident| match *incident {
        Incident::Silence(ns) | Incident::Lost(ns) | Incident::Stall(ns) => ns,
        _ => 0,
    };
    BEGIN + 1_500 * MS + incidents.iter().map(last).max().unwrap_or(0)
}

/// Another order of a session gives the same as that of the arrivals. Up to 100 ms earlier or later: two events change
/// places that arrived up to 200 ms apart.
fn assert_same(config: &CoreConfig, sources: &[Source], piece_ns: i64, seed: u64) -> Result<(), TestCaseError> {
    let straight = record(config.clone(), &ledger(sources), Workers::none(), true);
    prop_assert!(straight.health.len() >= 3);
    for order in 0..2 {
        let events = shifted(sources, 100 * MS - 1, piece_ns, seed ^ (100 + order));
        let difference = straight.difference(&record(config.clone(), &events, Workers::none(), true));
        prop_assert!(difference.is_none(), "{}", difference.unwrap_or_default());
    }
    Ok(())
}

fn front(sensor: &Sensor, until: i64, incident: Incident, seed: u64) -> Source {
    let mut source = lidar(&packets(sensor, until), Way { start_ns: 13 * MS, ..Way::UDP }, seed);
    apply(&mut source, LIDAR, incident, seed ^ 2);
    source
}

fn near(until: i64, incident: Incident, seed: u64) -> Source {
    let mut source = kinect(until, Way { start_ns: 5 * MS, ..Way::USB }, seed ^ 1);
    apply(&mut source, KINECT, incident, seed ^ 3);
    source
}

/// A LiDAR's events as another's.
fn renamed(source: Source, id: &str) -> Source {
    let rename = |body| match body {
        Body::LidarPacket { bytes, .. } => Body::LidarPacket { sensor: SensorId::from(id), bytes },
        Body::Gap { lost, place, .. } => Body::Gap { sensor: SensorId::from(id), lost, place },
        Body::Skip { scans, .. } => Body::Skip { sensor: SensorId::from(id), scans },
        Body::SensorState { state, .. } => Body::SensorState { sensor: SensorId::from(id), state },
        other => other,
    };
    source.into_iter().map(|(arrived, body)| (arrived, rename(body))).collect()
}

fn pieces() -> impl Strategy<Value = i64> {
    prop_oneof![Just(7 * MS), Just(60 * MS), Just(350 * MS)]
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 16, max_shrink_iters: 60, ..ProptestConfig::default() })]

    #[test]
    fn events_of_different_sources_may_lie_among_each_other_as_they_like(
        incidents in [incident(), incident()],
        sensor in sensor(),
        piece_ns in pieces(),
        seed in any::<u64>(),
    ) {
        let until = length(&incidents);
        let steps = [(2 * S, -3_600 * S)];
        let sources = [
            near(until, incidents[1], seed),
            front(&sensor, until, incidents[0], seed),
            serial(until),
            ticks(until + S),
            anchors(until + S, &steps),
        ];
        assert_same(&rig::whole(), &sources, piece_ns, seed)?;
    }

    #[test]
    fn so_may_those_of_three_sensors(
        incidents in [incident(), incident(), incident()],
        sensors in [sensor(), sensor()],
        silent_after in prop_oneof![Just(600 * MS), Just(2 * S)],
        hold in prop_oneof![Just(0), Just(150 * MS), Just(400 * MS)],
        piece_ns in pieces(),
        seed in any::<u64>(),
    ) {
        let until = length(&incidents);
        let mut config = rig::whole();
        config.timing = Timing { hold: Span(hold), silent_after: Span(silent_after), ..config.timing };
        config.lidars.push(LidarSetup { id: SensorId::from("rear"), ..config.lidars[0].clone() });
        let sources = [
            near(until, incidents[1], seed),
            front(&sensors[0], until, incidents[0], seed),
            renamed(front(&sensors[1], until, incidents[2], seed ^ 5), "rear"),
            ticks(until + S),
        ];
        assert_same(&config, &sources, piece_ns, seed)?;
    }
}

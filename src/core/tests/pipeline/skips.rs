//! Shed scans: whole ones, counted, and used all the same where that is asked for.

use crate::support::chance::Chance;
use crate::support::devices::{Way, kinect, lidar, packets, vlp32c};
use crate::support::faults::{lose, swap};
use crate::support::ledger::{MS, S, Source, ledger, record, run_with, ticks};
use crate::support::rig::{self, KINECT, LIDAR};
use crate::synth::Sensor;
use tumbled_core::{CoreConfig, Scan, ScanBoundaries, Workers};
use tumbled_model::{Body, SensorId};

fn skip(sensor: &str, scans: u16) -> Body {
    Body::Skip { sensor: SensorId::from(sensor), scans }
}

/// The views: all around; silent at the cut; with the cut just in front of, and right in, a packet with a jump.
const VIEWS: [Option<(f64, f64)>; 4] = [None, Some((40.0, 320.0)), Some((100.0, 200.0)), Some((46.0, 60.0))];

#[test]
fn a_shed_scan_is_counted_and_the_next_one_is_whole() {
    for silent_deg in VIEWS {
        let front = lidar(&packets(&Sensor { silent_deg, ..vlp32c() }, 3 * S), Way::UDP, 1);
        let skips = vec![(1_030 * MS, skip(LIDAR, 1)), (2_010 * MS, skip(LIDAR, 2))];
        let mut turns = Vec::new();
        let events = ledger(&[skips, front, ticks(4 * S)]);
        let (pipeline, out) = run_with(rig::lidar_only(), &events, |epoch| {
            let Scan::Lidar(scan) = &epoch.scan else { return };
            turns.push((epoch.t.0, scan.coverage, scan.points.len()));
        });
        let health = &pipeline.sensors()[0];
        assert_eq!(health.epochs.shed_scans, 3, "{silent_deg:?}");
        let whole = turns.iter().map(|(.., points)| *points).max().expect("turns") as i64;
        // A packet's 12 firings with the cut in them go with one of the two scans.
        let shed = health.points.shed as i64;
        assert!((shed - 3 * whole).abs() <= 3 * 12 * 3, "{silent_deg:?}: {shed} of scans of {whole}");
        // 30 passes in 3 s. A turn is cut at a firing and a scan at a packet, so that of the shed scans a few firings are
        // in epochs, without any of the region.
        let seen = turns.iter().filter(|(_, coverage, _)| *coverage >= 0.99).count();
        assert_eq!(seen, 30 - 3, "{silent_deg:?}: {turns:?}");
        assert!(
            turns.iter().all(|(_, coverage, _)| *coverage == 0.0 || *coverage >= 0.99),
            "{silent_deg:?}: {turns:?}"
        );
        let told = out.notices.iter().filter(|notice| notice.kind == tumbled_core::NoticeKind::Shedding).count();
        assert_eq!(told, 1, "it is told once");
    }
}

#[test]
fn shed_frames_are_no_epochs() {
    let skips = vec![(500 * MS, skip(KINECT, 3))];
    let (mut epochs, events) = (0, ledger(&[skips, kinect(S, Way::USB, 1), ticks(2 * S)]));
    let (pipeline, _) = run_with(rig::kinect_only(), &events, |_| epochs += 1);
    assert_eq!((epochs, pipeline.sensors()[0].epochs.shed_scans), (27, 3));
}

#[test]
fn skips_that_are_ignored_change_nothing() {
    let sources = || [kinect(2 * S, Way::USB, 2), lidar(&packets(&vlp32c(), 2 * S), Way::UDP, 1), ticks(3 * S)];
    let mut with = sources().to_vec();
    with.push(vec![(530 * MS, skip(LIDAR, 2)), (1_000 * MS, skip(KINECT, 5))]);
    let config = CoreConfig { ignore_skips: true, ..rig::whole() };
    let without = record(rig::whole(), &ledger(&sources()), Workers::none(), true);
    assert_eq!(without.difference(&record(config, &ledger(&with), Workers::none(), true)), None);
}

/// How many scans begin in a stream.
fn begins(front: &Source) -> usize {
    let mut boundaries = ScanBoundaries::new(&rig::lidar_only());
    front.iter().filter(|(_, body)| boundaries.begins(body)).count()
}

#[test]
fn a_scan_begins_once_a_turn_whatever_happens_to_packets() {
    let narrow = [Some((20.0, 10.0)), Some((60.0, 48.0))];
    for rpm in [600.0, 1_200.0] {
        // A view of 10° is four packets at 600 rpm; at 1200 rpm three may overtake a whole turn.
        let narrow = if rpm == 600.0 { &narrow[..] } else { &[] };
        for silent_deg in VIEWS.iter().chain(narrow).copied() {
            let clean = lidar(&packets(&Sensor { rpm, silent_deg, start_deg: 12.0, ..vlp32c() }, 3 * S), Way::UDP, 1);
            let turns = (rpm / 20.0) as usize; // in 3 s
            let expected = turns..=turns + 1; // the first packet begins one too
            assert!(expected.contains(&begins(&clean)), "{rpm} {silent_deg:?}: {}", begins(&clean));
            for seed in 0..5 {
                let (mut rough, mut chance) = (clean.clone(), Chance::new(seed));
                assert!(swap(&mut rough, 50_000, &mut chance) > 0);
                assert!(expected.contains(&begins(&rough)), "{rpm} {silent_deg:?} swapped: {}", begins(&rough));
                if !narrow.contains(&silent_deg) {
                    // Of a view of two packets a whole turn may be lost.
                    assert!(lose(&mut rough, 50_000, &mut chance) > 0);
                    assert!(expected.contains(&begins(&rough)), "{rpm} {silent_deg:?} lost: {}", begins(&rough));
                }
            }
        }
    }
}

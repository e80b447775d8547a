//! A turntable's line: angles with their times, and what they are worth.

use crate::support::devices::{asked, chunk, serial, silent_between};
use crate::support::ledger::{MS, S, Source, ledger, ticks};
use crate::support::rig::{TABLE, turntable_only};
use proptest::prelude::*;
use tumbled_core::health::SensorState;
use tumbled_core::turntable::{TruthState, TurntableHealth};
use tumbled_core::{
    CoreConfig, CoreHealth, NoticeKind, Outputs, Pipeline, TurntableProtocol, TurntableSample, TurntableSetup, Workers,
};
use tumbled_model::{Body, RigNs, SensorId, SourceState, Span};
use tumbled_serial::line_stream::StreamLine;
use tumbled_serial::zaber::{Setting, Warning};

struct Session {
    samples: Vec<TurntableSample>,
    notices: Vec<(i64, NoticeKind, String)>,
    health: Vec<CoreHealth>,
}

fn run(config: CoreConfig, sources: &[Source]) -> Session {
    let mut pipeline = Pipeline::new(config, Workers::none());
    let mut out = Outputs::default();
    let mut session = Session { samples: Vec::new(), notices: Vec::new(), health: Vec::new() };
    for event in ledger(sources) {
        out.clear();
        pipeline.step(&event, &mut out);
        session.samples.append(&mut out.turntable);
        session.notices.extend(out.notices.drain(..).map(|notice| (notice.t.0 / MS, notice.kind, notice.message)));
        session.health.append(&mut out.health);
    }
    session
}

impl Session {
    fn turntable(&self, second: usize) -> &TurntableHealth {
        self.health[second - 1].sensors[0].turntable.as_ref().expect("a turntable")
    }

    fn truths(&self) -> Vec<(i64, &str)> {
        let truths = self.notices.iter().filter(|(_, kind, _)| *kind == NoticeKind::Truth);
        truths.map(|(ms, _, message)| (*ms, message.as_str())).collect()
    }
}

#[test]
fn every_position_after_the_first_is_an_angle_in_the_middle_of_its_question_and_answer() {
    let session = run(turntable_only(), &[serial(3 * S), ticks(4 * S)]);
    assert_eq!(session.samples.len(), 59);
    for (n, sample) in (1..).zip(&session.samples) {
        // Asked at 50 n + 7 ms, answered 2 ms later.
        assert_eq!((sample.t, sample.half_rtt), (RigNs((50 * n + 8) * MS), Some(Span(MS))));
        assert!((sample.angle_rad.to_degrees() - n as f64).abs() < 1e-9, "{sample:?}");
        assert!((sample.rate_rps.to_degrees() - 20.0).abs() < 1e-9 && sample.is_truth);
        // 20 °/s · 1 ms / √3 = 0.011547°; the step of 0.01° / √12 = 0.002887°: together 0.011902°.
        assert!((sample.sigma_rad.to_degrees() - 0.011_902).abs() < 1e-6, "{}", sample.sigma_rad.to_degrees());
    }
    let table = session.turntable(2);
    assert_eq!((table.truth, table.samples_hz, table.half_rtt_ns), (TruthState::Valid, 20.0, Some(MS)));
    assert_eq!(session.turntable(3).samples, 59);
}

#[test]
fn questions_without_answers_are_stale_truth_half_a_second_after_the_last_answer() {
    let mut line = serial(4 * S);
    // The questions go on: every other event of the line is one.
    let mut n = 0;
    line.retain(|(arrived, _)| {
        n += 1;
        *arrived < 2 * S || n % 2 == 1
    });
    let session = run(turntable_only(), &[line, ticks(5 * S)]);
    let stale: Vec<_> = session.notices.iter().filter(|(_, _, message)| message.contains("stale")).collect();
    // The last answer is at 1.959 s; 0.3 s later, at the next tenth.
    assert_eq!(stale.iter().map(|(ms, ..)| *ms).collect::<Vec<_>>(), [2_299]);
    let third = &session.health[2].sensors[0];
    assert_eq!((third.state, session.turntable(3).truth), (SensorState::Stale, TruthState::Stale));
}

#[test]
fn a_stall_makes_the_angle_untrue_from_the_last_reading_before_it_and_says_so_once() {
    let position = |n: i64| {
        let flag = if (40..60).contains(&n) { Warning::STALLED } else { Warning::NONE };
        asked(n, n * 50 * MS + 7 * MS, Setting::EncoderPos, flag, 100 * n)
    };
    let first = asked(-1, 0, Setting::LimitCycleDist, Warning::NONE, 36_000);
    let line: Source = first.into_iter().chain((0..80).flat_map(position)).collect();
    let session = run(turntable_only(), &[line, ticks(5 * S)]);
    let untrue: Vec<i64> = session.samples.iter().filter(|sample| !sample.is_truth).map(|s| s.t.0 / MS).collect();
    assert_eq!(untrue, (40..60).map(|n| 50 * n + 8).collect::<Vec<_>>());
    let truths = session.truths();
    assert_eq!(truths.iter().map(|(ms, _)| *ms).collect::<Vec<_>>(), [2_009, 3_009]);
    assert_eq!(truths[0].1, "the angle of table is no truth from 1.958 s on: the stage reports FS (stalled)");
    assert_eq!(truths[1].1, "the angle of table is truth again");
    let third = session.turntable(3);
    assert_eq!((third.truth, third.invalid_since_ns), (TruthState::Invalid, Some(1_958 * MS)));
    assert_eq!(session.turntable(4).truth, TruthState::Valid);
}

#[test]
fn a_slip_makes_it_untrue_from_the_last_check_before_it_until_the_stage_is_where_it_should_be() {
    let mut line = serial(6 * S);
    // Checked every half second; 1° behind from 2 s to 4 s: 100 counts.
    for n in 0..12 {
        let at = 500 * n * MS + 25 * MS;
        let error = if (2 * S..4 * S).contains(&at) { 100 } else { 3 };
        line.extend(asked(50 + n, at, Setting::EncoderPosError, Warning::NONE, error));
    }
    line.sort_by_key(|(arrived, _)| *arrived);
    let session = run(turntable_only(), &[line, ticks(7 * S)]);
    let truths = session.truths();
    // The second check without agreement is that of 2.525 s, answered 2 ms later; they agreed last at 1.527 s.
    assert_eq!(truths.iter().map(|(ms, _)| *ms).collect::<Vec<_>>(), [2_527, 4_027]);
    assert!(truths[0].1.contains("from 1.527 s on") && truths[0].1.contains("slipped"), "{truths:?}");
    assert!(session.health[3].reasons.iter().any(|reason| reason.key == "truth"), "{:?}", session.health[3].reasons);
    assert_eq!(session.turntable(6).truth, TruthState::Valid);
}

#[test]
fn a_port_that_was_lost_is_absent_at_the_next_tenth_and_its_angle_stale() {
    let mut line = serial(4 * S);
    silent_between(&mut line, 2 * S, 3 * S);
    let state = |state| Body::SensorState { sensor: SensorId::from(TABLE), state };
    line.extend([(2_010 * MS, state(SourceState::Lost)), (3_003 * MS, state(SourceState::Opened))]);
    line.sort_by_key(|(arrived, _)| *arrived);
    let session = run(turntable_only(), &[line, ticks(5 * S)]);
    let states = session.notices.iter().filter(|(_, kind, _)| *kind == NoticeKind::SensorState);
    let states: Vec<(i64, &str)> = states.map(|(ms, _, message)| (*ms + 1, message.as_str())).collect();
    assert_eq!(states[1..3], [(2_100, "table is absent (was live)"), (3_100, "table is live (was absent)")]);
    // Its first reading begins anew: one sample less than there are readings after it.
    let after = session.samples.iter().filter(|sample| sample.t > RigNs(3 * S)).count();
    assert_eq!(after, 19);
}

#[test]
fn nothing_readable_is_a_fault() {
    let line: Source = (0..80).map(|n| (n * 50 * MS + 3 * MS, chunk(b"\xFEgarbage\r\n".to_vec()))).collect();
    let opened = (0, Body::SensorState { sensor: SensorId::from(TABLE), state: SourceState::Opened });
    let session = run(turntable_only(), &[vec![opened], line, ticks(5 * S)]);
    let second = &session.health[1].sensors[0];
    assert_eq!((second.state, second.malformed.get("not_text")), (SensorState::Fault, Some(&40)));
    assert!(session.samples.is_empty());
}

/// A line stream of 4096 counts a turn, 100 lines a second, 0.2 ms late.
fn stream(until_ns: i64, header: bool) -> Source {
    let begun = StreamLine::Header { counts_per_turn: 4_096, firmware: "rig-encoder 2".to_owned() };
    let reading = |n: i64| {
        let line = StreamLine::Reading { seq: n as u32, device_us: (7_000_000 + n * 10_000) as u32, count: n as i32 };
        (n * 10 * MS + MS / 5, chunk(line.encode()))
    };
    let header = header.then(|| (0, chunk(begun.encode())));
    header.into_iter().chain((0..until_ns / (10 * MS)).map(reading)).collect()
}

fn line_stream(counts_per_turn: Option<u32>) -> CoreConfig {
    let setup = TurntableSetup {
        protocol: TurntableProtocol::Line,
        counts_per_turn,
        ..turntable_only().turntables.swap_remove(0)
    };
    CoreConfig { turntables: vec![setup], ..turntable_only() }
}

#[test]
fn a_line_streams_angles_are_of_the_devices_own_clock() {
    let session = run(line_stream(None), &[stream(5 * S, true), ticks(6 * S)]);
    assert_eq!(session.samples.len(), 499);
    for sample in session.samples.iter().skip(250) {
        let n = (sample.angle_rad / core::f64::consts::TAU * 4_096.0).round() as i64;
        // The least delay is the clock's offset.
        assert!((sample.t.0 - (n * 10 * MS + MS / 5)).abs() < 50_000, "{sample:?}");
        assert_eq!((sample.half_rtt, sample.is_truth), (None, true));
    }
    let table = session.turntable(4);
    assert_eq!((table.device.as_deref(), table.samples_hz), (Some("rig-encoder 2"), 100.0));
    assert!(session.health[3].sensors[0].clock.is_some());
}

#[test]
fn a_stream_that_was_joined_late_has_angles_by_the_configs_counts_alone() {
    let without = run(line_stream(None), &[stream(4 * S, false), ticks(5 * S)]);
    assert!(without.samples.is_empty());
    assert!(without.health[2].reasons.iter().any(|reason| reason.message.contains("turntable.counts_per_turn")));
    let with = run(line_stream(Some(4_096)), &[stream(4 * S, false), ticks(5 * S)]);
    assert_eq!(with.samples.len(), 399);
}

proptest! {
    #[test]
    fn arbitrary_bytes_on_the_line_give_no_angle(
        chunks in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..60), 0..60), line: bool,
    ) {
        let config = if line { line_stream(Some(4_096)) } else { turntable_only() };
        let noise: Source = (0..).zip(chunks).map(|(n, bytes)| (n * MS, chunk(bytes))).collect();
        let session = run(config, &[noise, ticks(S)]);
        prop_assert!(session.samples.is_empty());
    }
}

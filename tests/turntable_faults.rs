//! What goes wrong with a turntable and its line: fault cases 14, 15 and 16, on a pseudo terminal in real time.

use std::time::Duration;

use tumbled_core::NoticeKind;
use tumbled_core::health::SensorState;
use tumbled_core::turntable::TruthState;
use tumbled_io::live::SessionClock;
use tumbled_model::{RigNs, Span};
use tumbled_sim::turntable::{Mishaps, StageFault};

use crate::support::Workbench;
use crate::support::stage::{Known, Manners, Port, Session, error_and_doubt_deg, turning};

const S: i64 = 1_000_000_000;
const HALF_A_SECOND: Span = Span(S / 2);

#[test]
fn a_turning_stage_is_where_it_says_within_half_its_round_trip() {
    let (bench, clock) = (Workbench::new(), SessionClock::start_on_system());
    let stage = turning(20.0, vec![]);
    let mut port = Port::new(bench.path("turntable"), stage.clone(), &clock);
    port.plug(Manners::default());
    let session = Session::start(&bench.path("turntable"), &clock);
    session.wait_for("two hundred angles", |known| (known.samples.len() >= 200).then_some(()));
    let (_, known) = session.end();
    let mut errors: Vec<f64> = Vec::new();
    for sample in &known.samples {
        let (error, doubt) = error_and_doubt_deg(sample, &stage);
        assert!(error <= doubt, "{error}° off, {doubt}° of doubt: {sample:?}");
        assert!(sample.is_truth && sample.moving == Some(true), "{sample:?}");
        errors.push(error);
    }
    errors.sort_by(f64::total_cmp);
    let half_rtt_ms = known.samples.last().and_then(|sample| sample.half_rtt).expect("polled").as_secs_f64() * 1e3;
    println!(
        "{} angles at 20°/s: {:.4}° off in the median, {:.4}° at most; half round trip {half_rtt_ms:.2} ms",
        errors.len(),
        errors[errors.len() / 2],
        errors[errors.len() - 1]
    );
}

#[test]
fn case_14_damaged_split_late_and_strange_replies_are_counted_and_no_angle_is_made_of_them() {
    let (bench, clock) = (Workbench::new(), SessionClock::start_on_system());
    let stage = turning(20.0, vec![]);
    let mut port = Port::new(bench.path("turntable"), stage.clone(), &clock);
    // Three replies in ten have one of six mishaps; all come in two reads. Which ones is decided by the reply's number.
    let mishaps = Mishaps { chance: 0.3, seed: 14 };
    let session = Session::start(&bench.path("turntable"), &clock);
    port.plug(Manners { mishaps, split: Some(Duration::from_millis(1)), ..Manners::default() });
    session.wait_for("two hundred and fifty angles", |known| (known.samples.len() >= 250).then_some(()));
    session.wait_for("their counts", |known| {
        known.turntable().is_some_and(|turntable| turntable.samples >= 250).then_some(())
    });
    let (_, known) = session.end();
    for sample in &known.samples {
        let (error, doubt) = error_and_doubt_deg(sample, &stage);
        assert!(error <= doubt, "{error}° off, {doubt}° of doubt: {sample:?}");
    }
    let sensor = known.sensor().expect("the turntable");
    let (malformed, refused) = (&sensor.malformed, &known.turntable().expect("a turntable").refused);
    for (counts, key) in
        [(malformed, "bad_checksum"), (malformed, "not_text"), (refused, "late"), (refused, "wrong_id")]
    {
        assert!(counts.get(key).is_some_and(|n| *n > 0), "{key}: {malformed:?} {refused:?}");
    }
    // A reading is missed for 0.1 s at most, and never ten in a row.
    assert!(known.told(NoticeKind::SensorState, "absent (was live)", RigNs(0)).is_none(), "{:?}", known.notices);
    println!("{} angles; refused {malformed:?} {refused:?}", known.samples.len());
}

#[test]
fn case_15_a_port_that_is_pulled_out_is_stale_truth_in_half_a_second_and_read_again_five_seconds_after_it_is_back() {
    let (bench, clock) = (Workbench::new(), SessionClock::start_on_system());
    let stage = turning(20.0, vec![]);
    let mut port = Port::new(bench.path("turntable"), stage.clone(), &clock);
    let session = Session::start(&bench.path("turntable"), &clock);
    port.plug(Manners::default());
    session.more_samples(50);

    let out = port.unplug();
    let (told, _) = session.wait_for("its absence", |known| {
        known.told(NoticeKind::SensorState, "turntable is absent", out).map(|(t, text)| (t, text.to_owned()))
    });
    assert!(told - out <= HALF_A_SECOND, "{told:?} for {out:?}");
    session.wait_for("stale truth", |known| (known.truth() == Some(TruthState::Stale)).then_some(()));

    // Tried again every half second, second, two seconds: not all the time.
    let (before, began) = (session.source_cpu(), clock.now().rig);
    std::thread::sleep(Duration::from_secs(4));
    let (busy, away) = (session.source_cpu() - before, clock.now().rig - began);
    assert!(busy.as_secs_f64() < 0.02 * away.as_secs_f64(), "{busy:?} of processor time in {away:?}");

    port.plug(Manners::default());
    let back = clock.now().rig;
    let first = session.wait_for("its first angle", |known| {
        known.samples.iter().find(|sample| sample.t > back).map(|sample| sample.t)
    });
    assert!(first - back <= Span(5 * S), "{first:?} for {back:?}");
    session.wait_for("truth again", |known| (known.truth() == Some(TruthState::Valid)).then_some(()));
    let (_, known) = session.end();
    for sample in known.samples.iter() {
        let (error, doubt) = error_and_doubt_deg(sample, &stage);
        assert!(error <= doubt, "{error}° off, {doubt}° of doubt: {sample:?}");
    }
    println!(
        "absent after {:.2} s, read again after {:.2} s, {busy:?} of processor time in {:.1} s away",
        (told - out).as_secs_f64(),
        (first - back).as_secs_f64(),
        away.as_secs_f64()
    );
}

#[test]
fn case_15_a_stage_that_falls_mute_is_stale_truth_in_half_a_second_and_keeps_no_processor_and_no_stop() {
    let (bench, clock) = (Workbench::new(), SessionClock::start_on_system());
    let mut port = Port::new(bench.path("turntable"), turning(20.0, vec![]), &clock);
    // Three of the finding, six of the opening: some forty angles.
    port.plug(Manners { mute_after: Some(50), ..Manners::default() });
    let session = Session::start(&bench.path("turntable"), &clock);
    let told = session.wait_for("its silence", |known| {
        known.told(NoticeKind::SensorState, "turntable is stale", RigNs(0)).map(|(t, _)| t)
    });
    let last = session.now_known().samples.last().expect("an angle").t;
    assert!(told - last <= HALF_A_SECOND, "{told:?} for {last:?}");
    // Ten unanswered questions, then nobody is found: absent.
    session
        .wait_for("its absence", |known| known.told(NoticeKind::SensorState, "absent (was stale)", last).map(|_| ()));
    busy_and_stop(session, &clock, "mute", 0.05);
}

#[test]
fn case_15_a_line_full_of_noise_keeps_no_processor_and_no_stop() {
    let (bench, clock) = (Workbench::new(), SessionClock::start_on_system());
    let mut port = Port::new(bench.path("turntable"), turning(20.0, vec![]), &clock);
    port.plug(Manners { babbles: true, ..Manners::default() });
    let session = Session::start(&bench.path("turntable"), &clock);
    std::thread::sleep(Duration::from_secs(1));
    let known = busy_and_stop(session, &clock, "babbling", 0.2);
    assert!(known.samples.is_empty());
}

/// The share of a processor that the source takes in three seconds is below `most`, and it ends at once.
fn busy_and_stop(session: Session, clock: &SessionClock, what: &str, most: f64) -> Known {
    let (before, began) = (session.source_cpu(), clock.now().rig);
    std::thread::sleep(Duration::from_secs(3));
    let (busy, time) = (session.source_cpu() - before, clock.now().rig - began);
    assert!(busy.as_secs_f64() < most * time.as_secs_f64(), "{what}: {busy:?} of processor time in {time:?}");
    let (stop, known) = session.end();
    assert!(stop < Duration::from_secs(1), "{what}: it ends within a look, not after {stop:?}");
    println!("{what}: {busy:?} of processor time in {:.1} s; stopped after {stop:?}", time.as_secs_f64());
    known
}

#[test]
fn case_16_a_stall_is_no_truth_from_its_beginning_and_says_so_within_half_a_second() {
    let (bench, clock) = (Workbench::new(), SessionClock::start_on_system());
    let (from, until) = (RigNs(4 * S), RigNs(6 * S));
    let stage = turning(20.0, vec![StageFault::Stall { from, until }]);
    let mut port = Port::new(bench.path("turntable"), stage.clone(), &clock);
    port.plug(Manners::default());
    let session = Session::start(&bench.path("turntable"), &clock);
    let (told, text) = session.wait_for("the stall", |known| {
        known.told(NoticeKind::Truth, "FS", RigNs(0)).map(|(t, text)| (t, text.to_owned()))
    });
    assert!(told >= from && told - from <= HALF_A_SECOND, "{told:?}: {text}");
    let since = session.wait_for("it in health", |known| {
        let turntable = known.turntable().filter(|turntable| turntable.truth == TruthState::Invalid)?;
        turntable.invalid_since_ns
    });
    // Since the last reading without the flag.
    assert!(since <= from.0 && since > from.0 - HALF_A_SECOND.0, "{since}");
    session.wait_for("readings after it", |known| {
        known.samples.iter().any(|sample| sample.t > until + Span(S)).then_some(())
    });
    let (_, known) = session.end();
    let during: Vec<_> = known.samples.iter().filter(|sample| sample.t > from && sample.t < until).collect();
    assert!(!during.is_empty() && during.iter().all(|sample| !sample.is_truth));
    // The drive went on meanwhile: encoder and drive are 40° apart from then on.
    assert_eq!(known.sensor().map(|sensor| sensor.state), Some(SensorState::Live));
    assert!(known.samples.last().is_some_and(|sample| !sample.is_truth), "{:?}", known.samples.last());
    println!("told {:.3} s after the stall began: {text}", (told - from).as_secs_f64());
}

#[test]
fn case_16_a_slip_without_any_flag_shows_in_the_drives_own_error() {
    let (bench, clock) = (Workbench::new(), SessionClock::start_on_system());
    let at = RigNs(4 * S);
    let stage = turning(20.0, vec![StageFault::Slip { at, angle_rad: 3.0_f64.to_radians() }]);
    let mut port = Port::new(bench.path("turntable"), stage.clone(), &clock);
    port.plug(Manners::default());
    let session = Session::start(&bench.path("turntable"), &clock);
    let (told, text) = session.wait_for("the slip", |known| {
        known.told(NoticeKind::Truth, "slipped", RigNs(0)).map(|(t, text)| (t, text.to_owned()))
    });
    // Two checks, half a second apart, the first of them up to half a second after it.
    assert!(told >= at && told - at <= Span(3 * S / 2), "{told:?}: {text}");
    let since = session.wait_for("it in health", |known| {
        let turntable = known.turntable().filter(|turntable| turntable.truth == TruthState::Invalid)?;
        turntable.invalid_since_ns
    });
    assert!(since <= at.0 && since > at.0 - S, "since the last check without it: {since}");
    let (_, known) = session.end();
    let before = known.samples.iter().filter(|sample| sample.t.0 < since);
    assert!(before.into_iter().all(|sample| sample.is_truth));
    let after: Vec<_> = known.samples.iter().filter(|sample| sample.t > told).collect();
    assert!(!after.is_empty() && after.iter().all(|sample| !sample.is_truth));
    println!("told {:.3} s after the slip: {text}", (told - at).as_secs_f64());
}

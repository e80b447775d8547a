//! Counters that wrap, restart or are set, and a host whose wall clock is: cases 7 to 10.

use tumbled::cli::replay::ReplayReport;
use tumbled_core::{ClockState, NoticeKind};
use tumbled_model::{Body, Event, LidarTime, RigNs, Span, UnixNs, nmea};
use tumbled_velodyne::encode::position_packet;
use tumbled_velodyne::position::Pps;

use super::session::{MS, Played, S, both, play, seconds};
use crate::support::Workbench;
use crate::support::pcap::START_UNIX_S;
use crate::support::rig::{TURN_NS, lidar_core};

/// How much the times from one whole epoch of a sensor to its next differ from its period, or from several, at most, in a
/// stretch of time.
fn unevenness(played: &Played, lidar: bool, period: i64, from: i64, to: i64) -> i64 {
    let whole = played.of(lidar).into_iter().filter(|epoch| epoch.whole && (from..to).contains(&epoch.t));
    let times: Vec<i64> = whole.map(|epoch| epoch.t).collect();
    assert!(times.len() as i64 * 10 >= (to - from) / period * 9, "{} epochs", times.len());
    let off = |pair: &[i64]| (pair[1] - pair[0] + period / 2).rem_euclid(period) - period / 2;
    times.windows(2).map(|pair| off(pair).abs()).max().unwrap_or_default()
}

#[test]
fn case_07_the_end_of_the_hour_and_the_wrap_of_32_bits_move_no_time() {
    // The LiDAR's hour ends 2 s after the rig's start, the camera's counter wraps after 3 s.
    let played = play(seconds(7, true, true), "", both());
    let lidar = unevenness(&played, true, TURN_NS, 300 * MS, 6_500 * MS);
    let camera = unevenness(&played, false, S / 30, 300 * MS, 6_500 * MS);
    println!("case 7: at most {lidar} ns and {camera} ns off a period");
    assert!(lidar < MS && camera < MS, "{lidar} {camera}");
    assert!(played.notices.iter().all(|notice| notice.kind != NoticeKind::ClockReset));
}

#[test]
fn case_08_a_lidar_that_restarts_is_one_reset_and_right_again_two_seconds_after_its_return() {
    // Silent for 3.037 s: it comes back with its counter at 1 s and its head where that does not fit.
    let reboot = "[[fault]]\nsensor = \"front\"\nfrom_s = 6.0\naction.reboot.silent_s = 3.037\n";
    let played = play(seconds(14, true, true), reboot, both());
    let resets = played.told("front", NoticeKind::ClockReset);
    assert_eq!(resets.len(), 1, "{resets:?}");
    let clock = played.sensor("front").clock.expect("a clock");
    assert_eq!((clock.resets, clock.state), (1, ClockState::Locked));
    // The head passes the middle at the same part of each tenth of a second, before and after.
    let part = |from: i64, to: i64| -> Vec<i64> {
        let times = played.of(true).into_iter().map(|epoch| epoch.t);
        times.filter(|t| (from..to).contains(t)).map(|t| t.rem_euclid(TURN_NS)).collect()
    };
    let (before, after) = (part(4 * S, 6 * S), part(11_037 * MS, 14 * S));
    assert!(before.len() >= 19 && after.len() >= 28, "{} {}", before.len(), after.len());
    let moved = after.iter().map(|t| (t - before[0]).abs()).max().unwrap_or_default();
    println!("case 8: from 2 s after its return on, times are off by at most {} us", moved / 1_000);
    assert!(moved < MS, "{moved} ns");
    assert!(played.between(true, 9_037 * MS, 11_037 * MS) >= 12, "the arrivals' times serve meanwhile");
    assert_eq!(played.between(false, 6 * S, 9 * S), 90, "the camera goes on");
    played.assert_in_order();
}

/// Faults of the LiDAR's packets, position packets included, from 7 s to 10 s.
fn spoilt(actions: &[&str]) -> String {
    let fault =
        |action: &&str| format!("[[fault]]\nsensor = \"front\"\nfrom_s = 7.0\nuntil_s = 10.0\naction.{action}\n");
    actions.iter().map(fault).collect()
}

#[test]
fn case_08_broken_and_forged_packets_are_no_restart() {
    let calm = play(with_pulse(11), "", lidar_core());
    let forged = [
        "spoof = { probability = 0.05, payload = \"noise\" }",
        "spoof = { probability = 0.05, payload = \"other_sensor\" }",
    ];
    let forged = play(with_pulse(11), &spoilt(&forged), lidar_core());
    let broken = play(with_pulse(11), &spoilt(&["corrupt = { probability = 0.1, bytes = 4 }"]), lidar_core());
    let (added, changed) = (forged.done("front").spoofed, broken.done("front").corrupted);
    // Of 4521 packets, and 30 position packets: 455 in each.
    assert!((350..550).contains(&added) && (350..550).contains(&changed), "{added} {changed}");
    for played in [&calm, &forged, &broken] {
        let resets = played.told("front", NoticeKind::ClockReset);
        assert_eq!(resets.len(), 1, "the pulse's own, at 3 s: {resets:?}");
        assert_eq!(played.sensor("front").clock.map(|clock| clock.state), Some(ClockState::Locked));
    }
    assert!(forged.sensor("front").clock.is_some_and(|clock| clock.doubtful > 150));
    // Forged packets end no turn: the epochs are those of the calm run.
    let times = |played: &Played| played.epochs.iter().map(|epoch| epoch.t).collect::<Vec<_>>();
    let (calm, forged) = (times(&calm), times(&forged));
    assert_eq!(calm.len(), forged.len());
    let moved = calm.iter().zip(&forged).map(|(a, b)| (a - b).abs()).max().unwrap_or_default();
    println!("case 8: {added} forged packets move times by at most {moved} ns, {changed} broken ones reset nothing");
    assert!(moved < MS, "{moved} ns");
}

#[test]
#[ignore = "100 s of a scene: .ci/long runs it"]
fn case_08_the_scene_in_which_everything_goes_wrong_has_one_silence_and_one_restart() {
    let done = Workbench::new().run(&["replay", "sim:faults", "--json"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let report: ReplayReport = done.json();
    let front = report.sensors.iter().find(|sensor| sensor.id == "front").expect("the LiDAR");
    // 5 s without a packet begin the clock anew, and so does its restart.
    assert_eq!(front.clock.map(|clock| (clock.resets, clock.state)), Some((2, ClockState::Locked)));
    let kinds: Vec<&str> = front.malformed.keys().map(String::as_str).collect();
    assert_eq!(kinds, ["azimuth", "block_flag", "sentence"], "{:?}", front.malformed_first);
}

/// The rig's LiDAR with position packets, ten a second: the pulse is locked from 3 s to 12 s.
fn with_pulse(until_s: i64) -> impl Iterator<Item = Event> {
    let position = |event: &Event| {
        let t = event.arrived.0;
        // The first stamp is 59:58 past the hour; the wall clock of the rig is right.
        let stamp = LidarTime(((3_598_000_000 + t / 1_000) % 3_600_000_000) as u32);
        let utc = UnixNs((3_598 + START_UNIX_S / 3_600 * 3_600 + t / S) * S);
        let (pps, sentence) = match t {
            _ if (3 * S..12 * S).contains(&t) => (Pps::Locked, nmea::format_rmc(utc, true)),
            _ => (Pps::Absent, String::new()),
        };
        let bytes = position_packet(stamp, pps, &sentence).to_vec().into();
        Event { seq: 0, arrived: RigNs(t), body: Body::LidarPacket { sensor: "front".into(), bytes } }
    };
    let and_position = move |event: Event| {
        let position = matches!(event.body, Body::Tick).then(|| position(&event));
        [Some(event), position].into_iter().flatten()
    };
    let events = seconds(until_s, true, false).flat_map(and_position);
    events.zip(0..).map(|(event, seq)| Event { seq, ..event })
}

#[test]
fn case_09_a_pulse_that_comes_and_goes_is_told_and_utc_is_there_while_it_can_be_trusted() {
    let played = play(with_pulse(16), "", lidar_core());
    let utc_at = |second: i64| {
        let health = played.health.iter().find(|health| health.t_ns == second * S).expect("a report a second");
        let lidar = health.sensors[0].lidar.clone().expect("a LiDAR");
        (lidar.utc, lidar.utc_ns)
    };
    // Locked for 5 s first; gone with the lock.
    for second in [1, 2, 4, 6, 7, 13, 14, 15] {
        assert_eq!(utc_at(second).1, None, "at {second} s");
    }
    for second in [9, 10, 11] {
        let (state, utc) = utc_at(second);
        let utc: i64 = utc.unwrap_or_else(|| panic!("UTC at {second} s: {state}")).parse().expect("a number");
        let truth = (3_598 + START_UNIX_S / 3_600 * 3_600 + second) * S;
        // Early by the least delay of a packet, 0.7 ms.
        assert!((truth - utc).abs() < MS, "{} ns at {second} s", truth - utc);
        assert_eq!(state, "PPS locked");
    }
    assert_eq!(utc_at(2).0, "free-running");
    assert_eq!(utc_at(14).0, "free-running");
    // Each change begins the clock anew, and is told; no time moves by it, as the counter was not moved.
    assert_eq!(played.told("front", NoticeKind::ClockReset).len(), 2);
    assert!(unevenness(&played, true, TURN_NS, 300 * MS, 15 * S) < MS);
    played.assert_in_order();
}

/// The wall clock's anchors as a wall clock would have them that was changed by so much at each time.
fn with_wall(change: impl Fn(i64) -> i64) -> impl Iterator<Item = Event> {
    seconds(8, true, true).map(move |event| match event.body {
        Body::Anchor { unix } => {
            let body = Body::Anchor { unix: unix + Span(change(event.arrived.0)) };
            Event { body, ..event }
        }
        _ => event,
    })
}

#[test]
fn case_10_a_wall_clock_that_is_set_by_an_hour_or_runs_fast_changes_no_time_no_order_and_no_point() {
    let calm = play(with_wall(|_| 0), "", both());
    let hour = 3_600 * S;
    let step = |by: i64| move |t: i64| if t >= 4 * S { by } else { 0 };
    for (set, steps) in [
        (play(with_wall(step(hour)), "", both()), 1),
        (play(with_wall(step(-hour)), "", both()), 1),
        // 500 ppm, as fast as clocks are slewed: half a millisecond from anchor to anchor.
        (play(with_wall(|t| t / 2_000), "", both()), 0),
    ] {
        assert_eq!(set.epochs, calm.epochs);
        let told = set.notices.iter().filter(|notice| notice.kind == NoticeKind::WallStep).count();
        assert_eq!((told, set.notices.len()), (steps, calm.notices.len() + steps));
        assert_eq!(set.health.last().map(|health| health.wall.steps), Some(steps as u64));
        assert_eq!(set.sensors, calm.sensors);
    }
}

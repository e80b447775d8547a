//! The emulated stage against the codec: the angle in the bytes is the stage's angle, to a count.

use core::f64::consts::TAU;
use proptest::prelude::*;
use std::sync::Arc;
use tumbled_model::{RigNs, Span};
use tumbled_serial::log::{LogEntry, Side};
use tumbled_serial::zaber::{
    Address, Checksums, Command, Heard, LineSettings, Listener, Message, MessageId, Parser, PollSettings, Rejection,
    Reply, Request, Sample, Scale, Setting, Switch, Warning,
};
use tumbled_sim::motion::profile::Profile;
use tumbled_sim::motion::turntable::Turntable;
use tumbled_sim::turntable::{
    CommandedStage, Conversation, EmulatorSettings, Latency, LineLogSettings, Mishaps, ScriptedStage, Stage,
    StageFault, StageMotion, StageState, ZaberEmulator,
};

const DEG: f64 = TAU / 360.0;

fn s(seconds: f64) -> RigNs {
    RigNs((1e9 * seconds) as i64)
}

/// 20 °/s from 10° on.
fn steady() -> StageMotion {
    Arc::new(|t| StageState { angle_rad: (10.0 + 20.0 * 1e-9 * t.0 as f64) * DEG, rate_rps: 20.0 * DEG })
}

fn scripted(motion: StageMotion, faults: Vec<StageFault>) -> Stage {
    Stage::Scripted(ScriptedStage::new(motion, faults))
}

fn settings() -> EmulatorSettings {
    EmulatorSettings::usual(1)
}

fn session(seconds: f64) -> LineLogSettings {
    let each_way = Span::from_micros(600);
    LineLogSettings {
        from: s(0.0),
        until: s(seconds),
        poll: PollSettings::default(),
        quickest: Latency { to_sample: each_way, to_reply: each_way },
        jitter: Span(0),
        mishaps: Mishaps::default(),
        reads: None,
        seed: 1,
    }
}

fn log(stage: Stage, emulator: EmulatorSettings, settings: &LineLogSettings) -> Vec<LogEntry> {
    Conversation::new(ZaberEmulator::new(emulator, stage), *settings).collect()
}

/// What a listener makes of a log that went through its text.
fn listen(entries: &[LogEntry]) -> (Vec<Sample>, Listener) {
    let mut listener = Listener::new(LineSettings::default());
    let mut heard = Vec::new();
    for entry in entries {
        let entry = LogEntry::parse(&entry.to_string()).expect("a line of the log");
        listener.overheard(entry.at, &entry.bytes, &mut heard);
    }
    let sample = |heard| if let Heard::Sample(sample) = heard { Some(sample) } else { None };
    (heard.into_iter().filter_map(sample).collect(), listener)
}

#[test]
fn the_angle_in_the_bytes_is_the_stages_angle_to_a_count() {
    let scale = settings().scale;
    let entries = log(scripted(steady(), vec![]), settings(), &session(20.0));
    let (samples, listener) = listen(&entries);
    // 50 a second; the opening takes the first six answers.
    assert!((990..=1_000).contains(&samples.len()), "{}", samples.len());
    assert_eq!(listener.counts().lines.refused(), 0);
    for sample in samples {
        let true_counts = scale.counts(steady()(sample.at).angle_rad);
        assert!((sample.counts - true_counts).abs() <= 1, "{sample:?}: {true_counts}");
        assert!(sample.moving && sample.trusted());
        // 600 µs each way and the first byte's 86.805 µs.
        assert_eq!(sample.half_rtt, Span((1_200_000 + 86_805) / 2));
    }
}

#[test]
fn every_profile_of_a_turntable_is_in_the_bytes_to_a_count() {
    let (rate, ramp) = (20.0 * DEG, Span::from_micros(500_000));
    let profiles = [
        Profile::Constant { rate_rps: -rate },
        Profile::Ramp { from_rps: 0.0, to_rps: rate, begins: s(2.0), lasts: Span::from_micros(8_000_000) },
        Profile::StopAndGo {
            rate_rps: rate,
            stop: Span::from_micros(1_500_000),
            go: Span::from_micros(3_000_000),
            ramp,
        },
        Profile::Steps {
            step_rad: 22.5 * DEG,
            rest: Span::from_micros(700_000),
            moving: Span::from_micros(1_800_000),
            ramp,
            count: 16,
        },
        Profile::Sinusoid { mean_rps: 0.1 * rate, amplitude_rad: 30.0 * DEG, period: Span::from_micros(9_000_000) },
    ];
    for profile in profiles {
        let table = Turntable {
            axis: nalgebra::Vector3::z_axis(),
            centre: nalgebra::Point3::origin(),
            mount: nalgebra::Isometry3::identity(),
            start_rad: 10.0 * DEG,
            profile,
        };
        let motion: StageMotion = Arc::new(move |t| {
            let turn = table.stage(t);
            StageState { angle_rad: turn.angle_rad, rate_rps: turn.rate_rps }
        });
        let (samples, _) = listen(&log(scripted(motion, vec![]), settings(), &session(45.0)));
        assert!(samples.len() > 2_200, "{profile:?}: {}", samples.len());
        for sample in &samples {
            let true_counts = table.counts(sample.at, 768_000);
            assert!((sample.counts - true_counts).abs() <= 1, "{profile:?}: {sample:?}, truth {true_counts}");
        }
        let farthest = samples.iter().map(|sample| sample.counts.abs_diff(samples[0].counts)).max();
        assert!(farthest > Some(100_000), "{profile:?} turned by {farthest:?} counts");
    }
}

#[test]
fn jitter_and_mishaps_cost_samples_and_never_more_than_the_stated_doubt() {
    let scale = settings().scale;
    let rough =
        LineLogSettings { jitter: Span::from_micros(700), mishaps: Mishaps { chance: 0.2, seed: 3 }, ..session(60.0) };
    let entries = log(scripted(steady(), vec![]), settings(), &rough);
    let (samples, listener) = listen(&entries);
    // Five kinds of mishaps in six cost a sample and 80 ms more: 60 s / (20 ms + 0.2 · 5/6 · 80 ms) = 1800 polls, 1500
    // of them answered. Half round trips above three times 0.65 ms are too slow: one in ten.
    assert!((1_100..1_700).contains(&samples.len()), "{}", samples.len());
    for sample in &samples {
        let off = (sample.counts - scale.counts(steady()(sample.at).angle_rad)).abs();
        let doubt = 20.0 / 360.0 * 768_000.0 * sample.half_rtt.as_secs_f64();
        assert!(off as f64 <= doubt + 1.0, "{sample:?}: {off} counts, {doubt}");
    }
    let counts = listener.counts();
    assert!(
        [counts.late, counts.slow, counts.wrong_id, counts.lines.not_text, counts.lines.refused()]
            .iter()
            .all(|n| *n > 3),
        "{counts:?}"
    );
    assert_eq!(log(scripted(steady(), vec![]), settings(), &rough), entries, "the same seed gives the same bytes");
    let other = LineLogSettings { seed: 2, ..rough };
    assert_ne!(log(scripted(steady(), vec![]), settings(), &other), entries);
}

#[test]
fn a_usb_adapter_gives_its_bytes_each_millisecond_and_the_doubt_covers_it() {
    let scale = settings().scale;
    let entries = log(scripted(steady(), vec![]), settings(), &LineLogSettings::usual(s(20.0), 1));
    let read = |entry: &&LogEntry| entry.side == Side::Device;
    assert!(entries.iter().filter(read).all(|entry| entry.at.0 % 1_000_000 == 0));
    let (samples, listener) = listen(&entries);
    // A thousand polls, of which six open; one in two hundred is held up by 2 ms on the way and may be left out.
    assert!((970..=1_000).contains(&samples.len()), "{} {:?}", samples.len(), listener.counts());
    for sample in &samples {
        let off = (sample.counts - scale.counts(steady()(sample.at).angle_rad)).abs();
        let doubt = 20.0 / 360.0 * 768_000.0 * sample.half_rtt.as_secs_f64();
        assert!(off as f64 <= doubt + 1.0 && sample.half_rtt < Span::from_micros(6_000), "{sample:?}: {off}, {doubt}");
    }
}

#[test]
fn a_log_is_in_the_order_of_its_times() {
    let rough = LineLogSettings { mishaps: Mishaps { chance: 0.3, seed: 5 }, ..session(10.0) };
    let entries = log(scripted(steady(), vec![]), settings(), &rough);
    assert!(entries.windows(2).all(|pair| pair[0].at <= pair[1].at));
    assert!(entries.iter().any(|entry| entry.side == Side::Host));
}

#[test]
fn a_host_that_was_away_hears_all_it_has_to_know_again() {
    let emulator = ZaberEmulator::new(settings(), scripted(steady(), Vec::new()));
    let mut conversation = Conversation::new(emulator, session(8.0));
    // Away from the first millisecond on: nothing of the opening was heard.
    while conversation.next_before(s(0.001)).is_some() {}
    conversation.resume(s(5.0));
    assert_eq!(conversation.next_before(s(5.0)), None);
    let rest: Vec<LogEntry> = conversation.collect();
    assert!(rest.iter().all(|entry| entry.at >= s(5.0)));
    // Counts of a turn and the rest, asked for as at the start.
    let asked = |entries: &[LogEntry]| -> Vec<Vec<u8>> {
        entries.iter().filter(|entry| entry.side == Side::Host).take(6).map(|entry| entry.bytes.clone()).collect()
    };
    assert_eq!(asked(&rest), asked(&log(scripted(steady(), Vec::new()), settings(), &session(1.0))));
    let (samples, _) = listen(&rest);
    // 3 s at 50 a second, less the opening.
    assert!((140..=150).contains(&samples.len()), "{}", samples.len());
    assert!(samples.iter().all(|sample| sample.at >= s(5.0)));
}

#[test]
fn a_coarse_noisy_encoder_shows_its_steps_and_its_noise() {
    let scale = Scale::new(768_000, 100).expect("a turn has counts");
    let emulator = EmulatorSettings { scale, noise_counts: 300.0, ..settings() };
    let still: StageMotion = Arc::new(|_| StageState { angle_rad: 45.0 * DEG, rate_rps: 0.0 });
    let (samples, _) = listen(&log(scripted(still, vec![]), emulator, &session(60.0)));
    assert!(samples.iter().all(|sample| sample.counts % 100 == 0 && !sample.moving));
    let errors: Vec<f64> = samples.iter().map(|sample| (sample.counts - 96_000) as f64).collect();
    let sigma = (errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64).sqrt();
    // √(300² + 100²/12) = 301.4; 3000 of them know it to 1.3 %.
    assert!((sigma / 301.4 - 1.0).abs() < 0.065, "{sigma}");
}

#[test]
fn a_stall_is_no_truth_and_a_slip_shows_against_what_was_commanded() {
    let stall = StageFault::Stall { from: s(2.0), until: s(4.0) };
    let slip = StageFault::Slip { at: s(6.0), angle_rad: 3.0 * DEG };
    let stage = ScriptedStage::new(steady(), vec![stall, slip]);
    let (samples, _) = listen(&log(Stage::Scripted(stage.clone()), settings(), &session(8.0)));
    for sample in &samples {
        let true_counts = settings().scale.counts(stage.table(sample.at).angle_rad);
        assert!((sample.counts - true_counts).abs() <= 1, "{sample:?}: {true_counts}");
        // A sample taken within 1 ms of the edges may be on either side.
        let edge = [2.0, 4.0].iter().any(|t| (sample.at - s(*t)).as_secs_f64().abs() < 1e-3);
        let stalled = (s(2.0)..s(4.0)).contains(&sample.at);
        assert!(edge || (sample.warning == Warning::STALLED) == stalled && sample.trusted() != stalled, "{sample:?}");
    }
    let mut emulator = ZaberEmulator::new(settings(), Stage::Scripted(stage));
    let error = |emulator: &mut ZaberEmulator, t| ask(emulator, s(t), Command::Get(Setting::EncoderPosError)).data;
    // 40° lost in the stall are 85 333.3 counts, 3° of slip 6 400 more.
    assert_eq!(error(&mut emulator, 1.0), "0");
    let lost: [i64; 2] = [5.0, 7.0].map(|t| error(&mut emulator, t).parse().expect("a number"));
    assert!((lost[0] - 85_333).abs() <= 1 && (lost[1] - 91_733).abs() <= 1, "{lost:?}");
}

/// Asks at once, without latency.
fn ask(emulator: &mut ZaberEmulator, at: RigNs, command: Command) -> Reply {
    let axis = Address { device: 1, axis: 1 };
    let request = Request::new(axis, MessageId::default(), command);
    let mut replies = lines(emulator, at, &request.encode());
    replies.retain(|message| !matches!(message, Message::Alert(_))); // of a move that ended since the last question
    let [Message::Reply(reply)] = replies.as_slice() else { panic!("one reply to {command}: {replies:?}") };
    reply.clone()
}

fn lines(emulator: &mut ZaberEmulator, at: RigNs, bytes: &[u8]) -> Vec<Message> {
    let mut out = Vec::new();
    emulator.receive(at, bytes, Latency::default(), &mut out);
    let mut messages = Vec::new();
    let mut parser = Parser::new(Checksums::Optional);
    for line in out {
        parser.push(line.at, &line.bytes, |_, message| messages.push(message));
    }
    assert_eq!(parser.counts().refused(), 0);
    messages
}

#[test]
fn a_commanded_stage_homes_spins_at_the_rate_it_is_told_and_says_when_it_rests() {
    let stage = CommandedStage::new(90.0 * DEG, 30.0 * DEG);
    let mut emulator = ZaberEmulator::new(settings(), Stage::Commanded(stage));
    assert_eq!(ask(&mut emulator, s(0.0), Command::Set(Switch::Alerts, true)).warning, Warning::NO_REFERENCE);
    let homing = ask(&mut emulator, s(1.0), Command::Home);
    assert_eq!((homing.accepted, homing.busy, homing.warning), (true, true, Warning::NO_REFERENCE));
    // 90° at 30 °/s: there after 3 s.
    let mut alerts = Vec::new();
    emulator.advance(s(3.9), &mut alerts);
    assert!(alerts.is_empty());
    emulator.advance(s(4.1), &mut alerts);
    emulator.advance(s(4.2), &mut alerts);
    assert_eq!(alerts.iter().map(|line| line.bytes.clone()).collect::<Vec<_>>(), [b"!01 1 IDLE --\r\n".to_vec()]);
    assert_eq!(ask(&mut emulator, s(5.0), Command::Get(Setting::EncoderPos)).data, "0");

    let scale = settings().scale;
    assert!(ask(&mut emulator, s(5.0), Command::MoveVel(scale.velocity_data(5.0 * DEG))).busy);
    let position = |emulator: &mut ZaberEmulator, t| -> f64 {
        ask(emulator, s(t), Command::Get(Setting::EncoderPos)).data.parse().expect("a number")
    };
    let turned = position(&mut emulator, 15.0) - position(&mut emulator, 5.0);
    // 10 s at 5 °/s: 106 666.7 counts; the velocity data are rounded to 3e-5.
    assert!((turned - 106_666.7).abs() < 4.0, "{turned}");
    assert_eq!(ask(&mut emulator, s(15.0), Command::Get(Setting::EncoderVel)).data, "17476");
    assert!(!ask(&mut emulator, s(15.0), Command::Stop).busy);
    assert_eq!(emulator.table(s(20.0)).rate_rps, 0.0);
    assert!(ask(&mut emulator, s(20.0), Command::MoveAbs(192_000)).busy);
    assert_eq!(ask(&mut emulator, s(30.0), Command::Get(Setting::EncoderPos)).data, "192000");
    assert!((emulator.table(s(30.0)).angle_rad - 90.0 * DEG).abs() < 1e-12);
}

#[test]
fn it_answers_everything_that_can_be_asked_and_refuses_as_a_device_does() {
    let mut emulator = ZaberEmulator::new(settings(), Stage::Commanded(CommandedStage::new(0.0, 1.0)));
    for command in Command::OPENING {
        assert!(ask(&mut emulator, s(0.0), command).accepted, "{command}");
    }
    let others = [
        Command::Status,
        Command::Home,
        Command::MoveAbs(1),
        Command::MoveRel(-1),
        Command::MoveVel(5),
        Command::Stop,
        Command::EStop,
        Command::Get(Setting::Pos),
        Command::Get(Setting::EncoderPos),
        Command::Get(Setting::EncoderVel),
        Command::Get(Setting::EncoderPosError),
        Command::Get(Setting::MaxSpeed),
    ];
    for command in others {
        assert!(ask(&mut emulator, s(0.0), command).accepted, "{command}");
    }
    let why = |emulator: &mut ZaberEmulator, line: &[u8]| {
        let messages = lines(emulator, s(1.0), line);
        let [Message::Reply(reply)] = messages.as_slice() else { return None };
        Some(if reply.accepted { None } else { Some(Rejection::parse(&reply.data)) })
    };
    assert_eq!(why(&mut emulator, b"/1 2 7 home\n"), Some(Some(Rejection::BadAxis)));
    assert_eq!(why(&mut emulator, b"/1 1 7 get device.id\n"), Some(Some(Rejection::DeviceOnly)));
    assert_eq!(why(&mut emulator, b"/1 1 7 get nothing\n"), Some(Some(Rejection::BadCommand)));
    assert_eq!(why(&mut emulator, b"/1 1 7 move vel 999999999\n"), Some(Some(Rejection::BadData)));
    assert_eq!(why(&mut emulator, b"/1 1 7 move abs 2147483648\n"), Some(Some(Rejection::BadData)));
    assert_eq!(why(&mut emulator, b"/\n"), Some(None), "everybody's status");
    assert_eq!(why(&mut emulator, b"/2 1 7 home\n"), None, "another device's");
    assert_eq!(why(&mut emulator, b"/1 1 9 home:5D\n"), None, "a wrong checksum");
    let older = EmulatorSettings { firmware: (7, 9), ..settings() };
    let mut scripted = ZaberEmulator::new(older, scripted(steady(), vec![]));
    assert_eq!(
        Rejection::parse(&ask(&mut scripted, s(0.0), Command::Get(Setting::EncoderVel)).data),
        Rejection::BadCommand
    );
    assert_eq!(Rejection::parse(&ask(&mut scripted, s(0.0), Command::Stop).data), Rejection::StatusBusy);
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_bytes_are_answered_in_whole_lines_or_not_at_all(
        pieces in prop::collection::vec(
            prop_oneof![
                prop::collection::vec(any::<u8>(), 0..20),
                prop::sample::select(vec!["/1 1 ", "home", "move rel -9223372036854775808", "move abs 9e9", "\n", "get pos", " 7 ", ":00"])
                    .prop_map(|text| text.as_bytes().to_vec()),
                any::<i64>().prop_map(|n| format!("/1 1 3 move vel {n}\n/1 1 4 move abs {n}\n").into_bytes()),
            ],
            0..30,
        ),
    ) {
        let mut emulator = ZaberEmulator::new(settings(), Stage::Commanded(CommandedStage::new(0.0, 1.0)));
        for (n, piece) in pieces.iter().enumerate() {
            lines(&mut emulator, s(n as f64), piece);
        }
        prop_assert!(emulator.table(s(100.0)).angle_rad.is_finite());
    }
}

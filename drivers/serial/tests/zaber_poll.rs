//! A conversation with a stage: which reply is believed, when the sample was taken, and what silence does.

use proptest::prelude::*;
use tumbled_model::{RigNs, Span};
use tumbled_serial::zaber::{
    Address, Command, Counts, Freshness, Heard, Identity, LineSettings, Listener, Message, MessageId, Poll,
    PollSettings, PositionKind, Reply, Request, RequestLine, Sample, Setting, Switch, TooManyCommands, Turn, Warning,
    byte_time, reopen_after,
};

const AXIS: Address = Address { device: 1, axis: 1 };

fn us(us: i64) -> RigNs {
    RigNs(1_000 * us)
}

/// What the stage answers to a request: accepted, idle, no warning.
fn answer(request: &[u8], data: &str) -> Vec<u8> {
    let line = std::str::from_utf8(request).expect("text").trim_end();
    let line = RequestLine::parse(line).expect("a request");
    let (address, id, data) = (line.address, line.id, data.to_owned());
    Message::Reply(Reply { address, id, accepted: true, busy: false, warning: Warning::NONE, data }).encode(true)
}

fn samples(heard: &[Heard]) -> Vec<Sample> {
    heard.iter().filter_map(|heard| if let Heard::Sample(sample) = heard { Some(*sample) } else { None }).collect()
}

/// Polls once at `at`: the request is out 2 ms later, `reply` makes chunks of (µs after that, bytes) of it.
fn exchange(poll: &mut Poll, at: RigNs, reply: impl Fn(&[u8]) -> Vec<(i64, Vec<u8>)>) -> Vec<Heard> {
    let Turn::Write(request) = poll.turn(at) else { panic!("a request is due") };
    let out = at + Span::from_micros(2_000);
    poll.written(out);
    let mut heard = Vec::new();
    for (after, bytes) in reply(&request) {
        poll.heard(out + Span::from_micros(after), &bytes, &mut heard);
    }
    heard
}

#[test]
fn the_sample_lies_in_the_middle_between_request_and_reply_less_half_a_byte() {
    let mut poll = Poll::new(PollSettings::default(), us(0));
    // The reply comes in two reads: its first byte counts, 1 ms after the request was out.
    let heard = exchange(&mut poll, us(0), |request| {
        let reply = answer(request, "1066667");
        vec![(1_000, reply[..1].to_vec()), (4_000, reply[1..].to_vec())]
    });
    let [sample] = samples(&heard)[..] else { panic!("one sample: {heard:?}") };
    // 10 bits at 115 200 baud are 86 805 ns: 2 ms + (1 ms − 86.805 µs)/2 = 2 456.597 µs.
    assert_eq!((sample.at, sample.half_rtt), (RigNs(2_456_597), Span::from_micros(500)));
    assert_eq!((sample.counts, sample.kind, sample.trusted()), (1_066_667, PositionKind::Encoder, true));
    assert_eq!((byte_time(115_200), byte_time(0)), (Span(86_805), Span(0)));
}

#[test]
fn a_fault_or_a_commanded_position_is_no_truth() {
    let mut poll = Poll::new(PollSettings::default(), us(0));
    let heard = exchange(&mut poll, us(0), |request| {
        let reply = String::from_utf8(answer(request, "5")).expect("text");
        let body = reply[1..].split(':').next().expect("a body").replace("--", "FS");
        vec![(1_000, format!("@{body}:{:02X}\r\n", tumbled_serial::zaber::checksum(&body)).into_bytes())]
    });
    assert_eq!(samples(&heard).iter().map(Sample::trusted).collect::<Vec<_>>(), [false]);
    let mut poll = Poll::new(PollSettings { position: Setting::Pos, ..PollSettings::default() }, us(0));
    let heard = exchange(&mut poll, us(0), |request| vec![(1_000, answer(request, "5"))]);
    assert_eq!(
        samples(&heard).iter().map(|s| (s.kind, s.trusted())).collect::<Vec<_>>(),
        [(PositionKind::Commanded, false)]
    );
}

#[test]
fn bad_replies_are_counted_and_the_next_poll_is_fine() {
    type Damage = fn(&[u8]) -> Vec<u8>;
    type Counter = fn(&Counts) -> u64;
    let spoilt: [(Damage, Counter); 6] = [
        (|reply| reply.iter().map(|b| if *b == b'7' { b'8' } else { *b }).collect(), |c| c.lines.bad_checksum),
        (|_| b"\xFF\x00garbage\r\n".to_vec(), |c| c.lines.not_text),
        (|_| answer(b"/1 1 55 get encoder.pos", "7"), |c| c.wrong_id),
        (|_| answer(b"/2 1 0 get encoder.pos", "7"), |c| c.wrong_address),
        (|_| answer(b"/1 1 0 get encoder.pos", "7 8"), |c| c.bad_value),
        (|_| b"@01 1 00 RJ IDLE -- BADCOMMAND:74\r\n".to_vec(), |c| c.rejected),
    ];
    for (number, (damage, counter)) in spoilt.into_iter().enumerate() {
        let mut poll = Poll::new(PollSettings::default(), us(0));
        let heard = exchange(&mut poll, us(0), |request| vec![(1_000, damage(&answer(request, "777")))]);
        assert_eq!((samples(&heard), counter(&poll.counts())), (vec![], 1), "case {number}: {:?}", poll.counts());
        let heard = exchange(&mut poll, us(200_000), |request| vec![(1_000, answer(request, "778"))]);
        assert_eq!(samples(&heard).len(), 1, "case {number}: {:?}", poll.counts());
    }
}

#[test]
fn a_late_reply_is_known_by_its_id_and_dropped() {
    let mut poll = Poll::new(PollSettings::default(), us(0));
    let Turn::Write(first) = poll.turn(us(0)) else { panic!("a request is due") };
    poll.written(us(2_000));
    assert_eq!(poll.turn(us(50_000)), Turn::Wait(us(102_000)));
    // Given up 100 ms after it was out; the next one is due at once.
    let heard =
        exchange(&mut poll, us(102_000), |second| vec![(1_000, answer(&first, "1")), (2_000, answer(second, "2"))]);
    assert_eq!(samples(&heard).iter().map(|sample| sample.counts).collect::<Vec<_>>(), [2]);
    assert_eq!((poll.counts().late, poll.counts().wrong_id), (1, 0));
}

#[test]
fn a_reply_that_was_held_up_is_no_sample() {
    let mut poll = Poll::new(PollSettings::default(), us(0));
    let round_trip =
        |poll: &mut Poll, at, us| samples(&exchange(poll, at, |request| vec![(us, answer(request, "1"))])).len();
    // The quickest takes 2 ms; 6 ms are three times as much and pass, 16 ms of an adapter's latency do not.
    assert_eq!([2_000, 6_000, 16_000].map(|rtt| round_trip(&mut poll, us(20 * rtt), rtt)), [1, 1, 0]);
    assert_eq!(poll.counts().slow, 1);
}

#[test]
fn polls_keep_their_rhythm_and_do_not_make_up_for_what_was_missed() {
    let mut poll = Poll::new(PollSettings { period: Span(1), ..PollSettings::default() }, us(0));
    let answered = |request: &[u8]| vec![(1_000, answer(request, "1"))];
    exchange(&mut poll, us(0), answered);
    // Never faster than 100 Hz.
    assert_eq!(poll.turn(us(3_000)), Turn::Wait(us(10_000)));
    exchange(&mut poll, us(10_400), answered);
    assert_eq!(poll.turn(us(14_000)), Turn::Wait(us(20_000)));
    // 35 ms without a look: the polls of 20 and 30 ms are one, the next is that of 40 ms.
    exchange(&mut poll, us(35_000), answered);
    assert_eq!(poll.turn(us(38_500)), Turn::Wait(us(40_000)));
}

#[test]
fn three_misses_are_stale_and_ten_reopen_the_port() {
    let mut poll = Poll::new(PollSettings::default(), us(0));
    assert_eq!(poll.freshness(), Freshness::Opening);
    exchange(&mut poll, us(0), |request| vec![(1_000, answer(request, "1"))]);
    assert_eq!(poll.freshness(), Freshness::Live);
    let mut now = us(20_000);
    let mut seen = Vec::new();
    while poll.turn(now) != Turn::Reopen {
        poll.written(now);
        seen.push(poll.freshness());
        now = now + Span::from_micros(100_000);
    }
    // Asked ten times; before the fourth time three were missed: stale 0.3 s after the last good one.
    assert_eq!(seen.len(), 10);
    assert_eq!(seen.iter().position(|f| *f == Freshness::Stale), Some(3));
    assert_eq!([0, 1, 2, 3, 9].map(reopen_after).map(|span| span.0 / 1_000_000), [500, 1_000, 2_000, 2_000, 2_000]);
}

#[test]
fn a_stop_goes_first_and_takes_waiting_moves_away() {
    let mut poll = Poll::new(PollSettings::default(), us(0));
    for command in [Command::Home, Command::Get(Setting::Version), Command::MoveVel(1)] {
        poll.ask(command).expect("room");
    }
    poll.ask(Command::Stop).expect("always room");
    let mut order = Vec::new();
    for n in 0..3 {
        let heard = exchange(&mut poll, us(4_000 * n), |request| vec![(1_000, answer(request, "0"))]);
        order.extend(heard.iter().map(|heard| match heard {
            Heard::Answer { command, .. } => *command,
            Heard::Sample(_) => Command::Get(Setting::EncoderPos),
            Heard::Alert { .. } => panic!("no alert"),
        }));
    }
    assert_eq!(order, [Command::Stop, Command::Get(Setting::Version), Command::Get(Setting::EncoderPos)]);
}

#[test]
fn a_command_without_answer_is_told_and_not_sent_again() {
    let mut poll = Poll::new(PollSettings::default(), us(0));
    poll.ask(Command::MoveRel(100)).expect("room");
    assert!(matches!(poll.turn(us(0)), Turn::Write(_)));
    poll.written(us(1));
    assert_eq!(poll.turn(us(100_001)), Turn::Unanswered(Command::MoveRel(100)));
    let Turn::Write(next) = poll.turn(us(100_001)) else { panic!("the poll is due") };
    assert!(next.starts_with(b"/1 1 1 get encoder.pos"));
    let asked: Vec<_> = (0..20).map(|_| poll.ask(Command::Status)).collect();
    assert_eq!(asked.iter().filter(|asked| **asked == Err(TooManyCommands)).count(), 4);
}

#[test]
fn the_opening_tells_who_is_there() {
    let mut poll = Poll::new(PollSettings::default(), us(0));
    Command::OPENING.into_iter().for_each(|command| poll.ask(command).expect("room"));
    let mut identity = Identity::default();
    for (n, data) in ["0", "0", "50919", "123456", "7.29", "768000"].into_iter().enumerate() {
        let at = us(5_000 * i64::try_from(n).expect("few"));
        for heard in exchange(&mut poll, at, |request| vec![(1_000, answer(request, data))]) {
            let Heard::Answer { command, reply, .. } = heard else { panic!("{heard:?}") };
            identity.learn(command, &reply);
        }
    }
    let expected = Identity {
        device_id: Some(50_919),
        serial: Some(123_456),
        firmware: Some("7.29".to_owned()),
        counts_per_turn: Some(768_000),
    };
    assert_eq!(identity, expected);
    assert_eq!(identity.has_encoder_velocity(), Some(true));
    let older = Identity { firmware: Some("7.9".to_owned()), ..expected };
    assert_eq!(older.has_encoder_velocity(), Some(false));
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_chunks_give_a_listener_no_more_samples_than_requests(
        chunks in prop::collection::vec(
            (
                0i64..200_000,
                prop_oneof![
                    prop::collection::vec(any::<u8>(), 0..40),
                    (0u8..4).prop_map(|n| {
                        let id = MessageId::new(n).expect("below 100");
                        Request::new(AXIS, id, Command::Get(Setting::EncoderPos)).encode()
                    }),
                    (0u8..4).prop_map(|n| answer(format!("/1 1 {n} get pos").as_bytes(), "123")),
                    Just(Request::new(AXIS, MessageId::default(), Command::Set(Switch::Alerts, true)).encode()),
                ],
            ),
            0..60,
        ),
    ) {
        let mut listener = Listener::new(LineSettings::default());
        let (mut heard, mut now, mut requests) = (Vec::new(), RigNs(0), 0);
        for (us, bytes) in chunks {
            now = now + Span::from_micros(us);
            requests += usize::from(bytes.starts_with(b"/"));
            listener.overheard(now, &bytes, &mut heard);
        }
        let samples = samples(&heard);
        prop_assert!(samples.len() <= requests);
        prop_assert!(samples.iter().all(|sample| sample.counts == 123 && sample.half_rtt <= Span::from_micros(50_000)));
        prop_assert_eq!(listener.counts().samples, samples.len() as u64);
    }

    #[test]
    fn any_silence_ends_in_a_reopening(steps in prop::collection::vec(1i64..30_000, 600)) {
        let mut poll = Poll::new(PollSettings::default(), us(0));
        let (mut now, mut written) = (us(0), 0);
        for step in steps {
            now = now + Span::from_micros(step);
            match poll.turn(now) {
                Turn::Write(_) => { poll.written(now); written += 1; }
                Turn::Wait(until) => prop_assert!(until > now && until - now <= Span::from_micros(100_000)),
                Turn::Reopen => break,
                Turn::Unanswered(command) => prop_assert!(false, "{} was never asked", command),
            }
        }
        // 600 steps of 15 ms on average are 9 s; ten misses take 1.3 s at the most.
        prop_assert_eq!((written, poll.turn(now)), (10, Turn::Reopen));
    }
}

#[test]
fn twice_a_second_the_drive_is_asked_for_its_error_until_it_refuses() {
    let mut poll = Poll::new(PollSettings::default(), us(0));
    let mut asked = Vec::new();
    let mut refuses = false;
    for ms in 0..3_000 {
        let Turn::Write(request) = poll.turn(us(1_000 * ms)) else { continue };
        let out = us(1_000 * ms) + Span::from_micros(100);
        poll.written(out);
        let is_check = String::from_utf8_lossy(&request).contains("encoder.pos.error");
        let reply = String::from_utf8(answer(&request, "3")).expect("text");
        let reply = match is_check && refuses {
            true => checked(&reply.replace("OK", "RJ").replace(" 3:", " BADCOMMAND:")),
            false => reply,
        };
        if is_check {
            asked.push(ms);
            refuses = asked.len() == 3;
        }
        poll.heard(out + Span::from_micros(500), reply.as_bytes(), &mut Vec::new());
    }
    // The fourth, which is refused, is the last.
    assert_eq!(asked, [500, 1_000, 1_500, 2_000]);
    assert_eq!(poll.counts().rejected, 1);
}

/// A line with its checksum made right.
fn checked(line: &str) -> String {
    let (body, _) = line.trim_end().split_at(1).1.rsplit_once(':').expect("a checksum");
    format!("@{body}:{:02X}\r\n", tumbled_serial::zaber::checksum(body))
}

#[test]
fn whom_the_host_asks_is_whose_replies_count() {
    let other = Address { device: 2, axis: 3 };
    let mut listener = Listener::new(LineSettings::default());
    let mut heard = Vec::new();
    let request = Request::new(other, MessageId::default(), Command::Get(Setting::EncoderPos));
    listener.overheard(us(0), &request.encode(), &mut heard);
    listener.overheard(us(400), &answer(&request.encode(), "77"), &mut heard);
    assert_eq!(samples(&heard).iter().map(|sample| sample.counts).collect::<Vec<_>>(), [77]);
    let request = Request::new(other, MessageId::default().next(), Command::Get(Setting::EncoderPos));
    listener.overheard(us(20_000), &request.encode(), &mut heard);
    let stranger = Request { address: AXIS, ..request };
    listener.overheard(us(20_400), &answer(&stranger.encode(), "5"), &mut heard);
    assert_eq!((samples(&heard).len(), listener.counts().wrong_address), (1, 1));
}

//! Lines of a Zaber chain, written and read: the protocol manual's conversation, damage, and any bytes at all.

use proptest::prelude::*;
use tumbled_model::RigNs;
use tumbled_serial::zaber::{
    Address, Alert, Checksums, Command, Info, LineCounts, Message, MessageError, MessageId, Parser, Rejection, Reply,
    Request, RequestLine, Setting, Switch, Warning,
};

const AXIS: Address = Address { device: 1, axis: 1 };

fn id(number: u8) -> MessageId {
    MessageId::new(number).expect("below 100")
}

fn reply(number: u8, busy: bool, warning: Warning, data: &str) -> Message {
    let data = data.to_owned();
    Message::Reply(Reply { address: AXIS, id: Some(id(number)), accepted: true, busy, warning, data })
}

fn read(bytes: &[u8], checksums: Checksums) -> (Vec<Message>, LineCounts) {
    let mut parser = Parser::new(checksums);
    let mut messages = Vec::new();
    parser.push(RigNs(0), bytes, |_, message| messages.push(message));
    (messages, parser.counts())
}

#[test]
fn requests_are_written_as_the_manual_writes_them() {
    let written = |number, command| String::from_utf8(Request::new(AXIS, id(number), command).encode()).expect("text");
    assert_eq!(written(8, Command::Get(Setting::LimitCycleDist)), "/1 1 8 get limit.cycle.dist:67\n");
    assert_eq!(written(9, Command::Home), "/1 1 9 home:5C\n");
    assert_eq!(written(7, Command::Get(Setting::EncoderPos)), "/1 1 7 get encoder.pos:47\n");
    assert_eq!(written(14, Command::MoveAbs(192_000)), "/1 1 14 move abs 192000:80\n");
    assert_eq!(written(11, Command::Stop), "/1 1 11 stop:16\n");
    assert_eq!(written(12, Command::Get(Setting::EncoderVel)), "/1 1 12 get encoder.vel:26\n");
    // For the device as a whole: axis 0. "1 0 3": 0x31 + 0x20 + 0x30 + 0x20 + 0x33 = 0xD4, " get device.id" adds 0x4EB: 0x5BF in all, so 41.
    assert_eq!(written(3, Command::Get(Setting::DeviceId)), "/1 0 3 get device.id:41\n");
    let switch = Request { address: AXIS.whole(), id: None, command: Command::Set(Switch::Alerts, true) };
    assert_eq!(switch.encode(), b"/1 set comm.alert 1:00\n");
}

#[test]
fn the_conversation_is_understood() {
    let bytes = b"@01 1 08 OK IDLE -- 768000:FF\r\n@01 1 09 OK BUSY WR 0:8F\r\n@01 1 07 OK BUSY -- 1066667:A0\r\n\
        !01 1 IDLE --:96\r\n@01 1 13 OK BUSY FS 0:A4\r\n";
    let (messages, counts) = read(bytes, Checksums::Required);
    let alert = Alert { address: AXIS, busy: false, warning: Warning::NONE, data: String::new() };
    assert_eq!(
        messages,
        [
            reply(8, false, Warning::NONE, "768000"),
            reply(9, true, Warning::NO_REFERENCE, "0"),
            reply(7, true, Warning::NONE, "1066667"),
            Message::Alert(alert),
            reply(13, true, Warning::STALLED, "0"),
        ]
    );
    assert_eq!((counts.replies, counts.alerts, counts.refused()), (4, 1, 0));
    let written: Vec<u8> = messages.iter().flat_map(|message| message.encode(true)).collect();
    assert_eq!(written, bytes);
}

#[test]
fn a_refusal_says_why() {
    let (messages, _) = read(b"@01 1 10 RJ IDLE -- BADDATA:58\r\n", Checksums::Required);
    let [Message::Reply(reply)] = messages.as_slice() else { panic!("one reply: {messages:?}") };
    assert_eq!((reply.accepted, Rejection::parse(&reply.data)), (false, Rejection::BadData));
    assert_eq!(Rejection::parse("NEWWORD"), Rejection::Unknown);
}

#[test]
fn each_damage_is_counted_as_what_it_is_and_costs_its_line_alone() {
    let good = b"@01 1 08 OK IDLE -- 768000:FF\r\n";
    for (bad, counter) in [
        (&b"@01 1 08 OK IDLE -- 768001:FF"[..], "bad_checksum: 1"),
        (b"@01 1 08 OK IDLE -- 768000:ff", "bad_checksum: 1"),
        (b"@01 1 08 OK IDLE -- 768000", "unchecked: 1"),
        (b"@01 1 08 OK I\xC4LE -- 768000:FF", "not_text: 1"),
        (&[b'7'; 81], "too_long: 1"),
        (b"01 1 08 OK IDLE -- 768000:FF", "malformed: 1"),
        // A sound checksum over words that are none: "hello" is 0x214, so EC.
        (b"@hello:EC", "malformed: 1"),
        // "1 more\": 0x31 + 0x20 + 0x1B3 + 0x5C = 0x260, so A0.
        (b"#1 more\\:A0", "continued: 1"),
        // The line's end got lost: two lines are one.
        (b"@01 1 08 OK IDLE -- 768000:FF@01 1 09 OK BUSY WR 0:8F", "bad_checksum: 1"),
    ] {
        let bytes = [good, bad, b"\r\n", good].concat();
        let (messages, counts) = read(&bytes, Checksums::Required);
        let name = String::from_utf8_lossy(bad);
        assert_eq!((messages.len(), counts.refused()), (2, 1), "{name}");
        assert!(format!("{counts:?}").contains(counter), "{name}: {counts:?}");
    }
}

#[test]
fn without_checksums_only_where_they_are_optional() {
    let line = b"@01 1 08 OK IDLE -- 768000\r\n";
    assert_eq!(read(line, Checksums::Optional).0, [reply(8, false, Warning::NONE, "768000")]);
    assert!(read(line, Checksums::Required).0.is_empty());
    // A wrong one is wrong everywhere.
    assert!(read(b"@01 1 08 OK IDLE -- 768000:00\r\n", Checksums::Optional).0.is_empty());
}

#[test]
fn a_device_reads_what_the_host_writes_and_knows_what_is_no_command() {
    let words = |line| RequestLine::parse(line).map(|line| line.command());
    assert_eq!(words("/1 1 9 home:5C"), Some(Ok(Command::Home)));
    assert_eq!(words("/1 1"), Some(Ok(Command::Status)));
    assert_eq!(words("/1 1 tools gotolaser"), Some(Err(Rejection::BadCommand)));
    assert_eq!(words("/1 1 move abs"), Some(Err(Rejection::BadData)));
    assert_eq!(words("/1 1 set comm.alert 2"), Some(Err(Rejection::BadData)));
    assert_eq!(words("/1 1 100 home"), Some(Err(Rejection::BadMessageId)));
    assert_eq!((words("/1 1 9 home:5D"), words("1 1 9 home")), (None, None));
}

fn command() -> impl Strategy<Value = Command> {
    use Setting::{
        DeviceId, EncoderPos, EncoderPosError, EncoderVel, LimitCycleDist, MaxSpeed, Pos, SystemSerial, Version,
    };
    let settings =
        [DeviceId, SystemSerial, Version, Pos, EncoderPos, EncoderPosError, EncoderVel, MaxSpeed, LimitCycleDist];
    prop_oneof![
        prop::sample::select(vec![Command::Status, Command::Home, Command::Stop, Command::EStop]),
        any::<i64>().prop_map(Command::MoveAbs),
        any::<i64>().prop_map(Command::MoveRel),
        any::<i64>().prop_map(Command::MoveVel),
        prop::sample::select(settings.to_vec()).prop_map(Command::Get),
        (prop::sample::select(vec![Switch::Alerts, Switch::Checksums]), any::<bool>())
            .prop_map(|(switch, on)| Command::Set(switch, on)),
    ]
}

/// Data of a reply or text of an info line: words a space apart.
fn words() -> impl Strategy<Value = String> {
    "[a-zA-Z0-9.+-]{1,8}( [a-zA-Z0-9.+-]{1,8}){0,3}"
}

fn message() -> impl Strategy<Value = Message> {
    let address = (0u8..100, 0u8..10).prop_map(|(device, axis)| Address { device, axis });
    let warning = "[A-Z]{2}|--".prop_map(|text| Warning::parse(&text).expect("two characters"));
    let id = (0u8..100).prop_map(id);
    (0..3, address, id, any::<(bool, bool)>(), warning, words()).prop_map(
        |(kind, address, id, (accepted, busy), warning, data)| match kind {
            0 => Message::Reply(Reply { address, id: Some(id), accepted, busy, warning, data }),
            1 => Message::Info(Info { address, id: Some(id), text: data }),
            _ => Message::Alert(Alert { address, busy, warning, data }),
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn any_command_is_read_as_it_was_written(command in command(), device in 1u8..100, axis in 1u8..10, n in 0u8..100) {
        let request = Request::new(Address { device, axis }, id(n), command);
        let bytes = request.encode();
        prop_assert!(bytes.len() <= 45, "{}", bytes.len());
        let line = std::str::from_utf8(&bytes).expect("text").trim_end();
        prop_assert_eq!(RequestLine::parse(line).and_then(|line| line.request()), Some(request));
    }

    #[test]
    fn any_message_is_read_as_it_was_written(message in message(), checked: bool) {
        let checksums = if checked { Checksums::Required } else { Checksums::Optional };
        prop_assert_eq!(read(&message.encode(checked), checksums).0, vec![message]);
    }

    #[test]
    fn flipped_bits_never_make_another_message(message in message(), at in any::<prop::sample::Index>(), bit in 0u8..8) {
        let mut bytes = message.encode(true);
        let at = at.index(bytes.len() - 2); // not in the line's end
        bytes[at] ^= 1 << bit;
        // The first character is not in the sum: `!` and `#` differ in one bit, and the rest must then fit the other.
        let (read, _) = read(&bytes, Checksums::Required);
        prop_assert!(at == 0 || !read.iter().any(|other| *other != message), "{:?}", read);
    }

    #[test]
    fn arbitrary_bytes_leave_the_next_lines_alone(
        noise in prop::collection::vec(prop_oneof![any::<u8>(), prop::sample::select(b"@#!/:01 OKRJ\\\r\n".to_vec())], 0..300),
        cut in 1usize..100,
        message in message(),
    ) {
        let mut parser = Parser::new(Checksums::Required);
        let mut messages = Vec::new();
        let bytes = [&noise[..], b"\n", &message.encode(true)].concat();
        for chunk in bytes.chunks(cut) {
            parser.push(RigNs(0), chunk, |_, message| messages.push(message));
        }
        prop_assert_eq!(messages.last(), Some(&message));
    }

    #[test]
    fn arbitrary_words_are_a_command_or_refused(line in "[/ -~]{0,90}") {
        if let Some(Ok(command)) = RequestLine::parse(&line).map(|line| line.command()) {
            prop_assert_eq!(Command::parse(&command.to_string()), Ok(command));
        }
        let error = Message::parse(&line, Checksums::Optional).err();
        prop_assert!(line.starts_with(['@', '#', '!']) || error == Some(MessageError::Start));
    }
}

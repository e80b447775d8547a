//! Files cut anywhere, files with flipped bits, and files that were never recordings.

use super::*;
use crate::recording::ReadError;
use crate::recording::records::{Records, Step};
use std::fs;
use std::io::Cursor;
use std::sync::OnceLock;

/// Three chunks of 5 packets each, closed by sync.
fn recorded(path: &Path) -> (Vec<Event>, Vec<u8>) {
    let events: Vec<_> = (0..15).map(|n| lidar(n, n as i64 * 1000, &noise(40, 2 * n + 1))).collect();
    let mut recorder = Recorder::create(path, header("s"), RecorderOptions::default()).unwrap();
    for (n, event) in events.iter().enumerate() {
        recorder.write(event);
        if n % 5 == 4 {
            recorder.sync();
        }
    }
    recorder.finish();
    (events, fs::read(path).unwrap())
}

#[test]
fn a_file_cut_at_any_byte_yields_the_first_events_and_says_what_is_lost() {
    let (_folder, path) = folder();
    let (events, file) = recorded(&path);
    let mut most = 0;
    for length in 0..file.len() {
        fs::write(&path, &file[..length]).unwrap();
        let Ok(mut reader) = Reader::open(&[&path]) else {
            assert_eq!(most, 0, "a longer file cannot hold less");
            continue;
        };
        let back: Vec<_> = reader.by_ref().map(Result::unwrap).collect();
        assert_eq!(back, events[..back.len()], "{length}");
        assert!(back.len() >= most, "{length}: a longer file holds no less");
        assert!(!reader.info().whole() && !reader.info().parts[0].finished, "{length}");
        most = back.len();
    }
    assert_eq!(most, 15);
}

#[test]
fn a_flipped_bit_costs_its_chunk_and_nothing_else() {
    let (_folder, path) = folder();
    let (events, mut file) = recorded(&path);
    // The second chunk's first packet, uncompressed in lz4 because it is noise.
    let payload = noise(40, 11);
    let at = file.windows(40).position(|window| window == payload).expect("noise is stored as it is");
    file[at + 20] ^= 0x10;
    fs::write(&path, &file).unwrap();
    let (back, info) = read(&[&path]);
    assert_eq!(back, [&events[..5], &events[10..]].concat());
    let part = &info.parts[0];
    assert_eq!((part.events_lost(), info.counters.missing_seqs, part.damage.len()), (Some(5), 5, 1));
    assert!(part.damage[0].detail.contains("checksum"), "{}", part.damage[0].detail);
    assert!(part.finished && !info.whole());
    // The damage begins at the chunk's record, before the packet, and ends behind it.
    let span = part.damage[0].offset..part.damage[0].offset + part.damage[0].bytes;
    assert!(span.contains(&(at as u64)), "{span:?} {at}");
}

#[test]
fn a_chunk_whose_length_is_damaged_does_not_pass_for_the_end_of_the_file() {
    let (_folder, path) = folder();
    let (events, mut file) = recorded(&path);
    let payload = noise(40, 21);
    let at = file.windows(40).position(|window| window == payload).expect("noise is stored as it is");
    // The last chunk: its compression's name is 4 + 3 bytes, before it size and CRC (12), two times (16), length (8).
    let name = file[..at].windows(7).rposition(|window| window == b"\x03\0\0\0lz4").expect("a chunk");
    file[name - 36 + 2] ^= 1; // 2^16 bytes more: beyond the file's end, but no more than a record may have
    file[at] ^= 1;
    fs::write(&path, &file).unwrap();
    let (back, info) = read(&[&path]);
    assert_eq!(back, events[..10], "what cannot be held against its checksum is not delivered");
    assert!(info.parts[0].damage[0].detail.contains("says it has"), "{:?}", info.parts[0].damage);
}

#[test]
fn damage_in_the_chunk_that_declares_the_channels_costs_that_chunk_alone() {
    let (_folder, path) = folder();
    let (events, mut file) = recorded(&path);
    let payload = noise(40, 1);
    let at = file.windows(40).position(|window| window == payload).expect("noise is stored as it is");
    file[at] ^= 1;
    fs::write(&path, &file).unwrap();
    let (back, info) = read(&[&path]);
    assert_eq!(back, events[5..], "the index declares the channels too");
    assert_eq!(info.parts[0].events_lost(), Some(5));
    // Without the index nobody knows whose the messages are: ten are lost, and that is said.
    fs::write(&path, &file[..file.len() - 1]).unwrap();
    let (back, info) = read(&[&path]);
    assert_eq!((back.len(), info.undecodable, info.whole()), (0, 10, false));
}

#[test]
fn foreign_mcap_files_and_empty_files_are_told_apart() {
    let (_folder, path) = folder();
    mcap::Writer::new(fs::File::create(&path).unwrap()).unwrap().finish().unwrap();
    let error = Reader::open(&[&path]).unwrap_err();
    assert!(matches!(error, ReadError::NotARecording { .. }), "{error}");
    fs::write(&path, b"").unwrap();
    assert!(matches!(Reader::open(&[&path]).unwrap_err(), ReadError::NotARecording { .. }));
    assert!(matches!(Reader::open::<&Path>(&[]).unwrap_err(), ReadError::Nothing));
}

#[test]
fn a_newer_format_is_refused_by_its_number() {
    let (_folder, path) = folder();
    let (_, mut file) = recorded(&path);
    let key = b"\x06\0\0\0format\x01\0\0\x001";
    let at = file.windows(key.len()).position(|window| window == key).expect("the start record");
    file[at + key.len() - 1] = b'9';
    fs::write(&path, &file).unwrap();
    let message = Reader::open(&[&path]).unwrap_err().to_string();
    assert!(message.contains("format version 9") && message.contains("reads version 1"), "{message}");
}

fn walk(file: &[u8]) -> usize {
    let mut records = Records::new(Cursor::new(file), file.len() as u64).unwrap();
    for steps in 0.. {
        if let Step::End { .. } = records.next_step().expect("memory reads") {
            return steps;
        }
        // Each record takes nine bytes or more of a chunk, or of the file; lz4 unpacks to at most 255 times.
        assert!(steps <= file.len() * 256, "no end");
    }
    unreachable!("the loop is endless")
}

proptest! {
    #[test]
    fn arbitrary_bytes_are_walked_to_an_end(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        walk(&bytes);
        walk(&[b"\x89MCAP0\r\n", bytes.as_slice()].concat());
    }

    #[test]
    fn arbitrary_records_are_walked_to_an_end(
        records in prop::collection::vec((1u8..17, 0u64..80, prop::collection::vec(any::<u8>(), 0..60)), 0..8)
    ) {
        let mut file = b"\x89MCAP0\r\n".to_vec();
        for (opcode, length, content) in records {
            file.push(opcode);
            file.extend(length.to_le_bytes());
            file.extend(content);
        }
        walk(&file);
    }

    #[test]
    fn flipped_bytes_never_become_events(flips in prop::collection::vec((any::<prop::sample::Index>(), 1u8..), 1..6)) {
        static RECORDED: OnceLock<(Vec<Event>, Vec<u8>)> = OnceLock::new();
        let (_folder, path) = folder();
        let (events, file) = RECORDED.get_or_init(|| recorded(&path));
        let mut file = file.clone();
        for (at, with) in flips {
            let at = at.index(file.len());
            file[at] ^= with;
        }
        fs::write(&path, &file).unwrap();
        if let Ok(mut reader) = Reader::open(&[&path]) {
            for event in reader.by_ref() {
                let event = event.unwrap();
                prop_assert!(events.contains(&event), "{event:?} was never recorded");
            }
        }
    }

    #[test]
    fn arbitrary_messages_are_events_or_undecodable(
        kind in prop::sample::select(super::super::ChannelKind::ALL.to_vec()), message in any_bytes(80)
    ) {
        let sensor = (kind != super::super::ChannelKind::Ledger).then(|| SensorId::from("x"));
        let channel = super::super::ChannelKey { kind, sensor };
        if let Some(event) = super::super::layout::decode(&channel, &message) {
            // What is understood is understood whole: encoding it again tells the same event.
            let mut again = Vec::new();
            prop_assert!(super::super::layout::encode(&event, &mut again));
            prop_assert_eq!(super::super::layout::decode(&channel, &again.into()), Some(event));
        }
    }
}

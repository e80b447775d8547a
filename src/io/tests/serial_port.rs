//! A serial port as a source: who may have it, what is said of one that is of no use, and the line stream.

use std::path::{Path, PathBuf};
use std::time::Duration;
use tumbled_io::live::{
    Backoff, Ledger, Opener, PortName, PseudoTerminal, QueueBound, SerialConfig, SerialOpener, SerialProtocol,
    SessionClock, SourceError, StopToken, supervise,
};
use tumbled_model::{Body, SourceState};
use tumbled_serial::line_stream::StreamLine;

fn opener(path: &Path, protocol: SerialProtocol) -> SerialOpener {
    let config = SerialConfig {
        sensor: "turntable".into(),
        port: PortName::Path(path.to_owned()),
        protocol,
        baud: 115_200,
        root: PathBuf::from("/"),
    };
    SerialOpener::new(config, SessionClock::start_on_system(), StopToken::new().expect("a descriptor"))
}

fn refused(opener: &mut SerialOpener) -> String {
    match opener.open() {
        Err(error @ SourceError::Serial(_)) if error.is_worth_a_retry() => error.to_string(),
        Err(error) => panic!("{error:?}"),
        Ok(source) => panic!("{:?}", source.describe()),
    }
}

#[test]
fn a_port_belongs_to_one_and_is_free_when_that_one_is_done() {
    let terminal = PseudoTerminal::open().expect("a pseudo terminal");
    let mut opener = opener(terminal.path(), SerialProtocol::Line);
    let first = opener.open().expect("the first");
    let told = refused(&mut opener);
    assert!(told.contains("is in use") && told.contains("end that program"), "{told}");
    drop(first);
    opener.open().expect("free again");
}

#[test]
fn what_is_no_port_is_said_with_what_to_do() {
    let folder = tempfile::tempdir().expect("a folder");
    let absent = refused(&mut opener(&folder.path().join("ttyUSB0"), SerialProtocol::Zaber));
    assert!(absent.contains("there is no serial port") && absent.contains("tumbled devices"), "{absent}");
    let file = refused(&mut opener(folder.path(), SerialProtocol::Zaber));
    assert!(file.contains("is no serial port"), "{file}");
}

#[test]
fn a_line_on_which_another_protocol_is_spoken_says_so() {
    let mut terminal = PseudoTerminal::open().expect("a pseudo terminal");
    let silent = refused(&mut opener(terminal.path(), SerialProtocol::Zaber));
    assert!(silent.contains("nothing answers") && silent.contains("turntable.baud"), "{silent}");
    let path = terminal.path().to_owned();
    let stop = StopToken::new().expect("a descriptor");
    let until = stop.clone();
    let talker = std::thread::spawn(move || {
        while !until.wait(Duration::from_millis(5)) {
            terminal.write(b"E,1,2,-3*74\r\n").expect("there");
        }
    });
    let other = refused(&mut opener(&path, SerialProtocol::Zaber));
    stop.stop();
    talker.join().expect("no panic");
    assert!(other.contains("bytes came") && other.contains("turntable.protocol"), "{other}");
}

#[test]
fn a_line_stream_comes_into_the_ledger_as_it_was_sent() {
    let mut terminal = PseudoTerminal::open().expect("a pseudo terminal");
    let (clock, stop) = (SessionClock::start_on_system(), StopToken::new().expect("a descriptor"));
    let mut ledger = Ledger::live(clock.clone());
    let intake = ledger.intake("turntable".into(), QueueBound::SERIAL_CHUNKS);
    let events = ledger.recorder();
    let ledger = ledger.start().expect("a thread");
    let opener = Box::new(opener(terminal.path(), SerialProtocol::Line));
    let source = supervise(opener, None, intake, clock, stop.clone(), Backoff::default(), |_| {}).expect("a thread");
    let (mut sent, mut heard, mut is_open) = (Vec::new(), Vec::new(), false);
    for event in events {
        match event.body {
            Body::SensorState { state: SourceState::Opened, .. } => is_open = true,
            Body::SerialChunk { bytes, .. } => heard.extend_from_slice(&bytes),
            // A line with each tick, from the opening on: what came before is noise to it.
            Body::Tick if is_open && sent.len() < 200 => {
                let line = StreamLine::Reading { seq: sent.len() as u32, device_us: 7, count: -1 }.encode();
                terminal.write(&line).expect("there");
                sent.extend_from_slice(&line);
            }
            Body::Tick if heard.len() >= 200 => break,
            _ => {}
        }
    }
    stop.stop();
    assert!(source.join().error.is_none());
    ledger.stop();
    assert_eq!(heard, sent);
}

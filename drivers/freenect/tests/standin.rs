//! The driver on the real libfreenect, with a stand-in for libusb under it that has Kinects by script.
//!
//! What the stand-in sent, packet by packet, stands in its truth file, and what it was asked in its journal: nothing here is
//! compared with what the driver says of itself.

mod dump;

use dump::{Dumped, FrameLine, digest, dump, real_frame};
use fake_libusb_control::{FrameTruth, FrameWriter, Standin};
use std::fs;
use std::time::{Duration, Instant};

/// Bytes of a packet's payload; the last of a frame has 1 132.
const PAYLOAD: usize = 1_748;
const FRAME_TICKS: u32 = 2_000_000;

/// A stand-in with one Kinect whose frames are `packed`.
struct Bench {
    /// Removed when the bench is.
    _folder: tempfile::TempDir,
    standin: Standin,
    frames: Vec<Vec<u8>>,
}

impl Bench {
    /// `script` follows the device's line.
    fn new(frames: Vec<Vec<u8>>, script: &str) -> Self {
        Self::with_devices(frames, &format!("kinect 1414 serial A1\nframes usb.frames\npace fast\n{script}"))
    }

    fn with_devices(frames: Vec<Vec<u8>>, script: &str) -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let file = fs::File::create(folder.path().join("usb.frames")).expect("a file");
        let mut writer = FrameWriter::new(std::io::BufWriter::new(file)).expect("writes");
        for (n, packed) in (1u32..).zip(&frames) {
            writer.write(n * FRAME_TICKS, packed).expect("writes");
        }
        writer.finish().expect("flushes");
        let standin = Standin::new(folder.path(), script).expect("the stand-in builds");
        Self { _folder: folder, standin, frames }
    }

    fn dump(&self, arguments: &[&str]) -> Dumped {
        let dumped = dump(&self.standin.environment(), arguments);
        let journal = self.standin.journal().expect("a journal");
        let wrong: Vec<_> = journal.of("error").collect();
        assert!(wrong.is_empty(), "libusb was misused: {wrong:?}");
        dumped
    }

    /// What was sent under these ticks.
    fn sent(&self, ticks: u32) -> FrameTruth {
        let truth = self.standin.truth().expect("a truth file");
        truth.frames(0).find(|frame| frame.ticks == ticks).expect("it was sent").clone()
    }

    /// What has to come out: the frame's bytes, all ones in place of the packets that did not arrive whole.
    fn expected(&self, ticks: u32) -> (Vec<u16>, String) {
        let sent = self.sent(ticks);
        let mut lost = sent.missing();
        // A damaged payload is not known to be damaged; everything else is.
        lost.extend(sent.corrupt.iter().filter(|(_, kind)| kind != "payload").map(|(packet, _)| *packet));
        lost.sort_unstable();
        let mut bytes = self.frames[sent.number as usize % self.frames.len()].clone();
        for packet in &lost {
            let start = usize::from(*packet) * PAYLOAD;
            let end = (start + PAYLOAD).min(bytes.len());
            bytes[start..end].fill(0xFF);
        }
        (lost, digest(&bytes))
    }

    /// All that came is what was sent.
    fn assert_identical(&self, frames: &[FrameLine]) {
        for frame in frames {
            assert_eq!((frame.encoding.as_str(), frame.bytes), ("Packed11", 422_400));
            assert_eq!((frame.lost.clone(), frame.digest.clone()), self.expected(frame.ticks), "{frame:?}");
        }
    }

    /// The library gave back everything it had.
    fn assert_all_given_back(&self) {
        let journal = self.standin.journal().expect("a journal");
        assert_eq!(journal.count("init"), journal.count("exit"));
        let last = journal.of("exit").last().expect("the context was shut down");
        for what in ["handles", "claims", "transfers", "in_flight", "references"] {
            assert_eq!(last.value(what), Some("0"), "{last:?}");
        }
    }
}

/// A packed frame of bytes that differ from frame to frame and from packet to packet.
fn made(seed: usize) -> Vec<u8> {
    (0..422_400).map(|byte| ((byte / 7 + byte / PAYLOAD + seed * 31) % 251) as u8).collect()
}

fn several(count: usize) -> Vec<Vec<u8>> {
    (0..count).map(made).collect()
}

fn ticks(frames: &[FrameLine]) -> Vec<u32> {
    frames.iter().map(|frame| frame.ticks / FRAME_TICKS).collect()
}

#[test]
fn whole_frames_come_out_identical_and_everything_is_closed() {
    let bench = Bench::new(several(4), "");
    let dumped = bench.dump(&["--frames", "12"]);
    assert_eq!(dumped.said("opened"), "library=Freenect serial=A1");
    let frames = dumped.frames();
    assert_eq!(frames.len(), 12, "{dumped:?}");
    assert!(frames.iter().all(|frame| frame.lost.is_empty() && frame.missing == 0));
    bench.assert_identical(&frames);
    assert_eq!((dumped.said("stopped"), dumped.code), ("Closed", Some(0)));
    bench.assert_all_given_back();
    let journal = bench.standin.journal().expect("a journal");
    assert!(journal.of("open").all(|open| open.value("what") == Some("Camera")), "the motor was not asked for");
}

#[test]
fn a_real_frame_comes_out_identical() {
    let Some(raw) = real_frame() else { return };
    let packed = pack(&raw);
    let bench = Bench::new(vec![packed.clone(), made(1)], "");
    let frames = bench.dump(&["--frames", "2"]).frames();
    assert_eq!(frames[0].digest, digest(&packed));
}

/// 16-bit little-endian codes to the eleven-bit stream, bit by bit as facts say it: most significant bit first.
fn pack(raw: &[u8]) -> Vec<u8> {
    let mut packed = vec![0u8; 422_400];
    for (pixel, code) in raw.as_chunks::<2>().0.iter().map(|code| u16::from_le_bytes(*code)).enumerate() {
        for bit in (0..11).filter(|bit| code >> (10 - bit) & 1 == 1) {
            let at = pixel * 11 + bit;
            packed[at / 8] |= 0x80 >> (at % 8);
        }
    }
    packed
}

#[test]
fn dropped_packets_are_marked_exactly_where_they_were() {
    let bench = Bench::new(
        several(5),
        "frame 2 drop 0\nframe 3 drop 17 40 41\nframe 5 drop 239 240 241\nframe 6 drop 0 1\nframe 8 drop 237 238 239 240 241\n\
         frame 10 drop 1 3 5 7 9 11 13 15 17 19\nframe 12 drop 241\n",
    );
    let frames = bench.dump(&["--frames", "15"]).frames();
    assert_eq!(ticks(&frames), (1..=15).collect::<Vec<_>>());
    bench.assert_identical(&frames);
    let lost: Vec<_> = frames.iter().filter(|frame| !frame.lost.is_empty()).map(|frame| frame.lost.len()).collect();
    assert_eq!(lost, [1, 3, 3, 2, 5, 10, 1]);
}

#[test]
fn a_frame_that_lacks_too_much_is_counted_as_missing() {
    // Six on end: the library gives the frame up. Frame 3 has the ticks of the fourth.
    let bench = Bench::new(several(5), "frame 3 drop 100 101 102 103 104 105\nframe 5 drop 0 1 2 3 4 5\n");
    let frames = bench.dump(&["--frames", "6"]).frames();
    assert_eq!(ticks(&frames), [1, 2, 3, 5, 7, 8]);
    assert_eq!(frames.iter().map(|frame| frame.missing).collect::<Vec<_>>(), [0, 0, 0, 1, 1, 0]);
    bench.assert_identical(&frames);
}

#[test]
fn damaged_packets_are_lost_packets_or_cost_their_frame() {
    let bench = Bench::new(
        several(5),
        "frame 1 corrupt magic 9\nframe 2 corrupt short 30 241\nframe 3 corrupt long 50\nframe 5 corrupt flag 70\n\
         frame 7 corrupt sequence 80\n",
    );
    let frames = bench.dump(&["--frames", "8"]).frames();
    bench.assert_identical(&frames);
    let of = |number: u32| frames.iter().find(|frame| frame.ticks == number * FRAME_TICKS);
    assert_eq!(of(2).map(|frame| frame.lost.clone()), Some(vec![9]));
    assert_eq!(of(3).map(|frame| frame.lost.clone()), Some(vec![30, 241]));
    // Whatever is lost is known to be: the numbers have no hole that is not counted.
    let mut before = None;
    for frame in &frames {
        if let Some(before) = before {
            assert_eq!((frame.ticks - before) / FRAME_TICKS, frame.missing + 1);
        }
        before = Some(frame.ticks);
    }
}

#[test]
fn random_losses_are_all_accounted_for() {
    let bench = Bench::new(several(7), "drop-random 0.01 7\n");
    let frames = bench.dump(&["--frames", "150"]).frames();
    assert_eq!(frames.len(), 150);
    // 242 packets at 1 % each: a whole frame is one in 11 (0.99^242 = 0.088).
    assert!(frames.iter().filter(|frame| frame.lost.is_empty()).count() < 75);
    bench.assert_identical(&frames);
    let span = (frames[149].ticks - frames[0].ticks) / FRAME_TICKS;
    let missing: u32 = frames[1..].iter().map(|frame| frame.missing).sum();
    assert_eq!(span, 149 + missing);
}

#[test]
fn the_cause_of_a_refusal_is_named() {
    let refusals = [
        ("no-permission", "no permission to open the Kinect"),
        ("busy", "in use"),
        ("busy not-found", "in use"),
        ("refuse-bandwidth", "the USB refused 16 of the 16 depth transfers"),
    ];
    for (fault, cause) in refusals {
        let bench = Bench::new(several(1), fault);
        for arguments in [&[][..], &["--serial", "A1"]] {
            let dumped = bench.dump(arguments);
            assert!(dumped.said("error").contains(cause), "{fault} {arguments:?}: {dumped:?}");
            assert_eq!(dumped.code, Some(1));
            bench.assert_all_given_back();
        }
    }
}

#[test]
fn the_kernels_driver_is_taken_off_and_put_back() {
    let bench = Bench::new(several(2), "kernel-driver");
    assert_eq!(bench.dump(&["--frames", "3"]).frames().len(), 3);
    let journal = bench.standin.journal().expect("a journal");
    assert_eq!((journal.count("detach"), journal.count("attach")), (1, 1));
}

#[test]
fn a_kinect_is_known_by_its_serial_number() {
    let script = "kinect 1414 serial A1\nframes usb.frames\nkinect 1473 serial B2\nframes usb.frames\nkinect k4w serial C3\n\
                  frames usb.frames\npace fast\n";
    let bench = Bench::with_devices(several(2), script);
    for (serial, device) in [("A1", "0"), ("B2", "1"), ("C3", "2")] {
        let dumped = bench.dump(&["--serial", serial, "--frames", "2"]);
        assert_eq!(dumped.said("opened"), format!("library=Freenect serial={serial}"), "{dumped:?}");
        let journal = bench.standin.journal().expect("a journal");
        let started: Vec<_> = journal.of("start").filter_map(|start| start.value("device")).collect();
        assert_eq!(started, [device]);
    }
    assert!(bench.dump(&[]).said("error").contains("there are 3 Kinects and none is named"));
    assert!(bench.dump(&["--serial", "D4"]).said("error").contains("found: A1, B2, C3"));
    assert!(bench.dump(&["--serial", "0000000000000000"]).said("error").contains("sixteen zeros"));
}

#[test]
fn tilt_lamp_and_accelerometer_work_on_a_1414_and_cost_no_depth_elsewhere() {
    let posture = ["--accelerometer", "--led", "red", "--tilt", "-10", "--frames", "20"];
    let bench = Bench::with_devices(several(2), "kinect 1414\nframes usb.frames\n");
    let dumped = bench.dump(&posture);
    assert_eq!((dumped.frames().len(), dumped.said("warning")), (20, ""), "{dumped:?}");
    assert!(dumped.said("acceleration").starts_with("x=0.000 y=9.807 z=0.000"), "{dumped:?}");
    let journal = bench.standin.journal().expect("a journal");
    let tilt = journal.of("tilt").next().expect("the motor was told");
    // Twice the degrees.
    assert_eq!(tilt.value("half_degrees"), Some("-20"));
    assert_eq!(journal.count("led"), 1);
    let bench = Bench::with_devices(several(2), "kinect 1473 audio none\nframes usb.frames\n");
    assert_eq!(bench.dump(&posture).frames().len(), 20);
}

#[test]
fn a_mute_device_is_given_up_in_time() {
    let bench = Bench::new(several(1), "mute-from-start");
    let before = Instant::now();
    let dumped = bench.dump(&[]);
    assert!(dumped.said("error").contains("did not answer within 5 s"), "{dumped:?}");
    // The process has ended although a thread of it hangs: a minute is far beyond the deadline of 5 s.
    assert!(before.elapsed() < Duration::from_secs(60));
}

#[test]
fn a_device_that_falls_mute_cannot_hold_up_the_stop() {
    // Stopping the stream is a request too, and it gets no answer.
    let bench = Bench::new(several(2), "pace real\nframe 10 mute\n");
    let dumped = bench.dump(&["--seconds", "1"]);
    assert_eq!(dumped.said("stopped"), "LeftBehind", "{dumped:?}");
    assert!(!dumped.frames().is_empty());
}

#[test]
fn a_stream_that_stalls_is_started_anew_and_if_that_does_not_help_it_is_an_error() {
    let bench = Bench::new(several(2), "pace real\nframe 10 stall until restart\n");
    let dumped = bench.dump(&["--frames", "15"]);
    assert_eq!(dumped.frames().len(), 15, "{dumped:?}");
    let journal = bench.standin.journal().expect("a journal");
    assert_eq!(
        (journal.count("open"), journal.count("start")),
        (2, 2),
        "started twice; opened once to be asked its number"
    );
    let bench = Bench::new(several(2), "pace real\nframe 10 stall until reopen\n");
    let dumped = bench.dump(&["--frames", "15"]);
    assert!(dumped.said("error").contains("no depth frame for 4 s"), "{dumped:?}");
    bench.assert_all_given_back();
}

#[test]
fn an_unplugged_kinect_is_told_and_everything_is_given_back() {
    let bench = Bench::new(several(2), "pace real\nframe 10 unplug\n");
    let dumped = bench.dump(&[]);
    assert!(dumped.said("error").contains("unplugged"), "{dumped:?}");
    assert_eq!((dumped.said("stopped"), dumped.code), ("Closed", Some(1)));
    bench.assert_all_given_back();
}

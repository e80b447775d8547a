//! What the stand-in sends, as the real libfreenect delivers it.

use std::path::Path;
use std::process::Command;
use std::{fs, thread};

use crate::support::{Host, assert_true, codes, digest, pack, three_frames, unpacked, write_frames};
use fake_libusb_control::FrameWriter;
use fake_libusb_control::frames::FRAME_TICKS;

/// `FREENECT_DEPTH_…`
const BIT11: u32 = 0;
const BIT10: u32 = 1;
const PACKED11: u32 = 2;
const PACKED10: u32 = 3;
const MM: u32 = 5;

/// Asserts that the frames arrive as `expected` says, at the fast pace, three times over.
fn delivers(format: u32, frames: &[Vec<u16>], expected: impl Fn(&[u16]) -> Vec<u8>) {
    let script = "kinect 1414\nframes frames\npace fast";
    let Some(mut host) = Host::start(script, |folder| write_frames(&folder.join("frames"), frames)) else { return };
    host.stream(format);
    host.receive(3 * frames.len() as u64);
    let finished = host.finish(&["stop", "close", "shutdown"]);
    finished.assert_clean();

    let expected: Vec<_> =
        frames.iter().map(|frame| expected(frame)).map(|bytes| (bytes.len(), digest(&bytes))).collect();
    let received = finished.received();
    for (index, frame) in received.iter().enumerate() {
        assert_eq!((frame.bytes, frame.digest), expected[index % frames.len()], "frame {index}");
        // Ticks go on over the loops of the file, 2 000 000 apart.
        assert_eq!(frame.ticks, index as u32 * FRAME_TICKS);
    }
    assert_eq!(received.len(), 3 * frames.len());
}

#[test]
fn packed_frames_arrive_as_they_were_sent() {
    delivers(PACKED11, &[codes(0), codes(1)], pack);
}

#[test]
fn libfreenect_unpacks_eleven_bits_to_the_codes() {
    delivers(BIT11, &[codes(0), codes(1)], unpacked);
}

#[test]
fn a_camera_asked_for_ten_bits_drops_the_lowest() {
    delivers(BIT10, &[codes(0)], |codes| unpacked(&codes.iter().map(|code| code >> 1).collect::<Vec<_>>()));
    // Packed: 307 200 × 10 bits; four pixels in five bytes.
    delivers(PACKED10, &[codes(0)], |codes| {
        let five_bytes = |group: &[u16]| {
            let bits = group.iter().fold(0_u64, |bits, code| bits << 10 | u64::from(code >> 1));
            bits.to_be_bytes()[3..].to_vec()
        };
        codes.chunks(4).flat_map(five_bytes).collect()
    });
}

#[test]
fn libfreenect_computes_millimetres_from_the_nominal_zero_plane() {
    // Codes of 10 m and more are not of this law: libfreenect's table overflows there.
    let frame: Vec<u16> = codes(0).iter().map(|&code| if code < 1_055 { code } else { 2_047 }).collect();
    let law = |code: u16| -> u16 {
        if code == 2_047 {
            return 0;
        }
        // Baseline 7.5 cm, reference plane 120 cm, pixel 0.1042 cm, constant shift 200: as the camera's replies say.
        let (baseline, plane, pixel) = (f64::from(7.5_f32), f64::from(120.0_f32), f64::from(0.1042_f32));
        let metric = (f64::from(code) / 4.0 - 200.0 - 0.375) * pixel;
        (10.0 * (metric * plane / (baseline - metric) + plane)) as u16
    };
    delivers(MM, &[frame], |codes| unpacked(&codes.iter().map(|&code| law(code)).collect::<Vec<_>>()));
}

#[test]
fn a_real_frame_passes_unchanged() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/kinect/raw11/nyu_raw11_le.pgm");
    let Ok(file) = fs::read(&path) else {
        println!("skipped: ../shared/data/kinect/raw11/nyu_raw11_le.pgm is not there");
        return;
    };
    let payload = &file[file.len() - 614_400..];
    let frame: Vec<u16> = payload.as_chunks().0.iter().map(|pixel| u16::from_le_bytes(*pixel)).collect();
    delivers(BIT11, std::slice::from_ref(&frame), unpacked);
    delivers(PACKED11, &[frame], pack);
}

#[test]
fn thirty_frames_a_second_over_ten_seconds_and_none_lost() {
    let Some(mut host) = Host::start("kinect 1414\nframes frames", three_frames) else { return };
    host.stream(PACKED11);
    host.ask("assemble");
    host.receive(301);
    let finished = host.finish(&["stop", "close", "shutdown"]);
    finished.assert_clean();
    let truth = finished.standin.truth().expect("reads");
    let sent: Vec<_> = truth.frames(0).collect();
    // The schedule: frame 300 begins 10 s after frame 0, to a slot of 125 µs.
    assert!((sent[300].seconds - sent[0].seconds - 10.0).abs() <= 125e-6, "{}", sent[300].seconds - sent[0].seconds);
    assert_true(&finished, 0);
    if sent[..=300].iter().all(|frame| frame.late.is_empty()) {
        let ticks: Vec<u32> = finished.received()[..=300].iter().map(|frame| frame.ticks).collect();
        assert_eq!(ticks, (0..=300).map(|index| index * FRAME_TICKS).collect::<Vec<_>>());
    } else {
        println!("packets were late: this machine let the host sleep for more than 32 ms");
    }
}

#[test]
fn dropped_packets_are_missing_exactly_where_the_script_says() {
    let script = "kinect 1414\nframes frames\npace fast\n\
                  frame 3 drop 17 40\nframe 5 drop 0\nframe 7 drop 241\nframe 9 drop 100 101 102 103 104\n\
                  frame 11 drop 240 241\nframe 12 drop 0 1\nframe 20 drop-random 0.002 7";
    let Some(mut host) = Host::start(script, three_frames) else { return };
    host.stream(PACKED11);
    host.ask("assemble");
    host.receive(200);
    let finished = host.finish(&["stop", "close", "shutdown"]);
    finished.assert_clean();
    assert_true(&finished, 0);
    let received = finished.received();
    let missing = |index: usize| received[index].missing.clone();
    assert_eq!([3, 5, 7, 11, 12].map(missing), [vec![17, 40], vec![0], vec![241], vec![240, 241], vec![0, 1]]);
    assert_eq!(missing(9), [100, 101, 102, 103, 104]);
    assert_eq!([4, 6, 8, 10, 13].map(missing), [const { Vec::new() }; 5]);
    // 180 frames × 242 packets × 0.002 = 87 packets, standard deviation 9.
    let by_chance: usize = received[20..200].iter().map(|frame| frame.missing.len()).sum();
    assert!((50..130).contains(&by_chance), "{by_chance}");
}

#[test]
fn a_hole_of_six_packets_costs_the_frame() {
    let script = "kinect 1414\nframes frames\npace fast\nframe 3 drop 10 11 12 13 14 15";
    let Some(mut host) = Host::start(script, three_frames) else { return };
    host.stream(PACKED11);
    host.receive(5);
    let finished = host.finish(&["stop", "close", "shutdown"]);
    let ticks: Vec<u32> = finished.received().iter().map(|frame| frame.ticks / FRAME_TICKS).collect();
    assert_eq!(ticks, [0, 1, 2, 4, 5]);
}

#[test]
fn damaged_packets_do_what_their_damage_does() {
    let script = "kinect 1414\nframes frames\npace fast\n\
                  frame 2 corrupt magic 5\nframe 4 corrupt payload 6\nframe 6 corrupt short 7\nframe 8 corrupt long 8\n\
                  frame 10 corrupt flag 9\nframe 12 corrupt sequence 10";
    let Some(mut host) = Host::start(script, three_frames) else { return };
    host.stream(PACKED11);
    host.ask("assemble");
    host.receive(14);
    let finished = host.finish(&["stop", "close", "shutdown"]);
    finished.assert_clean();
    let received = finished.received();
    let of = |number: u32| received.iter().find(|frame| frame.ticks == number * FRAME_TICKS);
    let whole = |number: u32| digest(&pack(&codes(number % 3)));
    // A packet without magic is lost; an inverted payload tells nobody.
    assert_eq!(of(2).map(|frame| &frame.missing), Some(&vec![5]));
    assert_eq!(of(4).map(|frame| (frame.missing.len(), frame.digest == whole(4))), Some((0, false)));
    // Half a packet is handed over as if it were whole: its end keeps the bytes of the frame before.
    assert_eq!(of(6).map(|frame| (frame.missing.len(), frame.digest == whole(6))), Some((0, false)));
    // Too long a packet is left out.
    assert_eq!(of(8).map(|frame| &frame.missing), Some(&vec![8]));
    // A flag that does not fit, and a jump of 100, cost the frame.
    assert_eq!((of(10), of(12)), (None, None));
    for number in [0, 1, 3, 5, 7, 11, 13] {
        assert_eq!(of(number).map(|frame| frame.digest), Some(whole(number)), "frame {number}");
    }
}

#[test]
fn a_frozen_camera_sends_one_image_under_ticks_that_go_on() {
    let script =
        "kinect 1414\nframes frames\npace fast\nframe 4 freeze\nframe 10 freeze off\nframe 12 clock 4294967000";
    let Some(mut host) = Host::start(script, three_frames) else { return };
    host.stream(PACKED11);
    host.receive(15);
    let finished = host.finish(&["stop", "close", "shutdown"]);
    let received = finished.received();
    // Frame 3 is image 0 of the file; from 4 on it stays; after the thaw the file has gone on to image 10 mod 3.
    let images: Vec<u32> = received
        .iter()
        .map(|frame| (0..3).find(|&image| digest(&pack(&codes(image))) == frame.digest).expect("an image of the file"))
        .collect();
    assert_eq!(images[..12], [0, 1, 2, 0, 0, 0, 0, 0, 0, 0, 1, 2]);
    let ticks: Vec<u32> = received.iter().map(|frame| frame.ticks).collect();
    assert_eq!(ticks[9..12], [18_000_000, 20_000_000, 22_000_000]);
    // The clock was set, and wraps: 4 294 967 000 + 2 000 000 − 2^32 = 1 999 704.
    assert_eq!(ticks[12..14], [4_294_967_000, 1_999_704]);
}

#[test]
fn a_host_that_comes_too_late_loses_what_was_sent_meanwhile() {
    let Some(mut host) = Host::start("kinect 1414\nframes frames", three_frames) else { return };
    host.stream(PACKED11);
    host.ask("assemble");
    host.receive(10);
    host.ask("sleep 0.5");
    host.receive(10);
    let finished = host.finish(&["stop", "close", "shutdown"]);
    finished.assert_clean();
    let truth = finished.standin.truth().expect("reads");
    // 500 ms without a look, of which 32 ms (256 packets) were in flight: at least (4000 − 256) slots × 242 / 266.7.
    let late: usize = truth.frames(0).map(|frame| frame.late.len()).sum();
    assert!(late >= 3_300, "{late}");
    // The frames sent in the half second are missing, not late.
    let last = finished.received().last().map(|frame| frame.ticks / FRAME_TICKS);
    assert!(last.is_some_and(|last| last >= 32), "{last:?}");
}

#[test]
fn a_feed_is_paced_by_the_camera_and_its_end_is_silence() {
    for fifo in [false, true] {
        let make = |folder: &Path| {
            if fifo {
                let made = Command::new("mkfifo").arg(folder.join("feed")).status().expect("mkfifo runs");
                assert!(made.success());
            }
        };
        let Some(mut host) = Host::start("kinect 1414\nfeed feed\npace fast", make) else { return };
        host.stream(PACKED11);
        let path = host.folder.path().join("feed");
        let feeder = thread::spawn(move || {
            let write = |to: &mut dyn std::io::Write| {
                let mut writer = FrameWriter::new(to).expect("writes");
                (0..20).for_each(|number| writer.write(number * 7, &pack(&codes(number))).expect("writes"));
            };
            if fifo {
                write(&mut fs::OpenOptions::new().write(true).open(path).expect("opens"));
            } else {
                write(&mut std::os::unix::net::UnixStream::connect(path).expect("connects"));
            }
        });
        host.receive(20);
        feeder.join().expect("feeds");
        // Nothing more comes, and waiting for it is no error.
        assert_eq!(host.ask("run 1 0.3"), 0);
        let finished = host.finish(&["stop", "close", "shutdown"]);
        finished.assert_clean();
        let received: Vec<_> = finished.received().iter().map(|frame| (frame.ticks, frame.digest)).collect();
        let sent: Vec<_> = (0..20).map(|number| (number * 7, digest(&pack(&codes(number))))).collect();
        assert_eq!(received, sent);
    }
}

#[test]
fn a_stall_is_ended_by_time_or_by_the_host() {
    let Some(mut host) = Host::start("kinect 1414\nframes frames\npace fast", three_frames) else { return };
    host.stream(PACKED11);
    host.receive(3);
    let mut control = host.control();
    control.send("stall 0.4").expect("obeys");
    host.ask("run 1 0.1"); // what was begun comes to its end
    let before = host.ask("frames");
    assert_eq!((host.ask("run 1 0.1"), host.ask("frames")), (0, before));
    host.receive(1);

    control.send("stall until restart").expect("obeys");
    host.ask("run 1 0.2");
    let before = host.ask("frames");
    assert_eq!((host.ask("run 1 0.2"), host.ask("frames")), (0, before));
    assert_eq!((host.ask("stop"), host.ask("start")), (0, 0));
    host.receive(1);

    control.send("stall until reopen").expect("obeys");
    assert_eq!((host.ask("stop"), host.ask("start")), (0, 0));
    let before = host.ask("frames");
    assert_eq!((host.ask("run 1 0.2"), host.ask("frames")), (0, before));
    for line in ["stop", "close", "open", "mode 2", "start"] {
        assert_eq!(host.ask(line), 0, "{line}");
    }
    host.receive(1);
    host.finish(&["stop", "close", "shutdown"]).assert_clean();
}

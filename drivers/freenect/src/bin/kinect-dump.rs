//! Prints what a Kinect sends, a line a frame: for trying a device by hand, and for the tests of this crate.
//!
//! ```text
//! kinect-dump [--serial NUMBER] [--frames N] [--seconds S] [--accelerometer] [--led green] [--tilt DEGREES]
//!
//! opened library=Freenect serial=A00362A08602047A
//! priority real-time
//! frame 1 ticks=2000000 encoding=Packed11 missing=0 lost=- bytes=422400 digest=8c0f…
//! ended Stopped
//! stopped Closed
//! ```
//!
//! Exit code 0, or 1 and a line `error …`.

use std::ops::ControlFlow;
use std::process::ExitCode;
use std::time::{Duration, Instant};
use tumbled_freenect::{Abandoned, Frame, Kinect, KinectError, Led, Options};

const USAGE: &str =
    "kinect-dump [--serial NUMBER] [--frames N] [--seconds S] [--accelerometer] [--led green|red|off] [--tilt DEGREES]";

struct Arguments {
    options: Options,
    frames: u64,
    time: Duration,
}

fn main() -> ExitCode {
    let Some(arguments) = arguments(std::env::args().skip(1)) else {
        eprintln!("usage: {USAGE}");
        return ExitCode::from(2);
    };
    match dump(&arguments) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            println!("error {error}");
            ExitCode::FAILURE
        }
    }
}

fn arguments(mut words: impl Iterator<Item = String>) -> Option<Arguments> {
    let mut read = Arguments { options: Options::default(), frames: u64::MAX, time: Duration::from_secs(86_400) };
    while let Some(word) = words.next() {
        match word.as_str() {
            "--serial" => read.options.serial = Some(words.next()?),
            "--frames" => read.frames = words.next()?.parse().ok()?,
            "--seconds" => read.time = Duration::try_from_secs_f64(words.next()?.parse().ok()?).ok()?,
            "--accelerometer" => read.options.accelerometer = Some(Duration::from_millis(100)),
            "--tilt" => read.options.tilt_deg = Some(words.next()?.parse().ok()?),
            "--led" => {
                read.options.led = Some(match words.next()?.as_str() {
                    "green" => Led::Green,
                    "red" => Led::Red,
                    "off" => Led::Off,
                    _ => return None,
                });
            }
            _ => return None,
        }
    }
    Some(read)
}

fn dump(arguments: &Arguments) -> Result<(), KinectError> {
    let abandoned = Abandoned::default();
    let mut kinect = Kinect::open("dump", arguments.options.clone(), &abandoned, &|| false)?;
    let opened = kinect.opened();
    println!("opened library={:?} serial={}", opened.library, opened.serial.as_deref().unwrap_or("-"));
    println!("priority {}", opened.priority);
    if let Some(step) = opened.posture_failed {
        println!("warning {step} failed");
    }
    let (mut seen, most) = (0, arguments.frames);
    kinect.start(Box::new(move |frame| {
        seen += 1;
        print(seen, frame);
        if seen < most { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    }));
    let until = Instant::now() + arguments.time;
    let outcome = loop {
        match kinect.look() {
            Some(outcome) => break Some(outcome),
            None if Instant::now() >= until => break None,
            None => std::thread::sleep(Duration::from_millis(20)),
        }
    };
    if let Some(reading) = kinect.acceleration() {
        let [x, y, z] = reading.metres_per_s2;
        println!("acceleration x={x:.3} y={y:.3} z={z:.3} tilt={:?}", reading.tilt_deg);
    }
    if let Some(Ok(end)) = &outcome {
        println!("ended {end:?}");
    }
    println!("stopped {:?}", kinect.stop());
    match outcome {
        Some(Err(error)) => Err(error),
        _ => Ok(()),
    }
}

fn print(number: u64, frame: &Frame<'_>) {
    let lost: Vec<String> = frame.lost_packets.iter().map(|packet| packet.to_string()).collect();
    let lost = if lost.is_empty() { "-".to_owned() } else { lost.join(",") };
    println!(
        "frame {number} ticks={} encoding={:?} missing={} lost={lost} bytes={} digest={:016x}",
        frame.ticks.0,
        frame.encoding,
        frame.missing_before,
        frame.bytes.len(),
        digest(frame.bytes)
    );
}

/// FNV-1a over 64 bits: enough to tell frames apart, and ten lines long.
fn digest(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
}

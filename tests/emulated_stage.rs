//! The turntable of a scene on a pseudo terminal, polled as a client polls a real one.

use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::os::fd::AsFd;
use std::path::Path;
use std::time::{Duration, Instant};

use tumbled::simulation::scenes;
use tumbled::simulation::stage::EmulatedStage;
use tumbled_io::live::{SessionClock, StopToken};
use tumbled_model::{Span, UnixNs};
use tumbled_serial::zaber::{Command, Heard, LineSettings, Poll, PollSettings, Rejection, Sample, Turn};

use crate::support::Workbench;
use crate::support::daemon::{Daemon, FREE_PORTS};

/// Counts of the emulated stage's turn.
const COUNTS_PER_TURN: f64 = 768_000.0;
const PATIENCE: Duration = Duration::from_secs(60);

/// A client's end: a terminal has no line, so its bytes take no time.
struct Client {
    port: File,
    poll: Poll,
    clock: SessionClock,
}

impl Client {
    fn open(path: &Path, clock: &SessionClock) -> Self {
        let port = OpenOptions::new().read(true).write(true).open(path).expect("opens");
        let line = LineSettings { byte_time: Span(0), ..LineSettings::default() };
        let settings = PollSettings { line, ..PollSettings::default() };
        Self { port, poll: Poll::new(settings, clock.now().rig), clock: clock.clone() }
    }

    /// Polls until `enough` of what was heard.
    fn hear(&mut self, enough: impl Fn(&[Heard]) -> bool) -> Vec<Heard> {
        let (mut heard, began) = (Vec::new(), Instant::now());
        while !enough(&heard) {
            assert!(began.elapsed() < PATIENCE, "{heard:?}, {:?}", self.poll.counts());
            match self.poll.turn(self.clock.now().rig) {
                Turn::Write(bytes) => {
                    // The other end has them while the write goes on: they have left when it began.
                    let left = self.clock.now().rig;
                    self.port.write_all(&bytes).expect("writes");
                    self.poll.written(left);
                }
                Turn::Wait(until) => {
                    let left = (until - self.clock.now().rig).0.max(0) / 1_000_000;
                    if is_readable(&self.port, left) {
                        let mut bytes = [0; 256];
                        let n = self.port.read(&mut bytes).expect("reads");
                        self.poll.heard(self.clock.now().rig, &bytes[..n], &mut heard);
                    }
                }
                Turn::Unanswered(_) | Turn::Reopen => {}
            }
        }
        heard
    }

    fn samples(&mut self, n: usize) -> Vec<Sample> {
        let samples = |heard: &[Heard]| -> Vec<Sample> {
            heard
                .iter()
                .filter_map(|heard| if let Heard::Sample(sample) = heard { Some(*sample) } else { None })
                .collect()
        };
        let heard = self.hear(|heard| samples(heard).len() >= n);
        samples(&heard)
    }
}

fn is_readable(port: &File, ms: i64) -> bool {
    use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
    let mut waiting = [PollFd::new(port.as_fd(), PollFlags::POLLIN)];
    let timeout = PollTimeout::try_from(ms.clamp(1, 1_000) as i32).expect("a timeout");
    poll(&mut waiting, timeout).is_ok_and(|ready| ready > 0)
}

fn degrees(sample: &Sample) -> f64 {
    sample.counts as f64 * 360.0 / COUNTS_PER_TURN
}

#[test]
fn polled_at_20_degrees_a_second_it_is_where_the_scene_is_within_the_doubt_of_the_poll() {
    let clock = SessionClock::start_on_system();
    let stop = StopToken::new().expect("a descriptor");
    let scene = scenes::load_endless("turntable-20dps", UnixNs(0)).expect("a scene");
    let stage = EmulatedStage::start(&scene, &clock, &stop).expect("a pseudo terminal").expect("the scene has a stage");
    let mut client = Client::open(stage.path(), &clock);
    let samples = client.samples(50);
    let turntable = scene.stage().expect("a stage");
    for sample in &samples {
        let truth = turntable.stage(sample.at).angle_rad.to_degrees();
        // Somewhere within ± half a round trip at 20°/s, and a count is 0.00047°.
        let doubt = 20.0 * sample.half_rtt.as_secs_f64() + 0.0005;
        assert!((degrees(sample) - truth).abs() <= doubt, "{} for {truth} ± {doubt}", degrees(sample));
        assert!(sample.moving && sample.trusted(), "{sample:?}");
    }
    // The poll's round trip holds what the device takes: 0.3 ms and 0.3 ms.
    assert!(samples.iter().all(|sample| sample.half_rtt >= Span(300_000)));

    // The scene has its motion: an order to move is refused, and the stage turns on.
    client.poll.ask(Command::Stop).expect("room");
    let refused = |heard: &Heard| matches!(heard, Heard::Answer { command: Command::Stop, .. });
    let heard = client.hear(|heard| heard.iter().any(refused));
    let answer = heard.iter().find(|heard| refused(heard)).expect("an answer");
    assert!(format!("{answer:?}").contains(Rejection::StatusBusy.word()), "{answer:?}");
    stop.stop();
    stage.join();
}

#[test]
fn a_live_scene_tells_where_its_stage_answers_and_one_without_a_stage_has_none() {
    let bench = Workbench::new();
    let mut daemon = Daemon::start(&bench, &[&["run", "--sim", "turntable-20dps"], &FREE_PORTS[..]].concat());
    daemon.once_said("turntable emulator on ");
    let (_, after) = daemon.said.split_once("turntable emulator on ").expect("a path");
    let path = after.split(',').next().expect("a path").to_owned();
    let clock = SessionClock::start_on_system();
    let samples = Client::open(Path::new(&path), &clock).samples(40);
    let (first, last) = (samples[0], samples[39]);
    let turned = degrees(&last) - degrees(&first);
    let expected = 20.0 * (last.at - first.at).as_secs_f64();
    let doubt = 20.0 * (last.half_rtt + first.half_rtt).as_secs_f64() + 0.001;
    assert!((turned - expected).abs() <= doubt, "{turned} for {expected} ± {doubt}");
    daemon.signal("INT");
    assert_eq!(daemon.finish().code, Some(0));
    assert!(!Path::new(&path).exists(), "it ends with the session");

    let scene = scenes::load_endless("tumble", UnixNs(0)).expect("a scene");
    let stop = StopToken::new().expect("a descriptor");
    assert!(EmulatedStage::start(&scene, &clock, &stop).expect("nothing to open").is_none());
}

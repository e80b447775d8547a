//! A scene's turntable on a serial port: an emulator that anything which speaks Zaber ASCII can poll.

use std::collections::VecDeque;
use std::io;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use tumbled_io::live::{PseudoTerminal, SessionClock, StopToken};
use tumbled_model::Span;
use tumbled_sim::scene::Scene;
use tumbled_sim::turntable::{Latency, Outgoing, ZaberEmulator};

/// What a device takes over an answer: from the request to the position, and from there to the reply.
const LATENCY: Latency = Latency { to_sample: Span(300_000), to_reply: Span(300_000) };
/// How often the stage is looked at while nobody asks: it may have come to rest, and says so.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// Bytes read at once: some ten requests.
const READ_BYTES: usize = 256;

/// A stage that answers on a pseudo terminal until the session's stop.
#[derive(Debug)]
pub struct EmulatedStage {
    path: PathBuf,
    thread: JoinHandle<()>,
}

impl EmulatedStage {
    /// Lets a scene's stage answer, where it is at each instant of the session; orders to move it refuses, since the scene
    /// has its motion. `None`: the scene has none.
    ///
    /// # Errors
    /// When the system has no pseudo terminal or no thread.
    pub fn start(scene: &Scene, clock: &SessionClock, stop: &StopToken) -> io::Result<Option<Self>> {
        let Some(emulator) = scene.emulator() else { return Ok(None) };
        let terminal = PseudoTerminal::open()?;
        let path = terminal.path().to_owned();
        let mut port = Port { terminal, emulator, clock: clock.clone(), stop: stop.clone(), answers: VecDeque::new() };
        let work = move || {
            if let Err(error) = port.answer_until_the_stop() {
                tracing::error!("the turntable emulator ended: {error}");
            }
        };
        let thread = std::thread::Builder::new().name("sim-stage".to_owned()).spawn(work)?;
        Ok(Some(Self { path, thread }))
    }

    /// The port that clients open.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Waits for its end: tell it to stop first.
    pub fn join(self) {
        self.thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
    }
}

struct Port {
    terminal: PseudoTerminal,
    emulator: ZaberEmulator,
    clock: SessionClock,
    stop: StopToken,
    /// A request has one answer, and no more requests are read before these are out.
    answers: VecDeque<Outgoing>,
}

impl Port {
    fn answer_until_the_stop(&mut self) -> io::Result<()> {
        let mut read = [0; READ_BYTES];
        let mut answers = Vec::new();
        while !self.stop.is_stopped() {
            if self.terminal.wait(LOOK_EVERY, &self.stop)? {
                let n = self.terminal.read(&mut read)?;
                let bytes = read.get(..n).unwrap_or_default();
                self.emulator.receive(self.clock.now().rig, bytes, LATENCY, &mut answers);
            } else {
                self.emulator.advance(self.clock.now().rig, &mut answers);
            }
            self.answers.extend(answers.drain(..));
            self.send()?;
        }
        Ok(())
    }

    /// Each when it is due. What nobody reads is dropped once the kernel keeps no more.
    fn send(&mut self) -> io::Result<()> {
        while let Some(Outgoing { at, bytes }) = self.answers.pop_front() {
            let left = u64::try_from((at - self.clock.now().rig).0).unwrap_or(0);
            self.stop.sleep_until(Instant::now() + Duration::from_nanos(left));
            self.terminal.write(&bytes)?;
        }
        Ok(())
    }
}

//! Keeps a source running: opens it, runs it, opens it again.

use super::clock::SessionClock;
use super::intake::{Intake, LedgerClosed};
use super::source::{Opener, Source, SourceError, SourceInfo, Summary};
use super::stop::StopToken;
use std::io;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tumbled_model::SourceState;

/// How long to wait before a source is opened again: doubled from the first to the last after each failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Backoff {
    /// After the first failure.
    pub first: Duration,
    /// At most. A source that ran this long starts over at the first.
    pub last: Duration,
}

impl Default for Backoff {
    /// 0.25 s to 8 s.
    fn default() -> Self {
        Self { first: Duration::from_millis(250), last: Duration::from_secs(8) }
    }
}

/// What happened to a supervised source, for the log.
#[derive(Debug)]
#[non_exhaustive]
pub enum Notice {
    /// It is open.
    Opened(SourceInfo),
    /// It could not be opened, or it failed; another attempt follows.
    Failed {
        /// Why.
        error: SourceError,
        /// When the next attempt is due.
        retry_in: Duration,
    },
    /// It ended for good, with what it did in all.
    Closed(Summary),
}

/// What a supervised source did until its end.
#[derive(Debug)]
pub struct SupervisedSummary {
    /// Its counts over all runs.
    pub summary: Summary,
    /// How often it was opened.
    pub opened: u64,
    /// Why it ended, when it was neither done nor told to stop.
    pub error: Option<SourceError>,
}

/// A source's thread.
#[derive(Debug)]
pub struct Supervised {
    thread: JoinHandle<SupervisedSummary>,
}

impl Supervised {
    /// Waits for the end; tell the source to stop first.
    ///
    /// # Panics
    /// When the source's thread did.
    pub fn join(self) -> SupervisedSummary {
        self.thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }
}

/// Runs a source on its thread `rx-SENSOR` until it is done or told to stop, opening it again when it fails.
///
/// The ledger learns of each change of state: opened, lost, closed. `first` is a source that is already open, because
/// its caller wanted to see an error at once. `notice` is called on the source's thread, never per packet.
///
/// # Errors
/// When the system has no thread left.
pub fn supervise(
    mut opener: Box<dyn Opener>,
    first: Option<Box<dyn Source>>,
    sink: Intake,
    clock: SessionClock,
    stop: StopToken,
    backoff: Backoff,
    mut notice: impl FnMut(Notice) + Send + 'static,
) -> io::Result<Supervised> {
    let name = format!("rx-{}", opener.sensor());
    let thread = std::thread::Builder::new().name(name).spawn(move || {
        let mut keeper = Keeper { sink, clock, stop, backoff, opened: 0, lost: false };
        let error = keeper.keep(opener.as_mut(), first, &mut notice);
        let summary = keeper.sink.counters().snapshot();
        notice(Notice::Closed(summary));
        SupervisedSummary { summary, opened: keeper.opened, error }
    })?;
    Ok(Supervised { thread })
}

struct Keeper {
    sink: Intake,
    clock: SessionClock,
    stop: StopToken,
    backoff: Backoff,
    opened: u64,
    lost: bool,
}

impl Keeper {
    /// Until the end; the error is one that no further attempt can mend.
    fn keep(
        &mut self,
        opener: &mut dyn Opener,
        mut first: Option<Box<dyn Source>>,
        notice: &mut dyn FnMut(Notice),
    ) -> Option<SourceError> {
        let mut pause = self.backoff.first;
        while !self.stop.is_stopped() {
            let started = Instant::now();
            let ended = match first.take().map_or_else(|| opener.open(), Ok) {
                Ok(source) => self.run_once(source, notice),
                Err(error) => Err(error),
            };
            let error = match ended {
                Ok(()) => break,
                // It was told to stop meanwhile: what then fails has failed at nobody's cost.
                Err(error) if error.is_worth_a_retry() && self.stop.is_stopped() => break,
                Err(error) if error.is_worth_a_retry() => error,
                Err(error) => return Some(error),
            };
            if started.elapsed() >= self.backoff.last {
                pause = self.backoff.first;
            }
            if let Err(error) = self.post_lost() {
                return Some(error);
            }
            notice(Notice::Failed { error, retry_in: pause });
            self.stop.wait(pause);
            pause = (pause * 2).min(self.backoff.last);
        }
        self.post(SourceState::Closed).err()
    }

    fn run_once(&mut self, source: Box<dyn Source>, notice: &mut dyn FnMut(Notice)) -> Result<(), SourceError> {
        self.opened += 1;
        self.lost = false;
        self.post(SourceState::Opened)?;
        notice(Notice::Opened(source.describe()));
        source.run(self.sink.again(), self.stop.clone()).map(|_| ())
    }

    /// Posts the loss once, however many attempts it takes to come back.
    fn post_lost(&mut self) -> Result<(), SourceError> {
        if !self.lost {
            self.lost = true;
            self.post(SourceState::Lost)?;
        }
        Ok(())
    }

    fn post(&mut self, state: SourceState) -> Result<(), SourceError> {
        let now = self.clock.now().rig;
        let posted = self.sink.state(now, state);
        posted.map_err(|LedgerClosed| SourceError::LedgerClosed { sensor: self.sink.sensor().clone() })
    }
}

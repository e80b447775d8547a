//! When to ask what: positions at a steady rate, commands in between, one request on the line at a time.
//!
//! No clock and no port: the caller says what time it is, writes what it is handed, and says when it has. Its loop is
//!
//! ```text
//!   match poll.turn(now) {
//!       Write(bytes)      ─▶ write; poll.written(when the last byte can have left at the earliest)
//!       Wait(until)       ─▶ read until then; poll.heard(now, bytes, &mut heard)
//!       Unanswered(what)  ─▶ tell whoever asked
//!       Reopen            ─▶ close, wait reopen_after(attempt), open, a new Poll
//!   }
//! ```

use super::address::MessageId;
use super::command::{Command, Setting};
use super::listener::{Counts, Heard, LineSettings, Listener};
use super::request::Request;
use std::collections::VecDeque;
use tumbled_model::{RigNs, Span};

/// How a stage is polled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PollSettings {
    /// The line.
    pub line: LineSettings,
    /// From one position to the next; [`Self::SHORTEST_PERIOD`] at least.
    pub period: Span,
    /// What is asked: [`Setting::EncoderPos`], or [`Setting::Pos`] on a stage without encoder.
    pub position: Setting,
    /// How often the stage is asked how far its encoder is from where it was told to be, until it refuses: that is how a
    /// slip shows. `None`: never.
    pub check: Option<Span>,
}

impl PollSettings {
    /// 100 Hz: request and reply are 5.1 ms of line time at 115 200 baud, adapters take some more.
    pub const SHORTEST_PERIOD: Span = Span::from_micros(10_000);
    /// Twice a second: it takes a slip's time to half a second for one exchange in 25.
    pub const CHECK: Span = Span::from_micros(500_000);
}

impl Default for PollSettings {
    /// The encoder at 50 Hz, and twice a second how far it is from where the stage was told to be.
    fn default() -> Self {
        Self {
            line: LineSettings::default(),
            period: Span::from_micros(20_000),
            position: Setting::EncoderPos,
            check: Some(Self::CHECK),
        }
    }
}

/// What the caller does next.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Turn {
    /// Write these bytes and call [`Poll::written`].
    Write(Vec<u8>),
    /// Nothing to write before then; read.
    Wait(RigNs),
    /// The stage did not answer this command. It is not sent again: the stage may have carried it out.
    Unanswered(Command),
    /// Ten requests in a row went unanswered: close the port and open it again.
    Reopen,
}

/// Whether the stage answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Freshness {
    /// No answer yet.
    Opening,
    /// It does.
    Live,
    /// The last three requests or more went unanswered: the angle is not known.
    Stale,
}

/// No room for another command.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{} commands wait already: the stage does not answer", Poll::MOST_COMMANDS)]
pub struct TooManyCommands;

/// A conversation with a stage.
#[derive(Clone, Debug)]
pub struct Poll {
    settings: PollSettings,
    listener: Listener,
    commands: VecDeque<Command>,
    /// The request that was handed out, and when it, or else its reply, is given up.
    asked: Option<(Request, RigNs)>,
    id: MessageId,
    due: RigNs,
    /// When the next check is due; `None`: none is.
    check_due: Option<RigNs>,
    misses: u32,
    answered: bool,
}

impl Poll {
    /// How many commands may wait.
    pub const MOST_COMMANDS: usize = 16;
    /// After so many misses in a row the angle counts as unknown.
    pub const STALE_MISSES: u32 = 3;
    /// After so many misses in a row the port is opened anew.
    pub const REOPEN_MISSES: u32 = 10;
    /// How far the encoder is from where the stage was told to be.
    const CHECK: Command = Command::Get(Setting::EncoderPosError);

    /// A conversation that begins at `now`. What is to be asked first ([`Command::OPENING`]) goes through [`Self::ask`].
    pub fn new(settings: PollSettings, now: RigNs) -> Self {
        let settings = PollSettings { period: settings.period.max(PollSettings::SHORTEST_PERIOD), ..settings };
        Self {
            settings,
            listener: Listener::new(settings.line),
            commands: VecDeque::new(),
            asked: None,
            id: MessageId::default(),
            due: now,
            check_due: settings.check.map(|check| now + check),
            misses: 0,
            answered: false,
        }
    }

    /// Sends a command as soon as the line is free. One that stops the stage goes first and takes all moves that wait
    /// off the queue.
    ///
    /// # Errors
    /// [`TooManyCommands`]: it is not taken. A stop always is.
    pub fn ask(&mut self, command: Command) -> Result<(), TooManyCommands> {
        if command.stops() {
            self.commands.retain(|waiting| !waiting.moves() && !waiting.stops());
            self.commands.push_front(command);
            return Ok(());
        }
        if self.commands.len() >= Self::MOST_COMMANDS {
            return Err(TooManyCommands);
        }
        self.commands.push_back(command);
        Ok(())
    }

    /// What to do at `now`.
    pub fn turn(&mut self, now: RigNs) -> Turn {
        if let Some((request, until)) = self.asked {
            if now < until {
                return Turn::Wait(until);
            }
            self.asked = None;
            self.listener.give_up();
            self.misses += 1;
            if ![self.position(), Self::CHECK].contains(&request.command) {
                return Turn::Unanswered(request.command);
            }
        }
        if self.misses >= Self::REOPEN_MISSES {
            return Turn::Reopen;
        }
        let check = self.check_due.filter(|due| *due <= now);
        let command = match self.commands.pop_front() {
            Some(command) => command,
            None if check.is_some() => {
                self.check_due = self.settings.check.map(|check| now + check);
                Self::CHECK
            }
            None if now < self.due => return Turn::Wait(self.due),
            None => {
                // On the grid; what was missed is not made up for.
                let period = self.settings.period.0;
                self.due = self.due + Span(period * ((now - self.due).0 / period + 1));
                self.position()
            }
        };
        let request = Request::new(self.settings.line.axis, self.id, command);
        self.id = self.id.next();
        self.asked = Some((request, now + self.settings.line.timeout));
        Turn::Write(request.encode())
    }

    /// The bytes of the last [`Turn::Write`] have left the host at `at`, or at the earliest then. Earlier than it was makes
    /// a sample's time less certain; later makes it wrong: a thread that is held up after its write may find the reply
    /// there already.
    pub fn written(&mut self, at: RigNs) {
        if let Some((request, until)) = &mut self.asked {
            *until = at + self.settings.line.timeout;
            self.listener.sent(at, request);
        }
    }

    /// The stage sent these bytes; the read that gave them returned at `at`. What they say is added to `out`.
    pub fn heard(&mut self, at: RigNs, bytes: &[u8], out: &mut Vec<Heard>) {
        let waited = self.listener.waiting().is_some();
        let before = out.len();
        self.listener.heard(at, bytes, out);
        let refuses =
            |heard: &Heard| matches!(heard, Heard::Answer { command: Self::CHECK, reply, .. } if !reply.accepted);
        if out.iter().skip(before).any(refuses) {
            // This firmware does not know it: once is enough.
            self.check_due = None;
        }
        if waited && self.listener.waiting().is_none() {
            self.asked = None;
            self.misses = 0;
            self.answered = true;
        }
    }

    /// Whether the stage answers.
    pub fn freshness(&self) -> Freshness {
        match (self.misses >= Self::STALE_MISSES, self.answered) {
            (true, _) => Freshness::Stale,
            (false, true) => Freshness::Live,
            (false, false) => Freshness::Opening,
        }
    }

    /// How often what happened.
    pub fn counts(&self) -> Counts {
        self.listener.counts()
    }

    fn position(&self) -> Command {
        Command::Get(self.settings.position)
    }
}

/// How long to wait before a port is opened again, the first attempt being number 0: 0.5, 1, then every 2 s. A stage that
/// is back is read again within 5 s, so no pause may be longer.
pub const fn reopen_after(attempt: u32) -> Span {
    match attempt {
        0 => Span::from_micros(500_000),
        1 => Span::from_micros(1_000_000),
        _ => Span::from_micros(2_000_000),
    }
}

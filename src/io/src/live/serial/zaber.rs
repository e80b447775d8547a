//! Zaber ASCII: who answers, then 50 questions a second.

use super::port::{Port, READ_BYTES};
use super::{Chunks, Ended, SerialTrouble, Stage};
use crate::live::stop::StopToken;
use std::time::{Duration, Instant};
use tumbled_model::{RigNs, Span};
use tumbled_serial::zaber::{
    Address, Checksums, Command, LineSettings, Message, MessageId, Parser, Poll, PollSettings, Reply, Request, Setting,
    Turn, byte_time,
};

/// A question without an answer is asked again, so often in all.
const ATTEMPTS: u8 = 3;
/// An answer comes within this, or not at all.
const ANSWER: Duration = Duration::from_millis(150);
/// Devices on a chain answer one after the other: nobody follows who has not begun by then.
const NEXT_DEVICE: Duration = Duration::from_millis(40);

/// Finds the stage: the first device of the chain, its first axis that has a full turn, and whether it has an encoder.
/// Asked before the source is open, so none of it is in the ledger: the core learns what it needs of the questions after it.
pub(super) fn find(port: &mut Port, baud: u32, stop: &StopToken) -> Result<Stage, SerialTrouble> {
    let mut finder =
        Finder { port, parser: Parser::new(Checksums::Required), id: MessageId::default(), stop, heard: 0 };
    let everyone = Address { device: 0, axis: 0 };
    let answers = finder.ask(everyone, Command::Get(Setting::DeviceId))?;
    let device = answers.iter().map(|reply| reply.address.device).filter(|device| *device > 0).min();
    let Some(device) = device else { return Err(SerialTrouble::NoAnswer { baud, heard: finder.heard }) };

    let whole = Address { device, axis: 0 };
    let turns = finder.ask(whole, Command::Get(Setting::LimitCycleDist))?;
    let Some(turns) = turns.first() else { return Err(SerialTrouble::NoAnswer { baud, heard: finder.heard }) };
    let axis = match rotary_axis(turns) {
        Some(axis) => Address { device, axis },
        None => return Err(SerialTrouble::NoRotaryAxis { device }),
    };

    let encoder = finder.ask(axis, Command::Get(Setting::EncoderPos))?;
    let has_encoder = encoder.first().is_none_or(|reply| reply.accepted);
    let position = if has_encoder { Setting::EncoderPos } else { Setting::Pos };
    Ok(Stage { axis, position })
}

/// The first axis with a full turn: a device tells the counts of all its axes in a row. A device that does not know the
/// setting, as of firmware before it, is taken at its first axis: the config says what a turn is.
fn rotary_axis(turns: &Reply) -> Option<u8> {
    if !turns.accepted {
        return Some(1);
    }
    let mut axes = (1..).zip(turns.data.split(' '));
    axes.find(|(_, counts)| counts.parse::<u32>().is_ok_and(|counts| counts > 0)).map(|(axis, _)| axis)
}

struct Finder<'a> {
    port: &'a mut Port,
    parser: Parser,
    id: MessageId,
    stop: &'a StopToken,
    /// Bytes so far.
    heard: u64,
}

impl Finder<'_> {
    /// Who answers what. Empty: nobody, or the stop came.
    fn ask(&mut self, address: Address, command: Command) -> Result<Vec<Reply>, SerialTrouble> {
        for _ in 0..ATTEMPTS {
            self.id = self.id.next();
            self.port.write(&Request { address, id: Some(self.id), command }.encode())?;
            let replies = self.replies(address)?;
            if !replies.is_empty() || self.stop.is_stopped() {
                return Ok(replies);
            }
        }
        Ok(Vec::new())
    }

    fn replies(&mut self, address: Address) -> Result<Vec<Reply>, SerialTrouble> {
        let mut replies = Vec::new();
        let mut until = Instant::now() + ANSWER;
        while !self.stop.is_stopped() {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            let mut read = [0; READ_BYTES];
            let n = self.port.read(left, &mut read)?;
            self.heard += n as u64;
            let (id, before) = (self.id, replies.len());
            self.parser.push(RigNs(0), read.get(..n).unwrap_or_default(), |_, message| match message {
                Message::Reply(reply) if reply.id == Some(id) && answers(&reply, address) => replies.push(reply),
                _ => {}
            });
            if replies.len() > before {
                if address.device != 0 {
                    break;
                }
                until = Instant::now() + NEXT_DEVICE;
            }
        }
        Ok(replies)
    }
}

fn answers(reply: &Reply, asked: Address) -> bool {
    asked.device == 0 || reply.address.device == asked.device
}

/// Asks until the stop. Requests and replies go into the ledger; what they mean is the core's to say.
pub(super) fn poll(
    port: &mut Port,
    stage: Stage,
    baud: u32,
    chunks: &mut Chunks,
    stop: &StopToken,
) -> Result<(), Ended> {
    let line = LineSettings { axis: stage.axis, byte_time: byte_time(baud), ..LineSettings::default() };
    let settings = PollSettings { line, position: stage.position, ..PollSettings::default() };
    let mut poll = Poll::new(settings, chunks.now());
    for command in Command::OPENING {
        // Fewer than may wait.
        poll.ask(command).unwrap_or(());
    }
    let (mut read, mut heard) = ([0; READ_BYTES], Vec::new());
    while !stop.is_stopped() {
        match poll.turn(chunks.now()) {
            Turn::Write(bytes) => {
                let began = chunks.now();
                port.write(&bytes)?;
                // When the last byte can have left at the earliest: the thread may be held up after the write, and find the
                // answer there already.
                let left = began + port.line_time(bytes.len());
                poll.written(left);
                chunks.push(left, &bytes)?;
            }
            Turn::Wait(until) => {
                let n = port.read(duration(until - chunks.now()), &mut read)?;
                let bytes = read.get(..n).unwrap_or_default();
                if !bytes.is_empty() {
                    let at = chunks.now();
                    poll.heard(at, bytes, &mut heard);
                    heard.clear();
                    chunks.push(at, bytes)?;
                }
            }
            // What the core has to know is asked again: its answer was lost.
            Turn::Unanswered(command) if Command::OPENING.contains(&command) => poll.ask(command).unwrap_or(()),
            Turn::Unanswered(_) => {}
            Turn::Reopen => return Err(SerialTrouble::Silent.into()),
        }
    }
    Ok(())
}

fn duration(span: Span) -> Duration {
    Duration::from_nanos(u64::try_from(span.0).unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use tumbled_serial::zaber::Warning;

    #[test]
    fn the_stage_is_the_first_axis_with_a_full_turn() {
        let axis = |accepted, data: &str| {
            let address = Address { device: 1, axis: 0 };
            let (id, busy, warning, data) = (None, false, Warning::NONE, data.to_owned());
            rotary_axis(&Reply { address, id, accepted, busy, warning, data })
        };
        assert_eq!((axis(true, "768000"), axis(true, "0 NA 360000")), (Some(1), Some(3)));
        assert_eq!((axis(true, "0"), axis(false, "BADCOMMAND")), (None, Some(1)));
    }
}

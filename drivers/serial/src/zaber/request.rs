//! A command on its way: `/device axis id words:CC`.

use super::address::{Address, MessageId, header};
use super::checksum::{checksum, digits, split};
use super::command::{Command, Rejection, Scope};

/// A command for somebody, under a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Request {
    /// Whom it is for; [`Self::new`] leaves the axis out where the command is for the device as a whole.
    pub address: Address,
    /// The number its reply will carry.
    pub id: Option<MessageId>,
    /// What is wanted.
    pub command: Command,
}

impl Request {
    /// A command for an axis, or for its device where the command is not for axes.
    pub fn new(axis: Address, id: MessageId, command: Command) -> Self {
        let address = match command.scope() {
            Scope::Axis => axis,
            Scope::Device => axis.whole(),
        };
        Self { address, id: Some(id), command }
    }

    /// The line with checksum and end; at most 45 bytes.
    pub fn encode(&self) -> Vec<u8> {
        let Address { device, axis } = self.address;
        let mut body = match (axis, self.id) {
            (0, None) => device.to_string(),
            (axis, None) => format!("{device} {axis}"),
            (axis, Some(id)) => format!("{device} {axis} {}", id.number()),
        };
        if self.command != Command::Status {
            body.push(' ');
            body.push_str(&self.command.to_string());
        }
        format!("/{body}:{:02X}\n", checksum(&body)).into_bytes()
    }
}

/// A line as a device sees it: its words may be no command at all.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RequestLine<'a> {
    /// Whom it is for.
    pub address: Address,
    /// The number its reply must carry.
    pub id: Option<MessageId>,
    /// It has a checksum, so its reply must have one.
    pub checked: bool,
    /// The words behind the numbers.
    pub words: &'a str,
}

impl<'a> RequestLine<'a> {
    /// Reads a line without its end. `None`: it is not a command line, or its checksum is wrong; devices say nothing to
    /// either.
    pub fn parse(line: &'a str) -> Option<Self> {
        let (body, found) = split(line.strip_prefix('/')?);
        if found.is_some_and(|found| digits(found) != Some(checksum(body))) {
            return None;
        }
        let head = header(body, 3);
        Some(Self { address: head.address, id: head.id, checked: found.is_some(), words: head.rest })
    }

    /// The command in it.
    ///
    /// # Errors
    /// What a device would answer; a number past 99 where an id stands is [`Rejection::BadMessageId`].
    pub fn command(&self) -> Result<Command, Rejection> {
        let first = self.words.split(' ').next().unwrap_or_default();
        if self.id.is_none() && !first.is_empty() && first.bytes().all(|byte| byte.is_ascii_digit()) {
            return Err(Rejection::BadMessageId);
        }
        Command::parse(self.words)
    }

    /// The same as a [`Request`], if its words are a command.
    pub fn request(&self) -> Option<Request> {
        Some(Request { address: self.address, id: self.id, command: self.command().ok()? })
    }
}

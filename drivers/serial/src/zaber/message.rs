//! What a Zaber device sends: replies, info lines and alerts.
//!
//! ```text
//!   reply   @DD A [id] FLAG STATUS WW data[:CC]     FLAG OK|RJ, STATUS IDLE|BUSY, WW the warning flag
//!   info    #DD A [id] text[:CC]                    further lines behind a reply
//!   alert   !DD A STATUS WW [data][:CC]             unasked, without id
//! ```
//!
//! Source: Zaber ASCII protocol manual, firmware 6 and 7.

use super::address::{Address, MessageId, header, word};
use super::checksum::{checksum, digits, split};
use super::warning::Warning;
use core::fmt::Write;

/// The longest line a device sends by default, its end included (`comm.packet.size.max`).
pub const PACKET_BYTES: usize = 80;

/// Whether a line needs a checksum to be believed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Checksums {
    /// Lines without one are refused. Devices answer with a checksum whatever is asked with one.
    #[default]
    Required,
    /// Lines without one are taken; where there is one it must be right.
    Optional,
}

/// A line from a device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Message {
    /// The answer to a command.
    Reply(Reply),
    /// A further line behind a reply.
    Info(Info),
    /// Something the device says by itself.
    Alert(Alert),
}

/// The answer to a command.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Reply {
    /// Who answers.
    pub address: Address,
    /// The command's id, if it had one.
    pub id: Option<MessageId>,
    /// `OK`; otherwise `RJ`: the command was not carried out, and [`Self::data`] says why.
    pub accepted: bool,
    /// `BUSY`: the axis moves; otherwise `IDLE`.
    pub busy: bool,
    /// The most urgent warning flag.
    pub warning: Warning,
    /// What was asked for; `0` where nothing was.
    pub data: String,
}

/// A further line behind a reply.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Info {
    /// Who says it.
    pub address: Address,
    /// The command's id, if it had one.
    pub id: Option<MessageId>,
    /// The text.
    pub text: String,
}

/// Something the device says by itself, e.g. that a move has ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Alert {
    /// Who says it.
    pub address: Address,
    /// `BUSY`: the axis moves; otherwise `IDLE`.
    pub busy: bool,
    /// The most urgent warning flag.
    pub warning: Warning,
    /// Further words, mostly none.
    pub data: String,
}

/// Why a line is not a message one may use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum MessageError {
    /// It does not begin like one.
    #[error("a line begins with `@`, `#` or `!`")]
    Start,
    /// The checksum is not that of the line.
    #[error("checksum {computed:02X} computed, another one in the line")]
    Checksum {
        /// The line's own.
        computed: u8,
    },
    /// There is no checksum, and one is required.
    #[error("no checksum: the device sends none, or the line was cut")]
    Unchecked,
    /// It goes on in a further line. No answer this program asks for does.
    #[error("goes on in a further line")]
    Continued,
    /// A word is not what it has to be there.
    #[error("{expected} expected")]
    Word {
        /// What would have been right.
        expected: &'static str,
    },
}

impl Message {
    /// Reads a line without its end.
    ///
    /// # Errors
    /// [`MessageError`]: what is wrong with it.
    pub fn parse(line: &str, checksums: Checksums) -> Result<Self, MessageError> {
        let rest = line.strip_prefix(['@', '#', '!']).ok_or(MessageError::Start)?;
        let (body, found) = split(rest);
        match found {
            Some(found) if digits(found) != Some(checksum(body)) => {
                return Err(MessageError::Checksum { computed: checksum(body) });
            }
            None if checksums == Checksums::Required => return Err(MessageError::Unchecked),
            _ => {}
        }
        if body.ends_with('\\') {
            return Err(MessageError::Continued);
        }
        match line.as_bytes().first() {
            Some(b'@') => Self::reply(body),
            Some(b'!') => Self::alert(body),
            _ => {
                let head = header(body, 3);
                Ok(Self::Info(Info { address: head.address, id: head.id, text: head.rest.to_owned() }))
            }
        }
    }

    fn reply(body: &str) -> Result<Self, MessageError> {
        let head = header(body, 3);
        let (flag, rest) = word(head.rest);
        let accepted = match flag {
            "OK" => true,
            "RJ" => false,
            _ => return Err(MessageError::Word { expected: "OK or RJ" }),
        };
        let (busy, warning, data) = state(rest)?;
        Ok(Self::Reply(Reply { address: head.address, id: head.id, accepted, busy, warning, data: data.to_owned() }))
    }

    fn alert(body: &str) -> Result<Self, MessageError> {
        let head = header(body, 2);
        let (busy, warning, data) = state(head.rest)?;
        Ok(Self::Alert(Alert { address: head.address, busy, warning, data: data.to_owned() }))
    }

    /// The line as the device sends it, with its end.
    pub fn encode(&self, with_checksum: bool) -> Vec<u8> {
        let (start, body) = match self {
            Self::Reply(reply) => {
                let flag = if reply.accepted { "OK" } else { "RJ" };
                let (status, warning) = (status(reply.busy), reply.warning);
                ('@', format!("{} {flag} {status} {warning} {}", numbers(reply.address, reply.id), reply.data))
            }
            Self::Info(info) => ('#', format!("{} {}", numbers(info.address, info.id), info.text)),
            Self::Alert(alert) => {
                let (status, warning) = (status(alert.busy), alert.warning);
                let body = format!("{} {status} {warning} {}", numbers(alert.address, None), alert.data);
                ('!', body.trim_end().to_owned())
            }
        };
        let end = if with_checksum { format!(":{:02X}", checksum(&body)) } else { String::new() };
        format!("{start}{body}{end}\r\n").into_bytes()
    }
}

/// `STATUS WW data`: busy, the flag, the rest.
fn state(text: &str) -> Result<(bool, Warning, &str), MessageError> {
    let (status, rest) = word(text);
    let busy = match status {
        "BUSY" => true,
        "IDLE" => false,
        _ => return Err(MessageError::Word { expected: "IDLE or BUSY" }),
    };
    let (flag, data) = word(rest);
    let warning = Warning::parse(flag).ok_or(MessageError::Word { expected: "a warning flag of two characters" })?;
    Ok((busy, warning, data))
}

fn status(busy: bool) -> &'static str {
    if busy { "BUSY" } else { "IDLE" }
}

/// `DD A id`, as devices print them: two digits, one, two.
fn numbers(address: Address, id: Option<MessageId>) -> String {
    let mut text = format!("{:02} {}", address.device, address.axis);
    if let Some(id) = id {
        write!(text, " {:02}", id.number()).expect("a String takes all text");
    }
    text
}

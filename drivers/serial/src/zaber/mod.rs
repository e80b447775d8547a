//! Zaber ASCII, firmware 6 and 7: rotary stages with an encoder that is polled.
//!
//! ```text
//!   bytes read ─ lines ─ message ─ parser ─┐
//!                                          ├─ listener ─▶ Sample: when, counts, moving, flag
//!   bytes written ─────── request ─────────┘      │
//!                                       poll: when to ask what
//! ```
//!
//! * [`Message`]: replies, info lines and alerts, read and written; [`Parser`]: the same out of a stream;
//! * [`Command`], [`Request`]: what is sent; [`RequestLine`]: the same as the device sees it;
//! * [`Listener`]: which reply belongs to which request, and when the stage was where it says;
//! * [`Poll`]: when to ask what; [`Identity`]: who the stage is; [`Scale`]: counts and radians.
//!
//! ```
//! use tumbled_model::{RigNs, Span};
//! use tumbled_serial::zaber::{Heard, Poll, PollSettings, Turn};
//!
//! let mut poll = Poll::new(PollSettings::default(), RigNs(0));
//! assert_eq!(poll.turn(RigNs(0)), Turn::Write(b"/1 1 0 get encoder.pos:4E\n".to_vec()));
//! poll.written(RigNs(2_300_000)); // 26 bytes at 115 200 baud
//! let mut heard = Vec::new();
//! poll.heard(RigNs(3_300_000), b"@01 1 00 OK BUSY -- 1066667:A7\r\n", &mut heard);
//! let Some(Heard::Sample(sample)) = heard.first() else { panic!("a position") };
//! // In the middle of the millisecond between, less half of the first byte's 86.8 us.
//! assert_eq!((sample.counts, sample.at), (1_066_667, RigNs(2_300_000 + (1_000_000 - 86_805) / 2)));
//! assert_eq!(sample.half_rtt, Span::from_micros(500));
//! ```

mod address;
mod checksum;
mod command;
mod identity;
mod listener;
mod message;
mod parser;
mod poll;
mod quickest;
mod request;
mod units;
mod warning;

pub use address::{Address, MessageId};
pub use checksum::checksum;
pub use command::{Command, Rejection, Scope, Setting, Switch};
pub use identity::Identity;
pub use listener::{Counts, Heard, LineSettings, Listener, PositionKind, Sample, byte_time, is_request};
pub use message::{Alert, Checksums, Info, Message, MessageError, PACKET_BYTES, Reply};
pub use parser::{LineCounts, Parser};
pub use poll::{Freshness, Poll, PollSettings, TooManyCommands, Turn, reopen_after};
pub use request::{Request, RequestLine};
pub use units::Scale;
pub use warning::{Severity, Warning};

//! Raw bytes from files and sensors into one ordered ledger: the impure shell's door for data.
//!
//! ```text
//!   .pcap .pcapng ─┐
//!   ROS 2 bag ─────┤ capture::open      capture::merge
//!   fakenect ──────┼──────────────▶ Capture ─────────▶ Event, Event, … ──▶ decoders
//!   depth PNGs ────┘  (one per input)      (by host time)
//!
//!   UDP sockets ────── live::Source ─▶ Intake ─▶ live::ledger ─▶ Event, Event, … ──▶ core, recorder
//! ```
//!
//! [`foreign`] is the way back: captures for other programs. Nothing here decodes a sensor's payload: it is handed on as it was received, with the instant the
//! host first had it and with every loss the file shows.
#![forbid(unsafe_code)]

pub mod capture;
pub mod foreign;
pub mod live;
pub mod machine;
pub mod recording;

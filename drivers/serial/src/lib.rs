//! What a turntable says on its serial port, and what it is asked. Pure: bytes and times in, values out.
//!
//! * [`zaber`]: Zaber ASCII: commands, replies, checksums, polling with stamps;
//! * [`line_stream`]: this project's own protocol for a microcontroller that reads an encoder;
//! * [`grbl`]: status lines of a home-made turntable without encoder;
//! * [`log`]: the bytes on the line with their times, as text;
//! * [`lines`]: bytes to lines, whatever the reads cut them into.
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing)]

pub mod grbl;
pub mod line_stream;
pub mod lines;
pub mod log;
pub mod zaber;

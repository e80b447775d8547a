//! What the libusb stand-in and the tests that use it have in common.
//!
//! * [`script`]: the line-based file that says which devices there are and what happens to them;
//! * [`fault`]: what can happen to them, by script or while they run;
//! * [`frames`]: depth frames in a file or through a pipe;
//! * [`truth`]: what the devices sent and what of it was lost;
//! * [`journal`]: what the library under test did;
//! * [`standin`]: building the stand-in, setting it up for a child process, and talking to it.
//!
//! Only the standard library: the stand-in is loaded into other programs.

pub mod fault;
pub mod frames;
pub mod journal;
pub mod script;
pub mod standin;
pub mod truth;

pub use fault::{Busy, Corruption, Fault, StallEnd};
pub use frames::{Frame, FrameReader, FrameWriter, PACKED_BYTES};
pub use journal::Journal;
pub use script::{Audio, Device, Frames, Model, Pace, Script, ScriptError, Timed, When};
pub use standin::{Control, Standin, Status};
pub use truth::{FrameTruth, Truth};

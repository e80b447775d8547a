//! Kinect v1 depth frames through libfreenect, with the packets that never came.
//!
//! ```text
//!  caller's thread                    usb thread, one a Kinect: owns context, device, callbacks
//!  Kinect::open ── spawn ───────────▶ Context ─▶ Device ─▶ (Posture: only when configured)
//!  Kinect::start ─ the sink ────────▶ start ─▶ events ─▶ chunk: Assembler ─▶ frame: sink(&Frame)
//!  Kinect::look  ◀─ ended, why ─────┘
//!  Kinect::stop  ── told; joined, or abandoned when it hangs in the library
//! ```
//!
//! * [`kinect`]: the handle; no call of it waits longer than its deadline, whatever the device does;
//! * [`frame`]: what a frame is, where it goes; [`options`]: which device, what else than depth; [`error`]: why not;
//! * [`abandoned`]: threads that hang in the library; [`mod@reset`]: the last remedy for a device that hangs;
//! * `worker`: the usb thread; `library`: context and device, closed in the right order;
//!   `callbacks`: what the library calls; `assembly`: packets to frames; `missing`: frames that never came;
//! * `said`: what the library logs; `symbols`: what it has; `posture`: tilt, lamp, accelerometer; [`priority`]: the usb
//!   thread's, while frames come; `playback`: the player of recorded frames that stands in for the library.
//!
//! Two libraries go by this name. The real one hands over every packet, so a frame is assembled here, packed as it was on
//! the wire, and its holes are known. The player (fakenect) has no packets; it hands over whole frames, 16 bits a pixel.
//!
//! Empty without the feature `usb`.
#![allow(unsafe_code, reason = "libfreenect is a C library; every unsafe block says why it is sound")]
#![cfg(feature = "usb")]

pub mod abandoned;
mod assembly;
mod callbacks;
pub mod error;
pub mod frame;
pub mod kinect;
mod library;
mod missing;
pub mod options;
mod playback;
mod posture;
pub mod priority;
pub mod reset;
mod said;
mod symbols;
mod worker;

pub use abandoned::Abandoned;
pub use error::{KinectError, PlaybackError};
pub use frame::{Frame, FrameSink};
pub use kinect::{End, Kinect, Opened, Stopped};
pub use library::Library;
pub use options::{Led, Options};
pub use posture::Acceleration;
pub use priority::Priority;
pub use reset::reset;

//! A stand-in for libusb: loaded before it, the real libfreenect believes in the Kinects of a script.
//!
//! ```text
//!  libfreenect ──▶ calls (the 30 C functions) ──▶ world ──▶ kinect ─┬─ camera, motor: control transfers
//!                                                   ▲              ├─ depth ◀─ source: frames to packets
//!  tests ──▶ remote (Unix socket) ──────────────────┘              └─ isochronous: packets into transfers
//! ```
//!
//! * `abi`: libusb's structures and numbers; `calls`: its functions;
//! * `world`: all state, behind one lock; `kinect`: one device and what happens to it;
//! * `camera`, `motor`: what they answer; `source`, `depth`, `packet`: what the camera sends; `isochronous`: how it arrives;
//! * `clock`: how time passes; `chronicle`, `pen`: the journal and the truth, and how they are written; `remote`: live control.
//!
//! Time on the bus is counted in slots of 125 µs, each of which may carry one packet. Nothing runs between calls: every
//! call first brings the bus to the present, slot by slot, so that what arrives never depends on when a thread woke.
#![allow(unsafe_code, reason = "this is a C library: it is given pointers, and fills the memory they point to")]

mod abi;
mod calls;
mod camera;
mod chronicle;
mod clock;
mod depth;
mod isochronous;
mod kinect;
mod motor;
mod packet;
mod pen;
mod remote;
mod source;
mod world;

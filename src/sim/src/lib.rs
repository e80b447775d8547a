//! The rig without hardware: simulated sensors that emit real packets and real frames, with the truth beside them.
//!
//! ```text
//!   shape, target, room ─▶ world (what a ray hits, at any instant) ─┬─ lidar ──▶ Velodyne packets ─┐
//!   motion ──────────────────────┘                                  └─ kinect ─▶ 11-bit frames ────┴─ transport ─▶ events
//! ```
//!
//! Pure and seeded: the same seed gives the same bytes on every machine and any number of threads. It encodes with the
//! crates that decode, and shares no noise constant with the core.
//!
//! * [`shape`]: triangle meshes and materials;
//! * [`target`]: the targets that come with it;
//! * [`room`]: floor, walls, stage, and a person who walks by;
//! * [`world`]: bodies in motion, and what a ray hits;
//! * [`motion`]: where a body is at any instant;
//! * [`noise`]: random numbers by name and index;
//! * [`lidar`]: Velodynes that send packets;
//! * [`kinect`]: depth cameras that send raw frames;
//! * [`turntable`]: the stage and the bytes on its serial line;
//! * [`clock`]: what a sensor's counter says at a true instant;
//! * [`transport`]: when what was sent is there;
//! * [`faults`]: what goes wrong, by a script;
//! * [`scene`]: what is simulated, as a file says it;
//! * [`session`]: everything the sensors send, in the order the host has it.
#![forbid(unsafe_code)]
#![deny(clippy::indexing_slicing)]

pub mod clock;
pub mod faults;
pub mod kinect;
pub mod lidar;
pub mod motion;
pub mod noise;
pub mod room;
pub mod scene;
pub mod session;
pub mod shape;
pub mod target;
pub mod transport;
pub mod turntable;
pub mod world;

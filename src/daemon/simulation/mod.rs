//! Simulated rigs: scene files, and what an operator of such a rig would have.
//!
//! * [`faults`]: fault files, and what was done by them;
//! * [`scenes`]: scenes by name or file;
//! * [`rig`]: the config of a simulated rig, as an operator would have it and as it is;
//! * [`meshes`]: surfaces that people bring; [`truth`]: where the target truly is;
//! * [`ledger`]: a simulated session as a ledger;
//! * [`live`]: a scene in real time, for a live session; [`stage`]: its turntable on a serial port.

pub mod faults;
pub mod ledger;
pub mod live;
pub mod meshes;
pub mod rig;
#[cfg(test)]
mod scene_tests;
pub mod scenes;
pub mod stage;
pub mod truth;

pub use ledger::SimulatedLedger;
pub use scenes::{SCHEME, scene_of};

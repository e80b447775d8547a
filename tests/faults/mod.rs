//! What goes wrong with live hardware, case by case: docs/reliability.md says which test asserts what.

mod clocks;
mod killed;
mod kinect;
mod losses;
mod nonsense;
mod session;
mod wire;

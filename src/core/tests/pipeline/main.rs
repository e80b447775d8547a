//! The whole core, from a ledger to epochs, notices and health, on synthetic sessions whose truth is known.

mod clocks;
mod determinism;
mod health;
mod interleaving;
mod loss;
mod points;
mod skips;
mod states;
mod support;
mod turns;
mod turntable;
mod watermarks;
// The synthetic sensor of the decoder's own tests.
#[allow(dead_code, reason = "this binary uses its part")]
#[path = "../../../../drivers/velodyne/tests/support/synth.rs"]
mod synth;

//! Synthetic sessions, running them, and comparing everything that comes out.

pub(crate) mod chance;
pub(crate) mod compare;
pub(crate) mod devices;
pub(crate) mod faults;
pub(crate) mod ledger;
pub(crate) mod rig;
pub(crate) mod tally;

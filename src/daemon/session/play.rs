//! Inputs played through the core: what `replay` and `evaluate` share, so that they cannot differ.

use tumbled_model::Event;

use super::pace::Waited;
use super::{Checkpoint, Engine, Pace, Step};
use crate::cli::Failure;
use crate::decoding::Inputs;

/// Whoever wants what is played.
pub trait Listener {
    /// An event comes, before the core has it.
    fn event(&mut self, _event: &Event) {}

    /// What came out of an event.
    ///
    /// # Errors
    /// What ends the play, e.g. an output that cannot be written.
    fn step(&mut self, step: &Step<'_>) -> Result<(), Failure>;

    /// Everything is played: the chain's value at the end.
    fn end(&mut self, _checkpoint: &Checkpoint) {}

    /// Called before every event, and every 50 ms while one is waited for: what is due by this machine's clock.
    fn waiting(&mut self) {}
}

/// Every event through the core; false when a stop came before the end.
///
/// # Errors
/// An input that turns out unreadable, and those of [`Listener::step`].
pub fn play(
    inputs: &mut Inputs,
    engine: &mut Engine,
    listener: &mut impl Listener,
    pace: &mut Pace,
) -> Result<bool, Failure> {
    while let Some(event) = inputs.next_event()? {
        loop {
            listener.waiting();
            match pace.wait(event.arrived) {
                Waited::Due => break,
                Waited::NotYet => {}
                Waited::Stopped => return Ok(false),
            }
        }
        listener.event(&event);
        listener.step(&engine.step(&event))?;
    }
    listener.step(&engine.finish())?;
    listener.end(&engine.checkpoint());
    Ok(true)
}

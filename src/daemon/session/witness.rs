//! The witness of a recording that is of a part of a session: the hash of its events, once a second.
//!
//! A replay of such a recording acquires the target anew, so the session's own states are nothing to compare with; that its
//! events are those which came is what `tumbled verify` can say of it.

use tumbled_io::recording::{RecordingHeader, ResultKind, ResultMessage, Witness};
use tumbled_model::Event;

use super::chain::{Chain, Checkpoint, rig_digest};

/// From one checkpoint to the next, ns.
const EVERY_NS: i64 = 1_000_000_000;

/// Hashes what is recorded.
#[derive(Debug)]
pub(super) struct EventWitness {
    chain: Chain,
    t_ns: i64,
    due_ns: Option<i64>,
}

impl EventWitness {
    /// Of a recording with this header.
    pub(super) fn of(header: &RecordingHeader) -> Self {
        Self { chain: Chain::new(rig_digest(&header.config, &header.files)), t_ns: 0, due_ns: None }
    }
}

impl Witness for EventWitness {
    fn kind(&self) -> ResultKind {
        Checkpoint::kind()
    }

    fn event(&mut self, event: &Event) -> Option<ResultMessage> {
        self.chain.event(event);
        self.t_ns = self.t_ns.max(event.arrived.0);
        let due = *self.due_ns.get_or_insert(self.t_ns.saturating_add(EVERY_NS));
        if self.t_ns < due {
            return None;
        }
        self.due_ns = Some(self.t_ns.saturating_add(EVERY_NS));
        self.end()
    }

    fn end(&mut self) -> Option<ResultMessage> {
        Some(self.chain.checkpoint(self.t_ns).of_events_alone().to_message())
    }
}

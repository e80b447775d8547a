//! What a session computed, kept beside its ledger: JSON messages that viewers open and `tumbled verify` compares with.
//!
//! A result is no event: it has no place in the ledger, and a replay does not read it. Its message is the JSON text
//! alone, under a schema; its `sequence` holds the low 32 bits of the `seq` it follows.

use super::recorder::Recorder;
use bytes::Bytes;
use tumbled_model::RigNs;

/// The topic of the checkpoints of a session's hash chain.
pub const CHECKPOINTS: &str = "/checkpoint";

/// The message encoding that marks a results' channel.
pub(crate) const ENCODING: &str = "json";

/// The largest result that is recorded or read.
pub const MAX_RESULT_BYTES: usize = 1 << 20;

/// Results read and not yet taken; more are left out. An hour of checkpoints.
pub(crate) const KEPT: usize = 4_096;

/// A kind of result: its topic and the JSON Schema of its messages.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ResultKind {
    /// The topic, e.g. [`CHECKPOINTS`].
    pub topic: &'static str,
    /// The schema's name.
    pub schema_name: &'static str,
    /// The schema, JSON.
    pub schema: String,
}

/// One result.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ResultMessage {
    /// Its topic.
    pub topic: String,
    /// When it was computed, on the session's timeline.
    pub t: RigNs,
    /// The event it follows.
    pub seq: u64,
    /// JSON, at most [`MAX_RESULT_BYTES`].
    pub json: Bytes,
}

impl Recorder {
    /// Records a result beside the ledger; `false` when it was not: the recording has stopped, or it is too large.
    pub fn write_result(&mut self, kind: &ResultKind, t: RigNs, seq: u64, json: &[u8]) -> bool {
        if json.len() > MAX_RESULT_BYTES || self.summary().stopped.is_some() {
            return false;
        }
        match self.append_result(kind, t, seq, json) {
            Ok(()) => true,
            Err(reason) => {
                self.stop(reason);
                false
            }
        }
    }
}

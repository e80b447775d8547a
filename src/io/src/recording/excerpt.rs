//! A recording of a part of a session: begun in its middle, or of its newest events.
//!
//! What a session computes depends on all that went before, so its results are none of such a recording's. A [`Witness`] makes
//! results of its own from the events alone, from the recording's first one on.

use std::path::PathBuf;

use tumbled_model::Event;

use super::error::RecorderError;
use super::header::RecordingHeader;
use super::recorder::{Recorder, RecorderOptions, RecorderState, RecordingSummary};
use super::results::{ResultKind, ResultMessage};
use super::ring::Excerpt;

/// Makes results from the events that are recorded.
pub trait Witness: Send {
    /// The kind of its results.
    fn kind(&self) -> ResultKind;
    /// An event was recorded; the result that follows it, if one is due.
    fn event(&mut self, event: &Event) -> Option<ResultMessage>;
    /// The last result.
    fn end(&mut self) -> Option<ResultMessage>;
}

/// What a recording says of itself, once it is known with what it begins.
pub type HeaderOf = Box<dyn FnOnce(&Excerpt) -> RecordingHeader + Send>;
/// Who bears witness for a recording of that header.
pub type WitnessOf = Box<dyn FnOnce(&RecordingHeader) -> Box<dyn Witness> + Send>;

/// What is to be recorded where.
pub struct Plan {
    /// The first part.
    pub path: PathBuf,
    /// How it is written.
    pub options: RecorderOptions,
    /// Its header.
    pub header: HeaderOf,
    /// Its witness.
    pub witness: WitnessOf,
}

/// A recorder with its witness.
pub struct MidSession {
    recorder: Recorder,
    witness: Box<dyn Witness>,
}

impl MidSession {
    /// Begins a recording whose first events will be those of `excerpt`; it writes none of them yet.
    ///
    /// # Errors
    /// As [`Recorder::create`].
    pub fn begin(plan: Plan, excerpt: &Excerpt) -> Result<Self, RecorderError> {
        let header = (plan.header)(excerpt);
        let witness = (plan.witness)(&header);
        Ok(Self { recorder: Recorder::create(&plan.path, header, plan.options)?, witness })
    }

    /// The recorder.
    pub fn recorder(&self) -> &Recorder {
        &self.recorder
    }

    /// Records an event; `false` when it was not (the recorder's state says why).
    pub fn write(&mut self, event: &Event) -> bool {
        let recorded = self.recorder.write(event);
        if recorded && let Some(result) = self.witness.event(event) {
            self.put(&result);
        }
        recorded
    }

    /// As [`Recorder::sync`].
    pub fn sync(&mut self) {
        self.recorder.sync();
    }

    /// The last result, and the end.
    pub fn finish(mut self) -> RecordingSummary {
        if matches!(self.recorder.state(), RecorderState::Recording)
            && let Some(result) = self.witness.end()
        {
            self.put(&result);
        }
        self.recorder.finish()
    }

    fn put(&mut self, result: &ResultMessage) {
        self.recorder.write_result(&self.witness.kind(), result.t, result.seq, &result.json);
    }
}

impl core::fmt::Debug for MidSession {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("MidSession").field("recorder", &self.recorder).finish_non_exhaustive()
    }
}

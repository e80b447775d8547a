//! Carries orders out, wherever they came from.

use tumbled_io::live::{ControlIntake, SessionClock};
use tumbled_model::{Body, Command};

use super::orders::{Order, OrderLine, RecordingReply, Reply};
use crate::session::recordings::{Recordings, Written};
use crate::session::run_info::RunInfo;

/// Where orders are taken. Clones serve the same session.
#[derive(Clone, Debug)]
pub struct Desk {
    control: ControlIntake,
    clock: SessionClock,
    background_s: f64,
    recordings: Recordings,
}

impl Desk {
    /// Of a running session; `background_s` is the config's.
    pub fn new(control: ControlIntake, clock: SessionClock, background_s: f64, recordings: Recordings) -> Self {
        Self { control, clock, background_s, recordings }
    }

    /// What is being recorded; `None`: nothing.
    pub fn recording(&self) -> Option<RecordingReply> {
        self.recordings.recording().map(RecordingReply::from)
    }

    /// Carries an order out: a line of JSON. A snapshot takes as long as the disk does.
    pub fn carry_out(&self, line: &[u8]) -> Reply {
        let request = match serde_json::from_slice::<OrderLine>(line) {
            Ok(request) => request,
            Err(error) => return Reply::Error { message: format!("this is no order: {error}") },
        };
        let t_ns = self.clock.now().rig.0;
        match self.obey(&request) {
            Ok(recording) => {
                tracing::info!(order = ?request.order, "an operator's order");
                Reply::Done { order: request.order, t_ns, recording }
            }
            Err(message) => Reply::Error { message },
        }
    }

    fn obey(&self, request: &OrderLine) -> Result<Option<RecordingReply>, String> {
        let file = request.file.as_deref();
        match request.order {
            Order::RecordStart => {
                let file = self.recordings.start(file)?;
                tracing::info!(file = %file.display(), "recording");
                Ok(Some(RecordingReply { file, events: 0, bytes: 0, covers_s: 0.0 }))
            }
            Order::RecordStop => Ok(Some(self.recordings.stop()?.into())),
            Order::Snapshot => Ok(Some(self.recordings.snapshot(file)?.into())),
            Order::Note => {
                let info = request.run_info();
                if info.is_empty() {
                    return Err("a note has a text, a name or an operator".to_owned());
                }
                info.check()?;
                self.note(info)?;
                Ok(None)
            }
            _ => {
                self.post(request.command(self.background_s)?)?;
                Ok(None)
            }
        }
    }

    /// For recordings to come, and as a marker for the one that runs.
    fn note(&self, info: RunInfo) -> Result<(), String> {
        let mut text = info.line();
        let end = (0..=text.len().min(Command::TEXT_BYTES)).rev().find(|end| text.is_char_boundary(*end));
        text.truncate(end.unwrap_or_default());
        self.post(Command::Marker { text: text.into() })?;
        self.recordings.info().change(info);
        Ok(())
    }

    fn post(&self, command: Command) -> Result<(), String> {
        let arrived = self.clock.now().rig;
        self.control.post(arrived, Body::Command(command)).map_err(|error| error.to_string())
    }
}

impl From<Written> for RecordingReply {
    fn from(Written { file, events, bytes, covers_s }: Written) -> Self {
        Self { file, events, bytes, covers_s }
    }
}

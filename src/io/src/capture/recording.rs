//! A recording of this program as a capture.

use super::{BrokenOff, CaptureError, CaptureRecord, CaptureSummary, LedgerPlace, Place, RecordSource, StampOrigin};
use crate::recording::{Reader, RecordingHeader};
use std::path::PathBuf;
use tumbled_model::{Body, UnixNs};

/// Payload of a position packet; what else a LiDAR sends is taken for data.
const POSITION_BYTES: usize = 512;

pub(crate) struct RecordingSource {
    reader: Reader,
}

impl RecordingSource {
    pub(crate) fn open(parts: &[PathBuf]) -> Result<Self, CaptureError> {
        Ok(Self { reader: Reader::open(parts)? })
    }

    pub(crate) fn stamp_origin(&self) -> StampOrigin {
        if self.reader.header().synthetic_times { StampOrigin::Synthetic } else { StampOrigin::Ledger }
    }

    fn at_end(&self, summary: &mut CaptureSummary) {
        let info = self.reader.info();
        for part in &info.parts {
            let broken = |damage: &crate::recording::Damage| BrokenOff {
                path: part.path.clone(),
                place: Place::Byte(damage.offset),
                detail: damage.detail.clone(),
            };
            // Damage that was passed over does not break a file off; the recording's own report has it.
            summary.broken_off.extend(part.damage.iter().filter(|damage| !damage.passed_over).map(broken));
        }
        summary.recording = Some(Box::new(info.clone()));
    }
}

impl RecordSource for RecordingSource {
    fn next_record(&mut self, summary: &mut CaptureSummary) -> Option<Result<CaptureRecord, CaptureError>> {
        let event = match self.reader.next() {
            Some(Ok(event)) => event,
            Some(Err(error)) => return Some(Err(error.into())),
            None => {
                self.at_end(summary);
                return None;
            }
        };
        if let Body::LidarPacket { sensor, bytes } = &event.body {
            let traffic = summary.sensor(sensor);
            let is_position = bytes.len() == POSITION_BYTES;
            *if is_position { &mut traffic.position_packets } else { &mut traffic.data_packets } += 1;
        }
        let host = self.reader.header().unix_at_zero.0.saturating_add(event.arrived.0).max(0);
        let ledger = Some(LedgerPlace { seq: event.seq, arrived: event.arrived });
        Some(Ok(CaptureRecord { host: UnixNs(host), body: event.body, ledger }))
    }

    fn known_earliest(&self) -> Option<Option<UnixNs>> {
        None
    }

    fn recording(&self) -> Option<&RecordingHeader> {
        Some(self.reader.header())
    }
}

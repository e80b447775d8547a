//! Several captures into one ledger, by host time.

use super::summary::StampOrigin;
use super::{Capture, CaptureError, CaptureRecord, CaptureSummary};
use tumbled_model::{Event, RigNs, UnixNs};

/// Events of one or several captures in the order of their host stamps.
///
/// * `seq` counts from 0 without gaps.
/// * `arrived` is the host stamp less the earliest host stamp over all records of all inputs, so never negative.
/// * Each input keeps its file order. A record whose stamp lies before that of the record in front of it comes as soon
///   as that one is out; `arrived` then steps back, as the file does. Of equal stamps the input named first goes first.
/// * The same inputs in the same order give the same events.
/// * A single recording keeps the `seq` and `arrived` it was recorded with, to the bit.
/// * An error ends its own input only; the others go on.
#[derive(Debug)]
pub struct Merged {
    inputs: Vec<Input>,
    epoch: Option<UnixNs>,
    next_seq: u64,
    is_ledger: bool,
}

#[derive(Debug)]
struct Input {
    capture: Capture,
    head: Option<Result<CaptureRecord, CaptureError>>,
}

/// Merges captures into ledger events.
///
/// Reads pcaps, and recordings that are not alone, twice (see [`Capture::earliest_host`]). The captures should be at their start.
///
/// # Errors
/// When an input cannot be read again, and when inputs with times are mixed with inputs whose times are
/// synthetic: these have no common time to be merged by.
pub fn merge(captures: Vec<Capture>) -> Result<Merged, CaptureError> {
    let is_synthetic = |capture: &&Capture| capture.summary().stamp_origin == StampOrigin::Synthetic;
    let synthetic = captures.iter().find(is_synthetic);
    let real = captures.iter().find(|capture| !is_synthetic(capture));
    if let (Some(synthetic), Some(real)) = (synthetic, real) {
        let (synthetic, real) = (synthetic.path().to_owned(), real.path().to_owned());
        return Err(CaptureError::UnrelatedTimes { synthetic, real });
    }
    let recording = if let [only] = captures.as_slice() { only.recording() } else { None };
    let is_ledger = recording.is_some();
    let mut epoch = recording.map(|header| header.unix_at_zero);
    if !is_ledger {
        for capture in &captures {
            epoch = [epoch, capture.earliest_host()?].into_iter().flatten().min();
        }
    }
    let read_head = |mut capture: Capture| {
        let head = capture.next();
        Input { capture, head }
    };
    Ok(Merged { inputs: captures.into_iter().map(read_head).collect(), epoch, next_seq: 0, is_ledger })
}

impl Merged {
    /// Whether the events are a recorded ledger, with its own ticks and anchors.
    pub fn is_ledger(&self) -> bool {
        self.is_ledger
    }

    /// The wall time at `t_ns` 0: the recorded one, else the earliest host stamp over all inputs; `None` when no input has any record.
    pub fn epoch(&self) -> Option<UnixNs> {
        self.epoch
    }

    /// The inputs, in the order they were given; their summaries are complete once this iterator has ended.
    ///
    /// Each is up to one record ahead of the events.
    pub fn captures(&self) -> impl Iterator<Item = &Capture> {
        self.inputs.iter().map(|input| &input.capture)
    }

    /// The inputs' summaries, in the order they were given.
    pub fn summaries(&self) -> impl Iterator<Item = &CaptureSummary> {
        self.captures().map(Capture::summary)
    }
}

impl Iterator for Merged {
    type Item = Result<Event, CaptureError>;

    fn next(&mut self) -> Option<Self::Item> {
        // An error has no time: it is reported before anything else, as i64::MIN is before all stamps.
        let time = |input: &Input| match input.head.as_ref()? {
            Ok(record) => Some(record.host.0),
            Err(_) => Some(i64::MIN),
        };
        let times = self.inputs.iter_mut().filter_map(|input| time(input).map(|time| (time, input)));
        // The first of equal minima.
        let (_, input) = times.min_by_key(|(time, _)| *time)?;
        let record = match input.head.take()? {
            Ok(record) => record,
            Err(error) => return Some(Err(error)),
        };
        input.head = input.capture.next();
        if let Some(place) = record.ledger.filter(|_| self.is_ledger) {
            return Some(Ok(Event { seq: place.seq, arrived: place.arrived, body: record.body }));
        }
        let seq = self.next_seq;
        self.next_seq += 1;
        let arrived = RigNs((record.host - self.epoch.unwrap_or(record.host)).0);
        Some(Ok(Event { seq, arrived, body: record.body }))
    }
}

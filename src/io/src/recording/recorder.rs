//! Writes the ledger to MCAP parts.

use std::collections::{BTreeMap, VecDeque};
use std::num::NonZeroU32;
use std::path::{Path, PathBuf};

use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, Compression, WriteOptions, Writer};
use std::borrow::Cow;
use tumbled_model::{Event, RigNs, Span, UnixNs};

use super::attached::{self, AttachedFile};
use super::counters::Counters;
use super::error::{RecorderError, StopReason};
use super::header::{CONFIG_ATTACHMENT, END_RECORD, PROFILE, RecordingHeader, START_RECORD};
use super::layout::{ChannelKey, encode, fits};
use super::results::{self, ResultKind};
use super::storage::{FileSystem, Sink, Storage};

/// A chunk is closed when it holds this much: 0.3 s of one LiDAR and one Kinect, and large enough for lz4 to be good.
pub const CHUNK_BYTES: usize = 4 << 20;

/// How a recording is laid out on the disk.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RecorderOptions {
    /// A new part is begun when this one has so many bytes; a part may exceed it by one chunk.
    pub rotate_bytes: Option<u64>,
    /// A new part is begun when this one spans so much time of the session.
    pub rotate_duration: Option<Span>,
    /// Only the newest so many parts stay on the disk; `None`: all.
    pub keep: Option<NonZeroU32>,
    /// The recording stops cleanly when fewer bytes than this are free.
    pub min_free: Option<u64>,
    /// Files of the recording's name may be replaced.
    pub replace: bool,
}

/// What a recorder is doing.
#[derive(Clone, Debug)]
pub enum RecorderState {
    /// It writes what it is given.
    Recording,
    /// It writes no more.
    Stopped {
        /// Why.
        reason: StopReason,
    },
}

/// What became of a recording.
#[derive(Clone, Debug, Default)]
#[non_exhaustive]
pub struct RecordingSummary {
    /// The parts on the disk, in order.
    pub parts: Vec<PathBuf>,
    /// Parts that `keep` has removed.
    pub removed: u64,
    /// What was recorded, removed parts included.
    pub counters: Counters,
    /// Bytes of all parts, removed ones included.
    pub file_bytes: u64,
    /// Events that `counters` counts and that were in the open chunk when a write failed: not in the file.
    pub lost_at_stop: u64,
    /// Events after the recording had stopped: not recorded.
    pub after_stop: u64,
    /// Events of a kind or size this format has no place for: not recorded.
    pub unrecordable: u64,
    /// Why it stopped before it was told to.
    pub stopped: Option<StopReason>,
}

/// Writes events to a recording, part by part.
///
/// It has no clock: whoever drives it calls [`Recorder::sync`] once a second. A failure stops the recording and
/// nothing else; what was recorded stays readable.
pub struct Recorder {
    storage: Box<dyn Storage>,
    path: PathBuf,
    header: RecordingHeader,
    options: RecorderOptions,
    part: Option<Part>,
    next_part: u32,
    kept: VecDeque<PathBuf>,
    summary: RecordingSummary,
    /// `log_time` never steps back, not even from part to part.
    last_log_time: Option<u64>,
    message: Vec<u8>,
}

struct Part {
    path: PathBuf,
    writer: Writer<Sink>,
    sink: Sink,
    channels: BTreeMap<ChannelKey, u16>,
    results: BTreeMap<&'static str, u16>,
    counters: Counters,
    started: Option<RigNs>,
    /// Uncompressed bytes in the open chunk.
    open_bytes: usize,
    /// Events in the open chunk.
    open_events: u64,
    /// The file's length when it last ended with a whole record.
    whole_bytes: u64,
}

impl std::fmt::Debug for Recorder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Recorder").field("path", &self.path).field("summary", &self.summary).finish_non_exhaustive()
    }
}

impl Recorder {
    /// Begins a recording: `path` is the first part, the next are `NAME-0001.mcap`, … beside it.
    ///
    /// # Errors
    /// When a file is there already and may not be replaced, more is to be attached than is read back, or the first part
    /// cannot be written.
    pub fn create(path: &Path, header: RecordingHeader, options: RecorderOptions) -> Result<Self, RecorderError> {
        Self::create_on(Box::new(FileSystem), path, header, options)
    }

    /// The same on other storage than the file system.
    ///
    /// # Errors
    /// As [`Recorder::create`].
    pub fn create_on(
        storage: Box<dyn Storage>,
        path: &Path,
        header: RecordingHeader,
        options: RecorderOptions,
    ) -> Result<Self, RecorderError> {
        if path.file_stem().is_none() || part_path(path, 1).is_none() {
            return Err(RecorderError::NoName { path: path.to_owned() });
        }
        attached::check(&header)?;
        let rotates = options.rotate_bytes.is_some() || options.rotate_duration.is_some();
        // An old part in the way would stop the recording only when rotation comes to it: better now.
        let second = part_path(path, 1).filter(|_| rotates);
        let in_the_way = [Some(path.to_owned()), second].into_iter().flatten().find(|path| storage.exists(path));
        if let Some(path) = in_the_way.filter(|_| !options.replace) {
            return Err(RecorderError::Exists { path });
        }
        let mut recorder = Self {
            storage,
            path: path.to_owned(),
            header,
            options,
            part: None,
            next_part: 0,
            kept: VecDeque::new(),
            summary: RecordingSummary::default(),
            last_log_time: None,
            message: Vec::new(),
        };
        recorder.check_space().and_then(|()| recorder.begin_part(&[])).map_err(RecorderError::Begin)?;
        Ok(recorder)
    }

    /// The first part.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// What it is doing.
    pub fn state(&self) -> RecorderState {
        match &self.summary.stopped {
            None => RecorderState::Recording,
            Some(reason) => RecorderState::Stopped { reason: reason.clone() },
        }
    }

    /// What was recorded so far; `file_bytes` counts finished parts only.
    pub fn summary(&self) -> &RecordingSummary {
        &self.summary
    }

    /// Bytes written to all parts, the open one included; its open chunk is not among them.
    pub fn written_bytes(&self) -> u64 {
        self.summary.file_bytes + self.part.as_ref().map_or(0, |part| part.sink.position())
    }

    /// Records an event; `false` when it was not (the state and the summary say why).
    pub fn write(&mut self, event: &Event) -> bool {
        if self.summary.stopped.is_some() {
            self.summary.after_stop += 1;
            return false;
        }
        let channel = ChannelKey::of(&event.body).filter(|_| fits(&event.body));
        self.message.clear();
        let Some(channel) = channel.filter(|_| encode(event, &mut self.message)) else {
            self.summary.unrecordable += 1;
            return false;
        };
        match self.append(&channel, event) {
            Ok(()) => true,
            Err(reason) => {
                self.stop(reason);
                false
            }
        }
    }

    /// Closes the open chunk and brings everything to the medium: a kill or a power cut now costs nothing.
    pub fn sync(&mut self) {
        let synced = self.close_chunk().and_then(|()| match &self.part {
            Some(part) => part.sink.sync().map_err(StopReason::io(&part.path)),
            None => Ok(()),
        });
        if let Err(reason) = synced.and_then(|()| self.check_space()) {
            self.stop(reason);
        }
    }

    /// Ends the recording: the end record, the index, everything to the medium.
    pub fn finish(mut self) -> RecordingSummary {
        if self.summary.stopped.is_none()
            && let Err(reason) = self.end_part("finished", "")
        {
            self.stop(reason);
        }
        self.summary.parts = self.kept.into_iter().collect();
        self.summary
    }

    fn append(&mut self, channel: &ChannelKey, event: &Event) -> Result<(), StopReason> {
        if self.rotation_is_due(event.arrived) {
            self.rotate()?;
        }
        let log_time = self.log_time(event.arrived);
        let publish_time = host_time(self.header.unix_at_zero, event.arrived);
        let Some(part) = &mut self.part else { return Ok(()) };
        let failed = |error| StopReason::mcap(&part.path)(error);
        let channel_id = match part.channels.get(channel) {
            Some(id) => *id,
            None => {
                let id = declare(&mut part.writer, channel).map_err(failed)?;
                part.channels.insert(channel.clone(), id);
                id
            }
        };
        let header = MessageHeader { channel_id, sequence: event.seq as u32, log_time, publish_time };
        part.writer.write_to_known_channel(&header, &self.message).map_err(failed)?;
        part.started.get_or_insert(event.arrived);
        part.counters.count(channel, event);
        part.open_bytes += self.message.len();
        part.open_events += 1;
        self.summary.counters.count(channel, event);
        if part.open_bytes >= CHUNK_BYTES {
            self.close_chunk()?;
            self.check_space()?;
        }
        Ok(())
    }

    /// Appends a result to the part that is open. Results begin no part and fill none: they are few and small.
    pub(super) fn append_result(
        &mut self,
        kind: &ResultKind,
        t: RigNs,
        seq: u64,
        json: &[u8],
    ) -> Result<(), StopReason> {
        let log_time = self.log_time(t);
        let publish_time = host_time(self.header.unix_at_zero, t);
        let Some(part) = &mut self.part else { return Ok(()) };
        let failed = |error| StopReason::mcap(&part.path)(error);
        let channel_id = match part.results.get(kind.topic) {
            Some(id) => *id,
            None => {
                let schema = part.writer.add_schema(kind.schema_name, "jsonschema", kind.schema.as_bytes());
                let schema = schema.map_err(failed)?;
                let id = part.writer.add_channel(schema, kind.topic, results::ENCODING, &BTreeMap::new());
                let id = id.map_err(failed)?;
                part.results.insert(kind.topic, id);
                id
            }
        };
        let header = MessageHeader { channel_id, sequence: seq as u32, log_time, publish_time };
        part.writer.write_to_known_channel(&header, json).map_err(failed)?;
        part.open_bytes += json.len();
        Ok(())
    }

    fn rotation_is_due(&self, now: RigNs) -> bool {
        let Some(part) = &self.part else { return false };
        let Some(started) = part.started else { return false };
        let full = self.options.rotate_bytes.is_some_and(|limit| part.sink.position() >= limit);
        full || self.options.rotate_duration.is_some_and(|limit| now - started >= limit)
    }

    fn rotate(&mut self) -> Result<(), StopReason> {
        let channels: Vec<ChannelKey> = self.part.iter().flat_map(|part| part.channels.keys().cloned()).collect();
        let next = part_path(&self.path, self.next_part).unwrap_or_default();
        let next = next.file_name().unwrap_or_default().to_string_lossy().into_owned();
        self.end_part("rotated", &next)?;
        self.begin_part(&channels)?;
        let keep = self.options.keep.map_or(usize::MAX, |keep| keep.get() as usize);
        while self.kept.len() > keep
            && let Some(oldest) = self.kept.pop_front()
        {
            self.storage.remove(&oldest).map_err(StopReason::io(&oldest))?;
            self.summary.removed += 1;
        }
        Ok(())
    }

    /// Begins the next part: it says of itself all that replaying it alone needs.
    fn begin_part(&mut self, channels: &[ChannelKey]) -> Result<(), StopReason> {
        let number = self.next_part;
        let path = if number == 0 { Some(self.path.clone()) } else { part_path(&self.path, number) };
        let path = path.unwrap_or_else(|| self.path.clone());
        let file = self.storage.create(&path, self.options.replace).map_err(StopReason::io(&path))?;
        let sink = Sink::new(file);
        let failed = |error| StopReason::mcap(&path)(error);
        // Chunks are gathered in memory and written whole, with their true lengths: a file cut anywhere then still
        // says how long each of its records is.
        let writer = WriteOptions::new()
            .profile(PROFILE)
            .library(PROFILE)
            .compression(Some(Compression::Lz4))
            .compression_threads(0)
            .chunk_size(None)
            .disable_seeking(true)
            .create(sink.clone());
        let mut writer = match writer {
            Ok(writer) => writer,
            Err(error) => {
                sink.cut_off(0).unwrap_or_default(); // the first error is the one to tell
                return Err(failed(error));
            }
        };
        let begun = write_start(&mut writer, &self.header, number).and_then(|()| {
            let declared = channels.iter().map(|channel| Ok((channel.clone(), declare(&mut writer, channel)?)));
            declared.collect::<Result<BTreeMap<_, _>, mcap::McapError>>()
        });
        let channels = match begun.and_then(|channels| writer.flush().map(|()| channels)) {
            Ok(channels) => channels,
            Err(error) => {
                sink.cut_off(0).unwrap_or_default();
                return Err(failed(error));
            }
        };
        let synced = sink.sync().map_err(StopReason::io(&path));
        let whole_bytes = sink.position();
        self.kept.push_back(path.clone());
        self.next_part += 1;
        let counters = Counters::default();
        let started = None;
        self.part = Some(Part {
            path,
            writer,
            sink,
            channels,
            results: BTreeMap::new(),
            counters,
            started,
            open_bytes: 0,
            open_events: 0,
            whole_bytes,
        });
        synced
    }

    fn end_part(&mut self, how: &str, detail: &str) -> Result<(), StopReason> {
        let Some(mut part) = self.part.take() else { return Ok(()) };
        let mut metadata = part.counters.to_metadata();
        metadata.insert("end".to_owned(), how.to_owned());
        if !detail.is_empty() {
            metadata.insert("detail".to_owned(), detail.to_owned());
        }
        let record = Metadata { name: END_RECORD.to_owned(), metadata };
        // `flush` once more: `finish` leaves the last bytes in the file's buffer.
        let ended = part.writer.flush().and_then(|()| {
            part.whole_bytes = part.sink.position();
            part.open_events = 0;
            part.writer.write_metadata(&record)?;
            part.writer.finish().map(|_summary| ())
        });
        let ended = ended.map_err(StopReason::mcap(&part.path));
        let ended = ended.and_then(|()| part.sink.sync().map_err(StopReason::io(&part.path)));
        if ended.is_err() {
            self.summary.lost_at_stop += part.open_events;
            part.sink.cut_off(part.whole_bytes).unwrap_or_default(); // the first error is the one to tell
        }
        self.summary.file_bytes += part.sink.position();
        ended
    }

    fn close_chunk(&mut self) -> Result<(), StopReason> {
        let Some(part) = &mut self.part else { return Ok(()) };
        if part.open_bytes == 0 {
            return Ok(());
        }
        part.writer.flush().map_err(StopReason::mcap(&part.path))?;
        (part.open_bytes, part.open_events) = (0, 0);
        part.whole_bytes = part.sink.position();
        Ok(())
    }

    fn check_space(&self) -> Result<(), StopReason> {
        let Some(min_free) = self.options.min_free else { return Ok(()) };
        // A disk that does not tell its free space is no reason to stop.
        match self.storage.free_bytes(&self.path) {
            Ok(free) if free < min_free => Err(StopReason::LowSpace { path: self.path.clone(), free, min_free }),
            Ok(_) | Err(_) => Ok(()),
        }
    }

    /// Stops with a reason: cleanly where the disk still takes it, else with the part cut to its last whole record.
    pub(super) fn stop(&mut self, reason: StopReason) {
        if matches!(reason, StopReason::LowSpace { .. }) {
            let ended = self.end_part("stopped", &reason.to_string());
            self.summary.stopped = Some(ended.err().unwrap_or(reason));
            return;
        }
        if let Some(part) = self.part.take() {
            part.sink.cut_off(part.whole_bytes).unwrap_or_default(); // the first error is the one to tell
            self.summary.file_bytes += part.whole_bytes;
            self.summary.lost_at_stop += part.open_events;
        }
        self.summary.stopped.get_or_insert(reason);
    }

    /// Strictly rising, for viewers and readers that sort; replay goes by the message's head.
    fn log_time(&mut self, arrived: RigNs) -> u64 {
        let host = host_time(self.header.unix_at_zero, arrived);
        let log_time = self.last_log_time.map_or(host, |last| host.max(last.saturating_add(1)));
        self.last_log_time = Some(log_time);
        log_time
    }
}

/// Wall time of an arrival as MCAP has it: not before 1970.
fn host_time(unix_at_zero: UnixNs, arrived: RigNs) -> u64 {
    u64::try_from(unix_at_zero.0.saturating_add(arrived.0)).unwrap_or(0)
}

fn declare(writer: &mut Writer<Sink>, channel: &ChannelKey) -> mcap::McapResult<u16> {
    // No schema: the layout stands in the channel's metadata.
    writer.add_channel(0, &channel.to_string(), "tumbled-raw", &channel.metadata())
}

fn write_start(writer: &mut Writer<Sink>, header: &RecordingHeader, part: u32) -> mcap::McapResult<()> {
    let metadata = header.to_metadata(part);
    writer.write_metadata(&Metadata { name: START_RECORD.to_owned(), metadata })?;
    let time = host_time(header.unix_at_zero, RigNs(0));
    let mut attach = |name: String, media_type: &str, data: &[u8]| {
        let (media_type, data) = (media_type.to_owned(), Cow::Borrowed(data));
        writer.attach(&Attachment { log_time: time, create_time: time, name, media_type, data })
    };
    if !header.config.is_empty() {
        attach(CONFIG_ATTACHMENT.to_owned(), "application/toml", header.config.as_bytes())?;
    }
    for file in &header.files {
        if let Some(content) = &file.content {
            attach(AttachedFile::attachment_name(&file.key), "application/octet-stream", content)?;
        }
    }
    Ok(())
}

/// `session.mcap` and 1 make `session-0001.mcap`. `None` for a path without a file name.
pub(crate) fn part_path(path: &Path, number: u32) -> Option<PathBuf> {
    let mut name = path.file_stem()?.to_owned();
    name.push(format!("-{number:04}"));
    if let Some(extension) = path.extension() {
        name.push(".");
        name.push(extension);
    }
    Some(path.with_file_name(name))
}

//! Reads recordings back: the ledger's events with the `seq` and `arrived` they had.

use bytes::Bytes;
use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use tumbled_model::{Event, RigNs};

use super::attached::AttachedFile;
use super::counters::Counters;
use super::error::ReadError;
use super::header::{CONFIG_ATTACHMENT, END_RECORD, PROFILE, RecordingHeader, START_RECORD};
use super::info::{PartInfo, RecordingInfo};
use super::layout::{ChannelKey, decode};
use super::records::{ATTACHMENT, CHANNEL, Damage, MESSAGE, METADATA, Records, Step, index_channels};
use super::results::{self, ResultMessage};
use crate::capture::{Fields, ReadUpTo};

/// Bytes from a file's start that tell whether it is a recording: magic, header record, profile.
const TELLING_BYTES: usize = 8 + 9 + 4 + PROFILE.len();

/// Whether a file begins like one of these recordings.
///
/// # Errors
/// When it cannot be read.
pub fn is_recording(path: &Path) -> io::Result<bool> {
    let mut head = Vec::new();
    File::open(path)?.read_up_to(TELLING_BYTES, &mut head)?;
    Ok(begins_recording(&head))
}

/// The same from the file's first bytes.
pub(crate) fn begins_recording(head: &[u8]) -> bool {
    let profile = (|| {
        let (magic, rest) = head.split_at_checked(8)?;
        let (record, mut rest) = rest.split_at_checked(9)?;
        let is_header = magic == b"\x89MCAP0\r\n" && record.first() == Some(&1);
        let length = rest.split_off(..4)?;
        (is_header && length == (PROFILE.len() as u32).to_le_bytes()).then_some(rest.get(..PROFILE.len())?)
    })();
    profile == Some(PROFILE.as_bytes())
}

/// A recording being read: an iterator over its events in the order they were recorded.
///
/// Damage is passed over and told by [`Reader::info`]; only a system that refuses to read is an error.
#[derive(Debug)]
pub struct Reader {
    info: RecordingInfo,
    /// Index in `info.parts` of the part being read.
    current: usize,
    parts: VecDeque<PartReader>,
    results: Vec<ResultMessage>,
    finished: bool,
}

impl Reader {
    /// Opens the parts of one recording, in whatever order they are given.
    ///
    /// # Errors
    /// When a file is no recording or breaks before it says what it is, and when the files are not of one session.
    pub fn open<P: AsRef<Path>>(paths: &[P]) -> Result<Self, ReadError> {
        let opened = paths.iter().map(|path| PartReader::open(path.as_ref()));
        let mut parts = opened.collect::<Result<Vec<_>, _>>()?;
        parts.sort_by_key(|part| part.number);
        let first = parts.first().ok_or(ReadError::Nothing)?;
        for pair in parts.windows(2) {
            let [a, b] = pair else { continue };
            if a.number == b.number && a.header.session == b.header.session {
                let (first, other) = (a.path.clone(), b.path.clone());
                return Err(ReadError::SamePart { first, other, part: a.number });
            }
        }
        if let Some(other) = parts.iter().find(|part| part.header.session != first.header.session) {
            return Err(ReadError::DifferentSessions {
                first: first.path.clone(),
                first_session: first.header.session.clone(),
                other: other.path.clone(),
                other_session: other.header.session.clone(),
            });
        }
        let info = RecordingInfo {
            header: first.header.clone(),
            parts: parts.iter().map(PartReader::info).collect(),
            counters: Counters::default(),
            undecodable: 0,
            results: 0,
            other_messages: 0,
        };
        Ok(Self { info, current: 0, parts: parts.into(), results: Vec::new(), finished: false })
    }

    /// What the recording says of itself.
    pub fn header(&self) -> &RecordingHeader {
        &self.info.header
    }

    /// What was read so far and what could not be; complete once the iterator has ended.
    pub fn info(&self) -> &RecordingInfo {
        &self.info
    }

    /// The results that lie between the events read so far, since the last call.
    pub fn take_results(&mut self) -> Vec<ResultMessage> {
        std::mem::take(&mut self.results)
    }

    /// Reads to the end for the sake of [`Reader::info`].
    ///
    /// # Errors
    /// When the system refuses to read.
    pub fn read_to_end(mut self) -> Result<RecordingInfo, ReadError> {
        self.by_ref().try_for_each(|event| event.map(|_| ()))?;
        Ok(self.info)
    }

    fn next_event(&mut self) -> Result<Option<Event>, ReadError> {
        while let (Some(part), Some(info)) = (self.parts.front_mut(), self.info.parts.get_mut(self.current)) {
            let step = part.next_step().map_err(io_error(&part.path))?;
            match step {
                Step::Record(MESSAGE, content) => match part.event(&content) {
                    Message::Event(channel, event) => {
                        info.events_read += 1;
                        self.info.counters.count(&channel, &event);
                        return Ok(Some(event));
                    }
                    Message::Undecodable => self.info.undecodable += 1,
                    Message::Result(result) => {
                        self.info.results += 1;
                        if self.results.len() < results::KEPT {
                            self.results.push(result);
                        }
                    }
                    Message::Other => self.info.other_messages += 1,
                },
                Step::Record(CHANNEL, content) => part.declare(&content),
                Step::Record(METADATA, content) => {
                    if let Some((name, map)) = metadata(&content)
                        && name == END_RECORD
                    {
                        info.read_end(&map);
                    }
                }
                Step::Record(..) => {}
                Step::Damage(damage) => {
                    info.add_damage(damage);
                    part.declare_from_index();
                }
                Step::End { finished } => {
                    info.finished = finished;
                    self.parts.pop_front();
                    self.current += 1;
                }
            }
        }
        Ok(None)
    }
}

impl Iterator for Reader {
    type Item = Result<Event, ReadError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.finished {
            return None;
        }
        let next = self.next_event().transpose();
        self.finished = !matches!(next, Some(Ok(_)));
        next
    }
}

/// One part, behind its start record.
struct PartReader {
    path: PathBuf,
    file_bytes: u64,
    number: u32,
    header: RecordingHeader,
    records: Records<File>,
    /// Read while looking for the end of the start, to be looked at again.
    ahead: Option<Step>,
    channels: BTreeMap<u16, Channel>,
    index_read: bool,
}

/// What a channel of the file carries.
enum Channel {
    Events(ChannelKey),
    /// Results, with their topic.
    Results(String),
    Other,
}

enum Message {
    Event(ChannelKey, Event),
    Result(ResultMessage),
    Undecodable,
    Other,
}

impl std::fmt::Debug for PartReader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("PartReader").field("path", &self.path).field("number", &self.number).finish_non_exhaustive()
    }
}

impl PartReader {
    fn open(path: &Path) -> Result<Self, ReadError> {
        let metadata = std::fs::metadata(path).map_err(io_error(path))?;
        // A pipe would wait for its writer, a folder has no bytes.
        if !metadata.is_file() || !is_recording(path).map_err(io_error(path))? {
            return Err(ReadError::NotARecording { path: path.to_owned() });
        }
        let file = File::open(path).map_err(io_error(path))?;
        let mut records = Records::open(file).map_err(io_error(path))?;
        let (mut header, number, start) = loop {
            match records.next_step().map_err(io_error(path))? {
                Step::Record(METADATA, content) => {
                    if let Some((name, map)) = self::metadata(&content)
                        && name == START_RECORD
                    {
                        let fault = |fault| ReadError::Header { path: path.to_owned(), fault };
                        let (header, number) = RecordingHeader::from_metadata(&map).map_err(fault)?;
                        break (header, number, map);
                    }
                }
                Step::Damage(Damage { offset, .. }) => {
                    return Err(ReadError::NoStart { path: path.to_owned(), offset });
                }
                Step::Record(MESSAGE, _) | Step::End { .. } => {
                    return Err(ReadError::NoStart { path: path.to_owned(), offset: records.offset() });
                }
                Step::Record(..) => {}
            }
        };
        let ahead = loop {
            let step = records.next_step().map_err(io_error(path))?;
            let Step::Record(ATTACHMENT, content) = &step else { break step };
            if let Some((name, data)) = attachment(content) {
                take_attachment(&mut header, &start, name, data);
            }
        };
        let (path, file_bytes, ahead) = (path.to_owned(), metadata.len(), Some(ahead));
        Ok(Self { path, file_bytes, number, header, records, ahead, channels: BTreeMap::new(), index_read: false })
    }

    fn info(&self) -> PartInfo {
        PartInfo {
            path: self.path.clone(),
            number: self.number,
            file_bytes: self.file_bytes,
            end: None,
            finished: false,
            events_read: 0,
            events_recorded: None,
            damage: Vec::new(),
            damaged_bytes: 0,
        }
    }

    fn next_step(&mut self) -> io::Result<Step> {
        match self.ahead.take() {
            Some(step) => Ok(step),
            None => self.records.next_step(),
        }
    }

    /// Channel: id u16, schema id u16, topic, message encoding, metadata. The first of an id stands.
    fn declare(&mut self, content: &[u8]) {
        let channel = (|| {
            let mut fields = Fields(content);
            let (id, _schema) = (fields.u16()?, fields.u16()?);
            let (topic, encoding) = (fields.text()?, fields.text()?);
            let channel = match ChannelKey::from_metadata(&map(&mut fields)?) {
                Some(key) => Channel::Events(key),
                None if encoding == results::ENCODING => Channel::Results(topic.to_owned()),
                None => Channel::Other,
            };
            Some((id, channel))
        })();
        if let Some((id, channel)) = channel {
            self.channels.entry(id).or_insert(channel);
        }
    }

    /// After damage: the chunk that is lost may be the one that declared channels; the index declares them again.
    fn declare_from_index(&mut self) {
        if std::mem::replace(&mut self.index_read, true) {
            return;
        }
        // Best effort: without an index the messages are counted as undecodable.
        for channel in index_channels(&self.path).unwrap_or_default() {
            self.declare(&channel);
        }
    }

    /// Message: channel id u16, sequence u32, log time u64, publish time u64, data.
    fn event(&self, content: &Bytes) -> Message {
        const HEAD: usize = 2 + 4 + 8 + 8;
        let mut head = Fields(content);
        let Some(id) = head.u16() else { return Message::Undecodable };
        let (sequence, log_time) = (head.u32(), head.u64());
        if content.len() < HEAD {
            return Message::Undecodable;
        }
        let channel = match self.channels.get(&id) {
            Some(Channel::Events(channel)) => channel,
            Some(Channel::Results(topic)) => {
                let json = content.slice(HEAD..);
                let unix = i64::try_from(log_time.unwrap_or_default()).unwrap_or(i64::MAX);
                let t = RigNs(unix.saturating_sub(self.header.unix_at_zero.0));
                let (topic, seq) = (topic.clone(), u64::from(sequence.unwrap_or_default()));
                let fits = json.len() <= results::MAX_RESULT_BYTES;
                return if fits { Message::Result(ResultMessage { topic, t, seq, json }) } else { Message::Other };
            }
            Some(Channel::Other) => return Message::Other,
            None => return Message::Undecodable,
        };
        match decode(channel, &content.slice(HEAD..)) {
            Some(event) => Message::Event(channel.clone(), event),
            None => Message::Undecodable,
        }
    }
}

fn io_error(path: &Path) -> impl FnOnce(io::Error) -> ReadError {
    move |source| ReadError::Io { path: path.to_owned(), source }
}

/// Metadata: name, map.
fn metadata(content: &[u8]) -> Option<(&str, BTreeMap<String, String>)> {
    let mut fields = Fields(content);
    Some((fields.text()?, map(&mut fields)?))
}

/// A map: its length in bytes u32, then keys and values in turns.
fn map(fields: &mut Fields<'_>) -> Option<BTreeMap<String, String>> {
    let length = fields.u32()? as usize;
    let mut pairs = Fields(fields.0.get(..length)?);
    let mut map = BTreeMap::new();
    while !pairs.0.is_empty() {
        map.insert(pairs.text()?.to_owned(), pairs.text()?.to_owned());
    }
    Some(map)
}

/// What the start of a part attaches: the config and the files its start record lists; other attachments are let be.
fn take_attachment(header: &mut RecordingHeader, start: &BTreeMap<String, String>, name: &str, data: &[u8]) {
    if name == CONFIG_ATTACHMENT {
        header.take_config(start, data);
    } else if let Some(key) = AttachedFile::key_of_attachment(name)
        && let Some(file) = header.files.iter_mut().find(|file| file.key == key)
    {
        file.restore(data);
    }
}

/// Attachment: log time u64, create time u64, name, media type, length u64, data, CRC u32. Name and data.
fn attachment(content: &[u8]) -> Option<(&str, &[u8])> {
    let mut fields = Fields(content);
    let _times = (fields.u64()?, fields.u64()?);
    let (name, _media_type) = (fields.text()?, fields.text()?);
    let length = usize::try_from(fields.u64()?).ok()?;
    Some((name, fields.0.get(..length)?))
}

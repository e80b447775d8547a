//! Messages of an MCAP file, from its start to its end or to where it breaks off.

use super::files::{io_error, open_buffered};
use super::rosbag::{Message, Messages, StreamError, Topic};
use super::summary::{BrokenOff, Place};
use super::{CaptureError, MAX_RECORD_BYTES};
use bytes::Bytes;
use mcap::McapError;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tumbled_model::UnixNs;

/// The reader asks for as many bytes as a record claims; it gets them in pieces, so that a false claim costs nothing.
const PIECE_BYTES: usize = 1 << 18;

pub(crate) struct McapMessages {
    path: PathBuf,
    file: BufReader<File>,
    reader: LinearReader,
    bytes_read: u64,
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, Arc<Topic>>,
    finished: bool,
}

impl McapMessages {
    pub(crate) fn open(path: &Path) -> Result<Self, CaptureError> {
        // The end magic is not insisted on: an interrupted recording ends with its last message.
        let options = LinearReaderOptions::default()
            .with_skip_end_magic(true)
            .with_validate_chunk_crcs(true)
            .with_record_length_limit(MAX_RECORD_BYTES);
        Ok(Self {
            path: path.to_owned(),
            file: open_buffered(path)?,
            reader: LinearReader::new_with_options(options),
            bytes_read: 0,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            finished: false,
        })
    }

    fn broken(&mut self, error: &McapError) -> StreamError {
        self.finished = true;
        let detail = match error {
            McapError::UnexpectedEof => "the file ends within a record".to_owned(),
            McapError::UnsupportedCompression(name) => {
                format!("chunks are compressed with {name:?}, expected zstd, lz4 or nothing")
            }
            other => other.to_string(),
        };
        StreamError::Broken(BrokenOff { path: self.path.clone(), place: Place::NearByte(self.bytes_read), detail })
    }

    /// Learns a schema or channel; gives a message whose channel is known.
    fn accept(&mut self, record: Record<'_>) -> Option<Message> {
        match record {
            Record::Schema { header, .. } => {
                self.schemas.entry(header.id).or_insert(header.name);
                None
            }
            Record::Channel(channel) => {
                let topic = Topic {
                    name: channel.topic,
                    type_name: self.schemas.get(&channel.schema_id).cloned().unwrap_or_default(),
                    serialisation: channel.message_encoding,
                };
                // Repeated in every chunk; the first stands.
                self.channels.entry(channel.id).or_insert_with(|| Arc::new(topic));
                None
            }
            Record::Message { header, data } => {
                let topic = self.channels.get(&header.channel_id)?.clone();
                let received = UnixNs(i64::try_from(header.log_time).unwrap_or(i64::MAX));
                Some(Message { topic, received, data: Bytes::copy_from_slice(&data) })
            }
            _ => None,
        }
    }
}

/// What one step of the reader asks for.
enum Step {
    Read(usize),
    Message(Option<Message>),
}

impl Messages for McapMessages {
    fn next_message(&mut self) -> Result<Option<Message>, StreamError> {
        loop {
            if self.finished {
                return Ok(None);
            }
            // Data and summary section are parted by DataEnd: what follows repeats what was read.
            let step = match self.reader.next_event() {
                None => return Ok(None),
                Some(Err(error)) => return Err(self.broken(&error)),
                Some(Ok(LinearReadEvent::ReadRequest(wanted))) => Step::Read(wanted.min(PIECE_BYTES)),
                Some(Ok(LinearReadEvent::Record { opcode: op::DATA_END, .. })) => {
                    self.finished = true;
                    return Ok(None);
                }
                Some(Ok(LinearReadEvent::Record {
                    opcode: opcode @ (op::SCHEMA | op::CHANNEL | op::MESSAGE),
                    data,
                })) => {
                    match mcap::parse_record(opcode, data) {
                        // Owned before the reader is used again.
                        Ok(record) => {
                            let record = record.into_owned();
                            Step::Message(self.accept(record))
                        }
                        Err(error) => return Err(self.broken(&error)),
                    }
                }
                Some(Ok(LinearReadEvent::Record { .. })) => continue,
            };
            match step {
                Step::Message(Some(message)) => return Ok(Some(message)),
                Step::Message(None) => {}
                Step::Read(wanted) => {
                    let read = self.file.read(self.reader.insert(wanted));
                    let read = read.map_err(|source| StreamError::Fatal(io_error(&self.path)(source)))?;
                    self.reader.notify_read(read);
                    self.bytes_read += read as u64;
                }
            }
        }
    }

    fn topics(&self) -> Vec<Arc<Topic>> {
        self.channels.values().cloned().collect()
    }
}

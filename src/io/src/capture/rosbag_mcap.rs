//! Messages of a rosbag2 MCAP file, from its start to its end or to where it breaks off.

use super::CaptureError;
use super::files::io_error;
use super::mcap_records::{CHANNEL, Fields, MESSAGE, McapRecords, RecordError, SCHEMA};
use super::rosbag::{Message, Messages, StreamError, Topic};
use super::summary::{BrokenOff, Place};
use bytes::Bytes;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tumbled_model::UnixNs;

pub(crate) struct McapMessages {
    path: PathBuf,
    records: McapRecords,
    /// Names of message types.
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, Arc<Topic>>,
    undeclared: Arc<Topic>,
}

impl McapMessages {
    pub(crate) fn open(path: &Path) -> Result<Self, CaptureError> {
        let records = McapRecords::open(path)?;
        Ok(Self {
            path: path.to_owned(),
            records,
            schemas: BTreeMap::new(),
            channels: BTreeMap::new(),
            undeclared: Arc::new(Topic::undeclared()),
        })
    }
}

/// Schema: id u16, name, encoding, data.
fn schema(content: &[u8]) -> Option<(u16, String)> {
    let mut fields = Fields(content);
    Some((fields.u16()?, fields.text()?.to_owned()))
}

/// Channel: id u16, schema id u16, topic, message encoding, metadata.
fn channel(content: &[u8], schemas: &BTreeMap<u16, String>) -> Option<(u16, Topic)> {
    let mut fields = Fields(content);
    let (id, schema_id) = (fields.u16()?, fields.u16()?);
    let (name, serialisation) = (fields.text()?.to_owned(), fields.text()?.to_owned());
    let type_name = schemas.get(&schema_id).cloned().unwrap_or_default();
    Some((id, Topic { name, type_name, serialisation }))
}

/// Message: channel id u16, sequence u32, log time u64, publish time u64, data.
fn message(content: &[u8], channels: &BTreeMap<u16, Arc<Topic>>, undeclared: &Arc<Topic>) -> Option<Message> {
    let mut fields = Fields(content);
    let channel_id = fields.u16()?;
    fields.u32()?;
    let log_time = fields.u64()?;
    fields.u64()?;
    let topic = channels.get(&channel_id).unwrap_or(undeclared).clone();
    let received = UnixNs(i64::try_from(log_time).unwrap_or(i64::MAX));
    Some(Message { topic, received, data: Bytes::copy_from_slice(fields.0) })
}

impl Messages for McapMessages {
    fn next_message(&mut self) -> Result<Option<Message>, StreamError> {
        loop {
            let record = match self.records.next_record() {
                Ok(Some(record)) => record,
                Ok(None) => return Ok(None),
                Err(RecordError::Io(source)) => return Err(StreamError::Fatal(io_error(&self.path)(source))),
                Err(RecordError::Broken { offset, detail }) => {
                    let place = Place::Byte(offset);
                    return Err(StreamError::Broken(BrokenOff { path: self.path.clone(), place, detail }));
                }
            };
            // A record too short for its own fields is passed over: its length still leads to the next one. Schemas
            // and channels are repeated in every chunk; the first stands.
            match record {
                (SCHEMA, content) => {
                    if let Some((id, name)) = schema(content) {
                        self.schemas.entry(id).or_insert(name);
                    }
                }
                (CHANNEL, content) => {
                    if let Some((id, topic)) = channel(content, &self.schemas) {
                        self.channels.entry(id).or_insert_with(|| Arc::new(topic));
                    }
                }
                (MESSAGE, content) => {
                    if let Some(message) = message(content, &self.channels, &self.undeclared) {
                        return Ok(Some(message));
                    }
                }
                _ => {}
            }
        }
    }

    fn topics(&self) -> Vec<Arc<Topic>> {
        self.channels.values().cloned().collect()
    }
}

//! Messages of a rosbag2 SQLite file, in the order of their ids.
//!
//! Tables: `topics (id, name, type, serialization_format, …)`, `messages (id, topic_id, timestamp, data)`. The file
//! is foreign: it is opened read-only, with its schema not trusted, and only ordinary tables are read (a view could
//! compute for ever).

use super::files::open_regular;
use super::rosbag::{Message, Messages, StreamError, Topic};
use super::summary::{BrokenOff, Place};
use super::{CaptureError, MAX_RECORD_BYTES};
use bytes::Bytes;
use rusqlite::limits::Limit;
use rusqlite::types::ValueRef;
use rusqlite::{Connection, OpenFlags, OptionalExtension, params};
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use tumbled_model::UnixNs;

/// A row at a time by its rowid, which in a bag is the id and in any table is found without a search: the statement
/// is cached, and no cursor has to outlive this call.
const NEXT_MESSAGE: &str =
    "SELECT rowid, topic_id, timestamp, data FROM messages WHERE rowid > ?1 ORDER BY rowid LIMIT 1";

pub(crate) struct Db3Messages {
    path: PathBuf,
    connection: Connection,
    topics: BTreeMap<i64, Arc<Topic>>,
    undeclared: Arc<Topic>,
    last_row: i64,
    finished: bool,
}

impl Db3Messages {
    pub(crate) fn open(path: &Path) -> Result<Self, CaptureError> {
        open_regular(path)?;
        let database = |source| CaptureError::Database { path: path.to_owned(), source: Box::new(source) };
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_URI | OpenFlags::SQLITE_OPEN_NO_MUTEX;
        let connection = Connection::open_with_flags(uri(path), flags).map_err(database)?;
        connection.set_limit(Limit::SQLITE_LIMIT_LENGTH, MAX_RECORD_BYTES as i32).map_err(database)?;
        connection.execute_batch("PRAGMA trusted_schema = OFF; PRAGMA cell_size_check = ON;").map_err(database)?;
        for table in ["topics", "messages"] {
            if !is_ordinary_table(&connection, table).map_err(database)? {
                return Err(CaptureError::NotABag { path: path.to_owned(), table });
            }
        }
        let topics = read_topics(&connection).map_err(database)?;
        // Also refuses a table without the columns.
        connection.prepare_cached(NEXT_MESSAGE).map_err(database)?;
        Ok(Self {
            path: path.to_owned(),
            connection,
            topics,
            undeclared: Arc::new(Topic::undeclared()),
            last_row: i64::MIN,
            finished: false,
        })
    }

    fn row(&self) -> rusqlite::Result<Option<Row>> {
        let mut statement = self.connection.prepare_cached(NEXT_MESSAGE)?;
        let row = |row: &rusqlite::Row<'_>| {
            let data = match row.get_ref(3)? {
                ValueRef::Blob(data) => Bytes::copy_from_slice(data),
                // No message is empty: whoever has this topic will find it faulty.
                _ => Bytes::new(),
            };
            Ok(Row { id: row.get(0)?, topic: row.get(1)?, timestamp: row.get(2)?, data })
        };
        statement.query_row(params![self.last_row], row).optional()
    }

    fn broken(&mut self, detail: String) -> StreamError {
        self.finished = true;
        StreamError::Broken(BrokenOff { path: self.path.clone(), place: Place::AfterRow(self.last_row), detail })
    }
}

struct Row {
    id: i64,
    topic: i64,
    timestamp: i64,
    data: Bytes,
}

/// `immutable` unless a write-ahead log holds more: then neither locks nor side files are needed, and a bag on a
/// read-only medium opens.
fn uri(path: &Path) -> String {
    let mut uri = String::from("file:");
    // A relative path that begins with `//` would be taken for a host name.
    let absolute = std::path::absolute(path);
    for &byte in absolute.as_deref().unwrap_or(path).as_os_str().as_bytes() {
        if byte.is_ascii_alphanumeric() || b"/._-".contains(&byte) {
            uri.push(char::from(byte));
        } else {
            uri.push_str(&format!("%{byte:02X}"));
        }
    }
    let mut log = OsString::from(path);
    log.push("-wal");
    let log_in_use = std::fs::metadata(log).is_ok_and(|metadata| metadata.len() > 0);
    uri.push_str(if log_in_use { "?mode=ro" } else { "?mode=ro&immutable=1" });
    uri
}

fn is_ordinary_table(connection: &Connection, name: &str) -> rusqlite::Result<bool> {
    let sql = "SELECT sql FROM sqlite_master WHERE type = 'table' AND name = ?1";
    let definition: Option<Option<String>> = connection.query_row(sql, params![name], |row| row.get(0)).optional()?;
    Ok(definition.flatten().is_some_and(|sql| !sql.to_ascii_uppercase().starts_with("CREATE VIRTUAL")))
}

fn read_topics(connection: &Connection) -> rusqlite::Result<BTreeMap<i64, Arc<Topic>>> {
    let mut statement = connection.prepare("SELECT id, name, type, serialization_format FROM topics")?;
    let mut rows = statement.query([])?;
    let mut topics = BTreeMap::new();
    while let Some(row) = rows.next()? {
        let topic = Topic { name: row.get(1)?, type_name: row.get(2)?, serialisation: row.get(3)? };
        topics.insert(row.get(0)?, Arc::new(topic));
    }
    Ok(topics)
}

impl Messages for Db3Messages {
    fn next_message(&mut self) -> Result<Option<Message>, StreamError> {
        if self.finished {
            return Ok(None);
        }
        let row = match self.row() {
            Ok(Some(row)) => row,
            Ok(None) => return Ok(None),
            Err(error) => return Err(self.broken(error.to_string())),
        };
        // A damaged tree must not send the reader in a circle.
        if row.id <= self.last_row {
            return Err(self.broken(format!("row {} comes after row {}", row.id, self.last_row)));
        }
        self.last_row = row.id;
        let topic = self.topics.get(&row.topic).unwrap_or(&self.undeclared).clone();
        Ok(Some(Message { topic, received: UnixNs(row.timestamp.max(0)), data: row.data }))
    }

    fn topics(&self) -> Vec<Arc<Topic>> {
        self.topics.values().cloned().collect()
    }
}

//! Recordings: the ledger in MCAP files, written so that a kill costs at most a second, read back to the bit.
//!
//! ```text
//!   ledger ─▶ RecorderThread ─▶ Recorder ─▶ layout ─▶ FILE.mcap, FILE-0001.mcap, …
//!   (its bounded queue)         (chunks, rotation)         │
//!   Event ◀───────────────── Reader ◀─ layout ◀─ records ◀─┘
//! ```
//!
//! * [`layout`]: channels, and how an event lies in a message;
//! * [`header`], [`counters`]: what a part says of itself at its start and at its end; [`attached`]: the rig's files in it;
//! * [`recorder`], [`storage`], [`thread`]: writing; [`results`]: what a session computed, beside the ledger;
//! * [`ring`]: the newest events, kept in memory; [`excerpt`]: recordings of a part of a session;
//! * [`reader`], [`info`]: reading, and what was lost;
//! * [`digest`]: what an import was made from; [`difference`]: where two ledgers part.
//!
//! The files are written with the `mcap` crate. They are read with this crate's own reader, which is bounded by what is
//! there whatever a file claims.

pub mod attached;
pub mod counters;
pub mod difference;
pub mod digest;
pub mod error;
pub mod excerpt;
pub mod header;
pub mod info;
pub mod layout;
pub mod reader;
pub mod recorder;
pub(crate) mod records;
pub mod results;
pub mod ring;
pub mod storage;
#[cfg(test)]
mod tests;
pub mod thread;

pub use attached::{AttachedFile, MAX_FILE_BYTES, MAX_FILES};
pub use counters::{ChannelCount, Counters};
pub use difference::{Difference, compare};
pub use digest::{digest_of, import_session};
pub use error::{ReadError, RecorderError, StopReason};
pub use excerpt::{MidSession, Plan, Witness};
pub use header::{HeaderFault, InputFile, Origin, RecordingHeader};
pub use info::{PartEnd, PartInfo, RecordingInfo};
pub use layout::{ChannelKey, ChannelKind};
pub use reader::{Reader, is_recording};
pub use recorder::{CHUNK_BYTES, Recorder, RecorderOptions, RecorderState, RecordingSummary};
pub use records::Damage;
pub use results::{ResultKind, ResultMessage};
pub use ring::{Excerpt, Ring, RingBound};
pub use storage::{FileSystem, PartFile, Storage};
pub use thread::{OrderError, RecorderDesk, RecorderStatus, RecorderThread};

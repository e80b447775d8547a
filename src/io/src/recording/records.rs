//! The records of a part, one after the other, bounded by what is there; see [`crate::capture`] for the format.
//!
//! Unlike a foreign bag's, a chunk of a recording is unpacked whole and held against its checksum before anything of
//! it is delivered: a flipped bit costs the chunk it is in, and never becomes an event. A chunk the file ends in has
//! no checksum to be held against; the records that are whole in it are delivered.

use bytes::Bytes;
use std::fs::File;
use std::io::{self, BufReader, Read, Seek, SeekFrom};
use std::path::Path;

use crate::capture::{ChunkHead, Fields, ReadUpTo, record_head};

const HEADER: u8 = 0x01;
const FOOTER: u8 = 0x02;
pub(crate) const CHANNEL: u8 = 0x04;
pub(crate) const MESSAGE: u8 = 0x05;
const CHUNK: u8 = 0x06;
pub(crate) const ATTACHMENT: u8 = 0x09;
pub(crate) const METADATA: u8 = 0x0c;
const DATA_END: u8 = 0x0f;

const MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";
const RECORD_HEAD_BYTES: usize = 9;

/// A chunk holds [`super::CHUNK_BYTES`] and at most one message more; so much again for channels and to spare.
const MAX_UNPACKED_BYTES: u64 = (2 * super::layout::MAX_MESSAGE_BYTES + super::CHUNK_BYTES) as u64;

/// A config or a file of the rig as an attachment; a chunk as it is packed.
const MAX_RECORD_BYTES: u64 = 64 << 20;

/// Something in a part that cannot be read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Damage {
    /// Where it begins, bytes from the file's start.
    pub offset: u64,
    /// Bytes of the file it affects: the damaged record's, or all from there to the file's end.
    pub bytes: u64,
    /// What is wrong.
    pub detail: String,
    /// Reading goes on behind it.
    pub passed_over: bool,
}

/// One step through a part.
pub(crate) enum Step {
    /// A record: opcode and content.
    Record(u8, Bytes),
    /// Something that cannot be read.
    Damage(Damage),
    /// The end; whether the part was finished: data end, footer and closing magic are there.
    End { finished: bool },
}

/// Walks through the channels, messages, metadata and attachments of a part.
pub(crate) struct Records<R> {
    file: BufReader<R>,
    /// Of the next record.
    offset: u64,
    length: u64,
    /// What is left of the open chunk.
    chunk: Bytes,
    /// The file ends within the open chunk, which begins here.
    cut_chunk: Option<u64>,
    ended: Option<bool>,
}

impl Records<File> {
    pub(crate) fn open(file: File) -> io::Result<Self> {
        let length = file.metadata()?.len();
        Self::new(file, length)
    }
}

impl<R: Read> Records<R> {
    /// `length`: of the file, bytes.
    pub(crate) fn new(source: R, length: u64) -> io::Result<Self> {
        let mut file = BufReader::with_capacity(1 << 18, source);
        let mut magic = Vec::new();
        file.read_up_to(MAGIC.len(), &mut magic)?;
        let offset = magic.len() as u64;
        let ended = (magic != MAGIC).then_some(false);
        Ok(Self { file, offset, length, chunk: Bytes::new(), cut_chunk: None, ended })
    }

    /// Where the next record of the file itself begins.
    pub(crate) fn offset(&self) -> u64 {
        self.offset
    }

    pub(crate) fn next_step(&mut self) -> io::Result<Step> {
        loop {
            if let Some(step) = self.within_chunk() {
                return Ok(step);
            }
            if let Some(finished) = self.ended {
                return Ok(Step::End { finished });
            }
            if let Some(step) = self.outside_chunks()? {
                return Ok(step);
            }
        }
    }

    /// The next record of the open chunk; `None` when there is none.
    fn within_chunk(&mut self) -> Option<Step> {
        while !self.chunk.is_empty() {
            let head = record_head(&self.chunk);
            let end = head.and_then(|(_, length)| usize::try_from(length).ok()?.checked_add(RECORD_HEAD_BYTES));
            let whole = end.filter(|end| *end <= self.chunk.len());
            let (Some((opcode, _)), Some(end)) = (head, whole) else {
                let left = std::mem::take(&mut self.chunk).len();
                // In a chunk that is cut this is where the file ends, told below. In one whose checksum is right, the
                // writer was wrong.
                if self.cut_chunk.is_some() {
                    break;
                }
                let detail = format!("the last {left} bytes of a chunk are no record");
                return Some(Step::Damage(Damage { offset: self.offset, bytes: 0, detail, passed_over: true }));
            };
            let content = self.chunk.split_to(end).slice(RECORD_HEAD_BYTES..);
            if matches!(opcode, CHANNEL | MESSAGE) {
                return Some(Step::Record(opcode, content));
            }
        }
        let start = self.cut_chunk.take()?;
        self.ended = Some(false);
        let detail = "the file ends within a chunk; what was whole in it is read".to_owned();
        let bytes = self.length.saturating_sub(start);
        Some(Step::Damage(Damage { offset: start, bytes, detail, passed_over: false }))
    }

    /// The next record of the file itself; `None` when it is passed over or opens a chunk.
    fn outside_chunks(&mut self) -> io::Result<Option<Step>> {
        let start = self.offset;
        let mut head = Vec::with_capacity(RECORD_HEAD_BYTES);
        self.file.read_up_to(RECORD_HEAD_BYTES, &mut head)?;
        let Some((opcode, length)) = record_head(&head) else {
            let detail = "the file ends within the head of a record".to_owned();
            return Ok(Some(if head.is_empty() { self.end(false) } else { self.broken(start, detail) }));
        };
        let available = self.length.saturating_sub(start).saturating_sub(RECORD_HEAD_BYTES as u64);
        self.offset = start.saturating_add(RECORD_HEAD_BYTES as u64).saturating_add(length);
        match opcode {
            DATA_END => Ok(Some(self.tail(start)?)),
            HEADER | CHANNEL | MESSAGE | METADATA | ATTACHMENT | CHUNK => {
                if length > MAX_RECORD_BYTES {
                    let detail = format!("a record claims {length} bytes (at most {MAX_RECORD_BYTES} are read)");
                    return Ok(Some(self.broken(start, detail)));
                }
                let mut content = Vec::new();
                self.file.read_up_to(length as usize, &mut content)?;
                let cut = (content.len() as u64) < length;
                if opcode == CHUNK {
                    return Ok(self.open_chunk(start, &content, cut));
                }
                if cut {
                    let detail = format!("the file ends {} bytes into a record of {length}", content.len());
                    return Ok(Some(self.broken(start, detail)));
                }
                Ok((opcode != HEADER).then(|| Step::Record(opcode, Bytes::from(content))))
            }
            // Indexes: of no use to who reads from start to end.
            _ if length <= available => {
                io::copy(&mut self.file.by_ref().take(length), &mut io::sink())?;
                Ok(None)
            }
            _ => {
                let detail = format!("a record (opcode {opcode:#04x}) claims {length} bytes, {available} are left");
                Ok(Some(self.broken(start, detail)))
            }
        }
    }

    /// The data are at their end: an index, the footer and the magic once more follow.
    fn tail(&mut self, start: u64) -> io::Result<Step> {
        let mut rest = self.file.by_ref().take(self.length);
        let (mut last, mut block) = ([0; MAGIC.len()], [0; 4096]);
        loop {
            let count = rest.read(&mut block)?;
            let new = block.get(..count).unwrap_or_default();
            if new.is_empty() {
                break;
            }
            // The last eight of old and new bytes together.
            let joined = [&last[..], new].concat();
            if let Some(newest) = joined.last_chunk() {
                last = *newest;
            }
        }
        if last == MAGIC {
            return Ok(self.end(true));
        }
        Ok(self.broken(start, "the file ends within its index; the data are whole".to_owned()))
    }

    fn end(&mut self, finished: bool) -> Step {
        self.ended = Some(finished);
        Step::End { finished }
    }

    fn broken(&mut self, offset: u64, detail: String) -> Step {
        self.ended = Some(false);
        let bytes = self.length.saturating_sub(offset);
        Step::Damage(Damage { offset, bytes, detail, passed_over: false })
    }

    fn open_chunk(&mut self, start: u64, content: &[u8], cut: bool) -> Option<Step> {
        let length = self.offset.saturating_sub(start).saturating_sub(RECORD_HEAD_BYTES as u64);
        match unpack(content, length, cut) {
            Ok(records) => {
                self.chunk = Bytes::from(records);
                self.cut_chunk = cut.then_some(start);
                None
            }
            Err(detail) if cut => Some(self.broken(start, detail)),
            Err(detail) => {
                let bytes = self.offset.saturating_sub(start);
                Some(Step::Damage(Damage { offset: start, bytes, detail, passed_over: true }))
            }
        }
    }
}

/// The channel records of a finished part's index, provided its checksum is right; else none.
pub(crate) fn index_channels(path: &Path) -> io::Result<Vec<Vec<u8>>> {
    // Footer: opcode and length, start of the index u64, start of its own index u64, CRC u32; then the magic.
    const FOOTER_BYTES: usize = RECORD_HEAD_BYTES + 8 + 8 + 4;
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    let Some(footer_at) = length.checked_sub((FOOTER_BYTES + MAGIC.len()) as u64) else { return Ok(Vec::new()) };
    let mut footer = Vec::new();
    file.seek(SeekFrom::Start(footer_at))?;
    file.read_up_to(FOOTER_BYTES, &mut footer)?;
    let (head, rest) = footer.split_at_checked(RECORD_HEAD_BYTES).unwrap_or_default();
    let mut fields = Fields(rest);
    let (Some((FOOTER, 20)), Some(start), Some(_), Some(crc)) =
        (record_head(head), fields.u64(), fields.u64(), fields.u32())
    else {
        return Ok(Vec::new());
    };
    if start == 0 || start > footer_at || footer_at - start > MAX_RECORD_BYTES {
        return Ok(Vec::new());
    }
    file.seek(SeekFrom::Start(start))?;
    let mut index = Vec::new();
    file.read_up_to((footer_at - start) as usize, &mut index)?;
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&index);
    // The checksum covers the footer up to itself.
    hasher.update(footer.get(..FOOTER_BYTES - 4).unwrap_or_default());
    if hasher.finalize() != crc {
        return Ok(Vec::new());
    }
    let mut channels = Vec::new();
    let mut rest = index.as_slice();
    while let Some((opcode, length)) = record_head(rest) {
        let behind_head = rest.get(RECORD_HEAD_BYTES..).unwrap_or_default();
        let split = usize::try_from(length).ok().and_then(|length| behind_head.split_at_checked(length));
        let Some((content, next)) = split else { break };
        if opcode == CHANNEL {
            channels.push(content.to_vec());
        }
        rest = next;
    }
    Ok(channels)
}

/// The records of a chunk. `length`: of its content, as its record's head has it. `cut`: as many as are there, unchecked;
/// else all of them, checked.
fn unpack(content: &[u8], length: u64, cut: bool) -> Result<Vec<u8>, String> {
    let mut fields = Fields(content);
    let Some(head) = ChunkHead::read(&mut fields) else {
        return Err("a chunk that ends within its header".to_owned());
    };
    if head.unpacked_bytes > MAX_UNPACKED_BYTES {
        let claim = head.unpacked_bytes;
        return Err(format!("a chunk claims to unpack to {claim} bytes (at most {MAX_UNPACKED_BYTES} are read)"));
    }
    let packed = fields.0;
    // A damaged length must not pass for a file that ends early: then nothing would be held against the checksum.
    let expected = ((content.len() - packed.len()) as u64).saturating_add(head.packed_bytes);
    if expected != length {
        return Err(format!("a chunk of {length} bytes says it has {expected}"));
    }
    let mut records = Vec::new();
    let outcome = match head.compression {
        "" => packed.take(head.unpacked_bytes).read_to_end(&mut records),
        "lz4" => match lz4::Decoder::new(packed) {
            Ok(decoder) => decoder.take(head.unpacked_bytes).read_to_end(&mut records),
            Err(error) => Err(error),
        },
        other => return Err(format!("a chunk is compressed with {other:?}, expected lz4 or nothing")),
    };
    if cut {
        // That it does not unpack to the end is what being cut means.
        return Ok(records);
    }
    outcome.map_err(|error| format!("a chunk does not unpack: {error}"))?;
    if records.len() as u64 != head.unpacked_bytes {
        return Err(format!("a chunk unpacks to {} bytes, expected {}", records.len(), head.unpacked_bytes));
    }
    let crc = crc32fast::hash(&records);
    if head.crc != 0 && crc != head.crc {
        return Err(format!("a chunk's checksum is {crc:08x}, expected {:08x}", head.crc));
    }
    Ok(records)
}

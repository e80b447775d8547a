//! The records of an MCAP file in order, chunks opened (mcap.dev/spec).
//!
//! After the magic (8 bytes) a file is a row of records: opcode u8, length u64, content; all little-endian. A chunk's
//! content is start u64, end u64, uncompressed size u64, CRC u32, compression as text, compressed size u64 and
//! then records again, compressed as a whole.
//!
//! Read here and not with the `mcap` crate, which the tests write with: its reader reserves up to 4 GiB for a
//! name that merely claims to be so long, and subtracts past zero on a chunk whose records are longer than itself.

use super::files::{MCAP_MAGIC, io_error, open_buffered};
use super::packets::ReadUpTo;
use super::{CaptureError, MAX_RECORD_BYTES};
use std::fs::File;
use std::io::{BufReader, Cursor, Read};
use std::path::Path;

pub(crate) const SCHEMA: u8 = 0x03;
pub(crate) const CHANNEL: u8 = 0x04;
pub(crate) const MESSAGE: u8 = 0x05;
const CHUNK: u8 = 0x06;
const DATA_END: u8 = 0x0f;

const HEAD_BYTES: usize = 9;

/// Writers make chunks of about a megabyte; one that unpacks to more than this is a bomb.
const MAX_CHUNK_BYTES: u64 = 1 << 30;

/// zstd's window, log2: 64 MiB, four times what its highest ordinary level asks for.
const ZSTD_WINDOW_LOG: u32 = 26;

/// Why there is no next record.
pub(crate) enum RecordError {
    /// The system could not read.
    Io(std::io::Error),
    /// What stands at this offset cannot be read, nor what follows it.
    Broken { offset: u64, detail: String },
}

/// Reads schemas, channels and messages one after the other; all other records are passed over.
pub(crate) struct McapRecords {
    file: BufReader<File>,
    offset: u64,
    chunk: Option<Chunk>,
    content: Vec<u8>,
    finished: bool,
}

/// A chunk being read. Its records are unpacked one by one: only the compressed bytes are held.
struct Chunk {
    records: Checked<Box<dyn Read + Send>>,
    /// Of the unpacked records; 0: not given.
    crc: u32,
    offset: u64,
    /// The file ends before the chunk does.
    cut: bool,
}

/// Passes bytes through and takes their checksum.
struct Checked<R> {
    inner: R,
    hasher: crc32fast::Hasher,
}

impl<R: Read> Read for Checked<R> {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        let count = self.inner.read(into)?;
        self.hasher.update(into.get(..count).unwrap_or_default());
        Ok(count)
    }
}

impl McapRecords {
    pub(crate) fn open(path: &Path) -> Result<Self, CaptureError> {
        let mut file = open_buffered(path)?;
        let mut magic = Vec::new();
        file.read_up_to(MCAP_MAGIC.len(), &mut magic).map_err(io_error(path))?;
        if magic != MCAP_MAGIC {
            return Err(CaptureError::TooShort { path: path.to_owned(), length: magic.len() as u64 });
        }
        let offset = MCAP_MAGIC.len() as u64;
        Ok(Self { file, offset, chunk: None, content: Vec::new(), finished: false })
    }

    /// The next schema, channel or message: opcode and content; `None` at the end of the data section.
    pub(crate) fn next_record(&mut self) -> Result<Option<(u8, &[u8])>, RecordError> {
        let found = self.find_next();
        if !matches!(found, Ok(Some(_))) {
            self.finished = true;
        }
        Ok(found?.map(|opcode| (opcode, self.content.as_slice())))
    }

    fn find_next(&mut self) -> Result<Option<u8>, RecordError> {
        while !self.finished {
            if let Some(chunk) = &mut self.chunk {
                let found = chunk.next_record(&mut self.content);
                let broken = |detail| RecordError::Broken { offset: chunk.offset, detail };
                if let Some(opcode) = found.map_err(broken)? {
                    return Ok(Some(opcode));
                }
                self.chunk = None;
            }
            if let Some(opcode) = self.next_outside_chunks()? {
                return Ok(Some(opcode));
            }
        }
        Ok(None)
    }

    /// Reads one record of the file itself; `None` when it is passed over, opens a chunk, or ends the data.
    fn next_outside_chunks(&mut self) -> Result<Option<u8>, RecordError> {
        let offset = self.offset;
        let broken = |detail: String| RecordError::Broken { offset, detail };
        let mut head = Vec::with_capacity(HEAD_BYTES);
        self.file.read_up_to(HEAD_BYTES, &mut head).map_err(RecordError::Io)?;
        let Some((opcode, length)) = record_head(&head) else {
            return Err(broken("the recording was interrupted: the file ends without its end record".to_owned()));
        };
        self.offset = offset.saturating_add(HEAD_BYTES as u64).saturating_add(length);
        match opcode {
            DATA_END => {
                // What follows is an index of what was read.
                self.finished = true;
                Ok(None)
            }
            SCHEMA | CHANNEL | MESSAGE | CHUNK => {
                if length > MAX_RECORD_BYTES as u64 {
                    return Err(broken(too_large(length)));
                }
                self.content.clear();
                self.file.read_up_to(length as usize, &mut self.content).map_err(RecordError::Io)?;
                let cut = (self.content.len() as u64) < length;
                if opcode == CHUNK {
                    let content = std::mem::take(&mut self.content);
                    self.chunk = Some(Chunk::open(content, offset, cut).map_err(broken)?);
                    return Ok(None);
                }
                if cut {
                    return Err(broken(format!(
                        "the file ends {} bytes into a record of {length}",
                        self.content.len()
                    )));
                }
                Ok(Some(opcode))
            }
            _ => {
                let skipped = std::io::copy(&mut self.file.by_ref().take(length), &mut std::io::sink());
                if skipped.map_err(RecordError::Io)? < length {
                    return Err(broken(format!("the file ends within a record of {length} bytes")));
                }
                Ok(None)
            }
        }
    }
}

impl Chunk {
    /// `cut`: the content is not all there; what is there is read.
    fn open(content: Vec<u8>, offset: u64, cut: bool) -> Result<Self, String> {
        let mut fields = Fields(&content);
        let Some(head) = ChunkHead::read(&mut fields) else {
            return Err("a chunk that ends within its header".to_owned());
        };
        let ChunkHead { unpacked_bytes: size, crc, compression, packed_bytes: compressed_size } = head;
        let compression = compression.to_owned();
        let start = content.len() - fields.0.len();
        if size > MAX_CHUNK_BYTES {
            return Err(format!("a chunk claims to unpack to {size} bytes (at most {MAX_CHUNK_BYTES} are read)"));
        }
        if !cut && compressed_size > fields.0.len() as u64 {
            return Err(format!("a chunk claims {compressed_size} bytes of records, but has {}", fields.0.len()));
        }
        let mut packed = Cursor::new(content);
        packed.set_position(start as u64);
        let packed = packed.take(compressed_size);
        let unpacked: Box<dyn Read + Send> = match compression.as_str() {
            "" => Box::new(packed),
            "lz4" => Box::new(lz4::Decoder::new(packed).map_err(|error| error.to_string())?),
            "zstd" => {
                let mut decoder = zstd::stream::read::Decoder::new(packed).map_err(|error| error.to_string())?;
                decoder.window_log_max(ZSTD_WINDOW_LOG).map_err(|error| error.to_string())?;
                Box::new(decoder)
            }
            other => return Err(format!("a chunk is compressed with {other:?}, expected zstd, lz4 or nothing")),
        };
        let records: Box<dyn Read + Send> = Box::new(unpacked.take(size));
        Ok(Self { records: Checked { inner: records, hasher: crc32fast::Hasher::new() }, crc, offset, cut })
    }

    /// The next schema, channel or message; `None` at a good end of the chunk.
    fn next_record(&mut self, content: &mut Vec<u8>) -> Result<Option<u8>, String> {
        let cut = self.cut;
        let unreadable = move |error: std::io::Error| match cut {
            true => "the file ends within a chunk".to_owned(),
            false => format!("a chunk does not unpack: {error}"),
        };
        loop {
            content.clear();
            self.records.read_up_to(HEAD_BYTES, content).map_err(unreadable)?;
            if content.is_empty() && !self.cut {
                let crc = self.records.hasher.clone().finalize();
                if self.crc != 0 && self.crc != crc {
                    return Err(format!("a chunk's checksum is {crc:08x}, expected {:08x}", self.crc));
                }
                return Ok(None);
            }
            let Some((opcode, length)) = record_head(content) else {
                return Err("the file or a chunk ends within a record".to_owned());
            };
            if matches!(opcode, SCHEMA | CHANNEL | MESSAGE) {
                if length > MAX_RECORD_BYTES as u64 {
                    return Err(too_large(length));
                }
                content.clear();
                self.records.read_up_to(length as usize, content).map_err(unreadable)?;
                if (content.len() as u64) < length {
                    return Err(format!("a record of {length} bytes ends after {}", content.len()));
                }
                return Ok(Some(opcode));
            }
            let skipped = std::io::copy(&mut self.records.by_ref().take(length), &mut std::io::sink());
            if skipped.map_err(unreadable)? < length {
                return Err(format!("a record claims {length} bytes, more than its chunk has"));
            }
        }
    }
}

fn too_large(length: u64) -> String {
    format!("a record claims {length} bytes (at most {MAX_RECORD_BYTES} are read)")
}

/// What a chunk says of itself before its records.
pub(crate) struct ChunkHead<'a> {
    pub(crate) unpacked_bytes: u64,
    /// Of the unpacked records; 0: not given.
    pub(crate) crc: u32,
    pub(crate) compression: &'a str,
    pub(crate) packed_bytes: u64,
}

impl<'a> ChunkHead<'a> {
    pub(crate) fn read(fields: &mut Fields<'a>) -> Option<Self> {
        let _times = (fields.u64()?, fields.u64()?);
        let (unpacked_bytes, crc) = (fields.u64()?, fields.u32()?);
        let compression = fields.text()?;
        Some(Self { unpacked_bytes, crc, compression, packed_bytes: fields.u64()? })
    }
}

/// A record's opcode and length, from the first nine bytes.
pub(crate) fn record_head(bytes: &[u8]) -> Option<(u8, u64)> {
    let &[opcode, l0, l1, l2, l3, l4, l5, l6, l7] = bytes.first_chunk::<HEAD_BYTES>()?;
    Some((opcode, u64::from_le_bytes([l0, l1, l2, l3, l4, l5, l6, l7])))
}

/// Little-endian fields in a row; each read is `None` where the record ends early.
pub(crate) struct Fields<'a>(pub(crate) &'a [u8]);

impl<'a> Fields<'a> {
    pub(crate) fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (array, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*array)
    }

    pub(crate) fn u8(&mut self) -> Option<u8> {
        self.array().map(u8::from_le_bytes)
    }

    pub(crate) fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub(crate) fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub(crate) fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    pub(crate) fn i64(&mut self) -> Option<i64> {
        self.array().map(i64::from_le_bytes)
    }

    /// A u32 length and so many bytes of UTF-8.
    pub(crate) fn text(&mut self) -> Option<&'a str> {
        let length = self.u32()? as usize;
        let (text, rest) = self.0.split_at_checked(length)?;
        self.0 = rest;
        std::str::from_utf8(text).ok()
    }
}

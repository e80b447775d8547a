//! Framing of pcapng files (draft-ietf-opsawg-pcapng).
//!
//! A file is a row of blocks: type u32, total length u32 (a multiple of 4), body, total length again. A section
//! header (0x0a0d0d0a) sets the byte order, interface descriptions (1) the link type and the stamps' unit;
//! packets are in enhanced (6), obsolete (2) and simple (3) packet blocks. All others are passed over.

use super::datagram::LinkType;
use super::files::{io_error, open_buffered, read_head};
use super::packets::{Framing, FramingError, PacketHead, ReadUpTo};
use super::{CaptureError, MAX_RECORD_BYTES, Place};
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;
use tumbled_model::UnixNs;

const SECTION_HEADER: u32 = 0x0a0d_0d0a;
const INTERFACE_DESCRIPTION: u32 = 1;
const OBSOLETE_PACKET: u32 = 2;
const SIMPLE_PACKET: u32 = 3;
const ENHANCED_PACKET: u32 = 6;

/// Type, length, byte-order mark, version (4), section length (8), length again; bytes.
const SMALLEST_SECTION_HEADER: u64 = 28;

/// More interfaces than any machine has: a file with more is damaged.
const MAX_INTERFACES: usize = 1 << 16;

#[derive(Clone, Copy, Debug)]
struct Interface {
    link: Result<LinkType, u16>,
    clock: Clock,
}

/// The unit and zero of an interface's stamps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Clock {
    /// if_tsresol: bit 7 clear: 10^-n s, set: 2^-n s.
    resolution: u8,
    /// if_tsoffset: seconds to add.
    offset_s: i64,
}

impl Default for Clock {
    fn default() -> Self {
        Self { resolution: 6, offset_s: 0 }
    }
}

impl Clock {
    /// The instant of a stamp; `None` before 1970 and after 2262.
    fn instant(self, stamp: u64) -> Option<UnixNs> {
        let n = u32::from(self.resolution & 0x7f);
        let stamp = u128::from(stamp);
        let ns = if self.resolution & 0x80 != 0 {
            // stamp × 10^9 is below 2^94: finer units leave nothing of it.
            (stamp * 1_000_000_000).checked_shr(n).unwrap_or(0)
        } else if n <= 9 {
            stamp * 10u128.pow(9 - n)
        } else {
            10u128.checked_pow(n - 9).map_or(0, |divisor| stamp / divisor)
        };
        let ns = i128::try_from(ns).ok()?.checked_add(i128::from(self.offset_s) * 1_000_000_000)?;
        i64::try_from(ns).ok().filter(|&ns| ns >= 0).map(UnixNs)
    }
}

/// Reads the packets of a pcapng one after the other.
pub(crate) struct PcapNgFraming {
    reader: BufReader<File>,
    big_endian: bool,
    interfaces: Vec<Interface>,
    offset: u64,
    body: Vec<u8>,
    finished: bool,
}

impl PcapNgFraming {
    pub(crate) fn open(path: &Path) -> Result<Self, CaptureError> {
        let reader = open_buffered(path)?;
        let mut framing =
            Self { reader, big_endian: false, interfaces: Vec::new(), offset: 0, body: Vec::new(), finished: false };
        // The first block must be a whole section header, else there is nothing to salvage.
        match framing.next_block() {
            Ok(Some(SECTION_HEADER)) if !framing.finished => Ok(framing),
            Ok(Some(found)) if found != SECTION_HEADER => {
                let expected = "a pcapng section header (0x0a0d0d0a)";
                Err(CaptureError::BadHeader { path: path.to_owned(), offset: 0, found: u64::from(found), expected })
            }
            Err(FramingError::Io(source)) => Err(io_error(path)(source)),
            Ok(_) | Err(FramingError::Broken { .. }) => Err(framing.why_no_section(path)?),
        }
    }

    /// What is wrong with a section header that cannot be read: it is cut, or a field of it is impossible.
    fn why_no_section(&self, path: &Path) -> Result<CaptureError, CaptureError> {
        let path_of = || path.to_owned();
        let length = std::fs::metadata(path).map_err(io_error(path))?.len();
        let too_short = CaptureError::TooShort { path: path_of(), length };
        if length < SMALLEST_SECTION_HEADER {
            return Ok(too_short);
        }
        let bad = |offset, found, expected| CaptureError::BadHeader { path: path_of(), offset, found, expected };
        let mark = be_u32(&self.body).unwrap_or(0);
        if ![0x1a2b_3c4d, 0x4d3c_2b1a].contains(&mark) {
            return Ok(bad(8, u64::from(mark), "a pcapng byte-order mark 0x1a2b3c4d"));
        }
        let head = read_head(path, 8)?;
        let total = head.get(4..).and_then(be_u32).unwrap_or(0);
        let total = u64::from(if self.big_endian { total } else { total.swap_bytes() });
        if total < SMALLEST_SECTION_HEADER || !total.is_multiple_of(4) || total > MAX_RECORD_BYTES as u64 {
            return Ok(bad(4, total, "the length of a section header, a multiple of 4 of at least 28"));
        }
        if length < total {
            return Ok(too_short);
        }
        match self.u16_at(4) {
            Some(version) if version != 1 => Ok(bad(12, u64::from(version), "version 1 of pcapng")),
            _ => Ok(bad(4, total, "the length that the section header is closed with")),
        }
    }

    fn u32_at(&self, offset: usize) -> Option<u32> {
        let bytes = *self.body.get(offset..)?.first_chunk::<4>()?;
        Some(if self.big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }

    fn u16_at(&self, offset: usize) -> Option<u16> {
        let bytes = *self.body.get(offset..)?.first_chunk::<2>()?;
        Some(if self.big_endian { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) })
    }

    /// Reads the next block's body into `self.body` (left empty for blocks that are passed over) and returns its
    /// type. Section headers and interface descriptions take effect here.
    fn next_block(&mut self) -> Result<Option<u32>, FramingError> {
        let place = Place::Byte(self.offset);
        let broken = |detail: String| FramingError::Broken { place, detail };
        self.body.clear();
        let mut head = Vec::with_capacity(8);
        self.reader.read_up_to(8, &mut head)?;
        if head.is_empty() {
            return Ok(None);
        }
        let Some(&[t0, t1, t2, t3, l0, l1, l2, l3]) = head.first_chunk::<8>() else {
            return Err(broken(format!("the file ends {} bytes into a block's head", head.len())));
        };
        let is_section = u32::from_be_bytes([t0, t1, t2, t3]) == SECTION_HEADER;
        if is_section {
            // The byte order of the length is known only from the mark behind it.
            self.reader.read_up_to(4, &mut self.body)?;
            self.big_endian = match self.body.as_slice() {
                [0x1a, 0x2b, 0x3c, 0x4d] => true,
                [0x4d, 0x3c, 0x2b, 0x1a] => false,
                _ => return Err(broken("a section header without a byte-order mark".to_owned())),
            };
        }
        let word = |bytes| if self.big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) };
        let block_type = word([t0, t1, t2, t3]);
        let total = word([l0, l1, l2, l3]);
        let Some(body_len) = (total as usize).checked_sub(12).filter(|len| len % 4 == 0 && *len >= self.body.len())
        else {
            return Err(broken(format!("a block of impossible length {total}")));
        };
        let wanted = [SECTION_HEADER, INTERFACE_DESCRIPTION, OBSOLETE_PACKET, SIMPLE_PACKET, ENHANCED_PACKET]
            .contains(&block_type);
        if wanted {
            if body_len > MAX_RECORD_BYTES {
                return Err(broken(format!("a block claims {total} bytes (at most {MAX_RECORD_BYTES} are read)")));
            }
            self.reader.read_up_to(body_len - self.body.len(), &mut self.body)?;
            if self.body.len() < body_len {
                // What is there of a packet may still tell whose it was.
                self.finished = true;
                return Ok(Some(block_type));
            }
        } else {
            let skipped = std::io::copy(&mut self.reader.by_ref().take(body_len as u64), &mut std::io::sink())?;
            if skipped < body_len as u64 {
                return Err(broken(format!("the file ends within a block of {total} bytes")));
            }
        }
        let mut trailer = Vec::with_capacity(4);
        self.reader.read_up_to(4, &mut trailer)?;
        if trailer != [l0, l1, l2, l3] {
            return Err(broken(format!("a block of {total} bytes is not closed by its length")));
        }
        self.offset += u64::from(total);
        match block_type {
            SECTION_HEADER => {
                if self.u16_at(4) != Some(1) {
                    return Err(broken("a section of a version other than 1".to_owned()));
                }
                self.interfaces.clear();
            }
            INTERFACE_DESCRIPTION => {
                let Some(interface) = self.interface() else {
                    return Err(broken("an interface description that ends early".to_owned()));
                };
                if self.interfaces.len() >= MAX_INTERFACES {
                    return Err(broken(format!("more than {MAX_INTERFACES} interfaces")));
                }
                self.interfaces.push(interface);
            }
            _ => {}
        }
        Ok(Some(block_type))
    }

    /// Body: link type u16, reserved u16, snap length u32, options (code u16, length u16, value padded to 4).
    fn interface(&self) -> Option<Interface> {
        let number = self.u16_at(0)?;
        let mut clock = Clock::default();
        let mut at = 8;
        while let (Some(code), Some(length)) = (self.u16_at(at), self.u16_at(at + 2)) {
            let value = self.body.get(at + 4..at + 4 + usize::from(length));
            match (code, value) {
                (0, _) => break,
                (9, Some(&[resolution])) => clock.resolution = resolution,
                (14, Some(value)) => {
                    if let Some(&bytes) = value.first_chunk::<8>() {
                        clock.offset_s =
                            if self.big_endian { i64::from_be_bytes(bytes) } else { i64::from_le_bytes(bytes) };
                    }
                }
                _ => {}
            }
            at += 4 + usize::from(length).next_multiple_of(4);
        }
        self.u32_at(4)?;
        Some(Interface { link: LinkType::from_number(number).ok_or(number), clock })
    }

    /// The fields of the packet block in `self.body` and where its bytes start; `None` when it ends early or names
    /// an interface that does not exist.
    fn packet_fields(&self, block_type: u32) -> Option<Fields> {
        let (interface, stamp_at, lengths_at, data_at) = match block_type {
            ENHANCED_PACKET => (self.u32_at(0)? as usize, Some(4), 12, 20),
            OBSOLETE_PACKET => (usize::from(self.u16_at(0)?), Some(4), 12, 20),
            _ => (0, None, 0, 4),
        };
        let interface = *self.interfaces.get(interface)?;
        let host = match stamp_at {
            Some(at) => {
                let stamp = u64::from(self.u32_at(at)?) << 32 | u64::from(self.u32_at(at + 4)?);
                interface.clock.instant(stamp)
            }
            None => None,
        };
        let (captured, on_wire) = if stamp_at.is_some() {
            (self.u32_at(lengths_at)? as usize, self.u32_at(lengths_at + 4)? as usize)
        } else {
            // A simple packet has the wire's length only; the block ends where the packet does.
            let on_wire = self.u32_at(lengths_at)? as usize;
            (on_wire.min(self.body.len().saturating_sub(data_at)), on_wire)
        };
        Some(Fields { link: interface.link, host, captured, on_wire, data_at })
    }
}

struct Fields {
    link: Result<LinkType, u16>,
    host: Option<UnixNs>,
    captured: usize,
    on_wire: usize,
    data_at: usize,
}

fn be_u32(bytes: &[u8]) -> Option<u32> {
    bytes.first_chunk::<4>().map(|bytes| u32::from_be_bytes(*bytes))
}

impl Framing for PcapNgFraming {
    fn next_packet(&mut self, frame: &mut Vec<u8>) -> Result<Option<PacketHead>, FramingError> {
        loop {
            if self.finished {
                return Ok(None);
            }
            let place = Place::Byte(self.offset);
            let Some(block_type) = self.next_block()? else {
                return Ok(None);
            };
            let ends_early =
                self.finished.then(|| (place, format!("the file ends {} bytes into a block", 8 + self.body.len())));
            if ![OBSOLETE_PACKET, SIMPLE_PACKET, ENHANCED_PACKET].contains(&block_type) {
                match ends_early {
                    Some((place, detail)) => return Err(FramingError::Broken { place, detail }),
                    None => continue,
                }
            }
            let Some(fields) = self.packet_fields(block_type) else {
                let (place, detail) = ends_early.unwrap_or((
                    place,
                    "a packet that ends early or names an interface that does not exist".to_owned(),
                ));
                return Err(FramingError::Broken { place, detail });
            };
            let data = self.body.get(fields.data_at..).unwrap_or_default();
            let data = data.get(..fields.captured).unwrap_or(data);
            frame.clear();
            frame.extend_from_slice(data);
            let cut = data.len() < fields.on_wire.max(fields.captured);
            return Ok(Some(PacketHead { host: fields.host, link: fields.link, cut, ends_early }));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_of_every_unit_come_out_in_nanoseconds() {
        let at = |resolution, offset_s, stamp| Clock { resolution, offset_s }.instant(stamp);
        assert_eq!(at(6, 0, 1_500_000), Some(UnixNs(1_500_000_000)));
        assert_eq!(at(9, 2, 7), Some(UnixNs(2_000_000_007)));
        assert_eq!(at(0, 0, 3), Some(UnixNs(3_000_000_000)));
        assert_eq!(at(12, 0, 5_999), Some(UnixNs(5)));
        // 2^-10 s: 512 units are half a second.
        assert_eq!(at(0x80 | 10, 0, 512), Some(UnixNs(500_000_000)));
        assert_eq!(at(0, 0, u64::MAX), None, "year 584 billion");
        assert_eq!(at(6, -1, 0), None, "before 1970");
        assert_eq!(at(127, 0, u64::MAX), Some(UnixNs(0)));
        assert_eq!(at(0xff, 0, u64::MAX), Some(UnixNs(0)));
    }
}

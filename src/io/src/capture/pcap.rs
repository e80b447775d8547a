//! Framing of classic libpcap files.
//!
//! | offset | size | file header | | offset | size | record header |
//! |---|---|---|---|---|---|---|
//! | 0 | 4 | magic: byte order, µs or ns | | 0 | 4 | seconds since 1970, unsigned |
//! | 4 | 4 | version 2.4 | | 4 | 4 | µs or ns of the second |
//! | 8 | 8 | zone, accuracy: unused | | 8 | 4 | bytes in the file |
//! | 16 | 4 | snap length | | 12 | 4 | bytes on the wire |
//! | 20 | 4 | link type (low 16 bits) | | 16 | | the bytes |
//!
//! Read here and not with the `pcap-file` crate, which the tests write with: that one refuses records longer on
//! the wire than the snap length (the very mark of a cut packet), cannot say at which byte a file breaks off, and
//! holds an 8 MB buffer per file.

use super::datagram::LinkType;
use super::files::{io_error, open_buffered};
use super::packets::{Framing, FramingError, PacketHead, ReadUpTo};
use super::{CaptureError, MAX_RECORD_BYTES, Place};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;
use tumbled_model::UnixNs;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Order {
    Little,
    Big,
}

impl Order {
    fn u32(self, bytes: [u8; 4]) -> u32 {
        match self {
            Self::Little => u32::from_le_bytes(bytes),
            Self::Big => u32::from_be_bytes(bytes),
        }
    }
}

/// Reads the records of a classic pcap one after the other.
pub(crate) struct PcapFraming {
    reader: BufReader<File>,
    order: Order,
    /// Nanoseconds in a unit of the stamp's second half.
    ns_per_unit: i64,
    link: LinkType,
    offset: u64,
}

impl PcapFraming {
    pub(crate) fn open(path: &Path) -> Result<Self, CaptureError> {
        let mut reader = open_buffered(path)?;
        let mut header = Vec::new();
        reader.read_up_to(24, &mut header).map_err(io_error(path))?;
        let Some(header) = header.first_chunk::<24>() else {
            return Err(CaptureError::TooShort { path: path.to_owned(), length: header.len() as u64 });
        };
        let [m0, m1, m2, m3, .., l0, l1, l2, l3] = *header;
        let magic = u32::from_be_bytes([m0, m1, m2, m3]);
        let (order, ns_per_unit) = match magic {
            0xa1b2_c3d4 => (Order::Big, 1_000),
            0xd4c3_b2a1 => (Order::Little, 1_000),
            0xa1b2_3c4d => (Order::Big, 1),
            0x4d3c_b2a1 => (Order::Little, 1),
            _ => {
                let found = u64::from(magic);
                let expected = "a pcap magic number";
                return Err(CaptureError::BadHeader { path: path.to_owned(), offset: 0, found, expected });
            }
        };
        // The upper half holds the length of the frame check sequence; IP's own lengths make it irrelevant.
        let number = (order.u32([l0, l1, l2, l3]) & 0xffff) as u16;
        let Some(link) = LinkType::from_number(number) else {
            return Err(CaptureError::LinkType { path: path.to_owned(), number });
        };
        Ok(Self { reader, order, ns_per_unit, link, offset: 24 })
    }
}

impl Framing for PcapFraming {
    fn next_packet(&mut self, frame: &mut Vec<u8>) -> Result<Option<PacketHead>, FramingError> {
        let place = Place::Byte(self.offset);
        let mut header = Vec::with_capacity(16);
        self.reader.read_up_to(16, &mut header)?;
        if header.is_empty() {
            return Ok(None);
        }
        let Some(&[s0, s1, s2, s3, f0, f1, f2, f3, i0, i1, i2, i3, o0, o1, o2, o3]) = header.first_chunk::<16>() else {
            let detail = format!("the file ends {} bytes into a 16-byte record header", header.len());
            return Err(FramingError::Broken { place, detail });
        };
        let seconds = i64::from(self.order.u32([s0, s1, s2, s3]));
        // A fraction of a second or more is wrong but harmless: it is added as it stands.
        let fraction = i64::from(self.order.u32([f0, f1, f2, f3]));
        let captured = self.order.u32([i0, i1, i2, i3]) as usize;
        let on_wire = self.order.u32([o0, o1, o2, o3]) as usize;
        if captured > MAX_RECORD_BYTES {
            let detail = format!("a record claims {captured} bytes (at most {MAX_RECORD_BYTES} are read)");
            return Err(FramingError::Broken { place, detail });
        }
        frame.clear();
        self.reader.read_up_to(captured, frame)?;
        self.offset += 16 + frame.len() as u64;
        let host = UnixNs(seconds * 1_000_000_000 + fraction * self.ns_per_unit);
        let ends_early = (frame.len() < captured)
            .then(|| (place, format!("the file ends {} bytes into a packet of {captured} bytes", frame.len())));
        Ok(Some(PacketHead { host: Some(host), link: Ok(self.link), cut: frame.len() < on_wire, ends_early }))
    }
}

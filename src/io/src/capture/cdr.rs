//! The two ROS 2 messages that hold raw sensor data, in their wire form.
//!
//! A message is a 4-byte encapsulation header (byte 1: 0 big-endian, 1 little-endian; 6, 7 the same of XCDR2) and
//! the fields in order, each aligned to its size counted from after that header (OMG DDS-XTypes 1.3, 7.4.3). Strings are
//! a u32 length with the closing zero counted, and the bytes; sequences a u32 count and the elements.
//!
//! ```text
//! velodyne_msgs/msg/VelodyneScan      sensor_msgs/msg/Image
//!   i32, u32  stamp                     i32, u32  stamp
//!   string    frame_id                  string    frame_id
//!   sequence of:                        u32, u32  height, width
//!     i32, u32   stamp                  string    encoding
//!     u8 × 1206  data                   u8, u32   is_bigendian, step (bytes per row)
//!                                       sequence of u8: data
//! ```

use bytes::Bytes;
use core::ops::Range;
use tumbled_model::UnixNs;

const PACKET_BYTES: usize = 1206;
const WIDTH: usize = 640;
const HEIGHT: usize = 480;
const ROW_BYTES: usize = WIDTH * 2;

/// Why a message cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MessageFault {
    /// The first two bytes are no CDR encapsulation that is read.
    #[error("begins with {0:02x?}, expected a CDR encapsulation (00 00, 00 01, 00 06 or 00 07)")]
    Encapsulation([u8; 2]),
    /// The message is shorter than its own fields claim.
    #[error("ends early: byte {at} plus {wanted} bytes of a field are past its {length} bytes")]
    EndsEarly {
        /// Offset of the field after the encapsulation header.
        at: usize,
        /// Bytes the field claims.
        wanted: usize,
        /// Bytes there are.
        length: usize,
    },
    /// An image of another pixel type.
    #[error("an image of encoding {0:?}, expected 16UC1 or mono16")]
    Encoding(String),
    /// An image of another size.
    #[error("an image of {width}x{height} pixels, expected 640x480")]
    Size {
        /// Pixels.
        width: u32,
        /// Pixels.
        height: u32,
    },
    /// Rows shorter than their pixels.
    #[error("an image with rows of {step} bytes, expected at least 1280")]
    Step {
        /// Bytes per row claimed.
        step: u32,
    },
    /// A compressed message that does not unpack.
    #[error("does not unpack with zstd, or to more than {limit} bytes")]
    Zstd {
        /// The limit in bytes.
        limit: usize,
    },
}

/// A packet of a `VelodyneScan`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ScanPacket {
    /// The driver's stamp; `None`: zero or before 1970.
    pub(crate) stamp: Option<UnixNs>,
    /// Where its 1 206 bytes are in the message.
    pub(crate) data: Range<usize>,
}

/// A 640 × 480 16-bit image still in its message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct DepthImage<'a> {
    /// The header's stamp; `None`: zero or before 1970.
    pub(crate) stamp: Option<UnixNs>,
    big_endian: bool,
    step: usize,
    data: &'a [u8],
}

impl DepthImage<'_> {
    /// The 307 200 samples, little-endian, without row padding.
    pub(crate) fn samples(&self) -> Bytes {
        let mut samples = Vec::with_capacity(HEIGHT * ROW_BYTES);
        for row in self.data.chunks(self.step).take(HEIGHT) {
            samples.extend_from_slice(row.get(..ROW_BYTES).unwrap_or(row));
        }
        if self.big_endian {
            for sample in samples.chunks_exact_mut(2) {
                sample.reverse();
            }
        }
        Bytes::from(samples)
    }
}

/// The packets of a `velodyne_msgs/msg/VelodyneScan`.
pub(crate) fn velodyne_scan(message: &[u8]) -> Result<Vec<ScanPacket>, MessageFault> {
    let mut cdr = Cdr::new(message)?;
    cdr.stamp()?;
    cdr.string()?;
    let count = cdr.u32()? as usize;
    // Before anything is reserved for them: so many packets must be there.
    cdr.expect(count.saturating_mul(PACKET_BYTES))?;
    let mut packets = Vec::with_capacity(count);
    for _ in 0..count {
        let stamp = cdr.stamp()?;
        let data = cdr.take(PACKET_BYTES)?;
        packets.push(ScanPacket { stamp, data: ENCAPSULATION_BYTES + data.start..ENCAPSULATION_BYTES + data.end });
    }
    Ok(packets)
}

/// The depth image in a `sensor_msgs/msg/Image`; any other image is a fault that says what it is.
pub(crate) fn depth_image(message: &[u8]) -> Result<DepthImage<'_>, MessageFault> {
    let mut cdr = Cdr::new(message)?;
    let stamp = cdr.stamp()?;
    cdr.string()?;
    let height = cdr.u32()?;
    let width = cdr.u32()?;
    let encoding = cdr.string()?;
    if encoding != b"16UC1" && encoding != b"mono16" {
        let shown = String::from_utf8_lossy(encoding.get(..32).unwrap_or(encoding)).into_owned();
        return Err(MessageFault::Encoding(shown));
    }
    if (width as usize, height as usize) != (WIDTH, HEIGHT) {
        return Err(MessageFault::Size { width, height });
    }
    let big_endian = cdr.u8()? != 0;
    let step = cdr.u32()?;
    if (step as usize) < ROW_BYTES {
        return Err(MessageFault::Step { step });
    }
    let length = cdr.u32()? as usize;
    let data = cdr.take(length)?;
    // The last row may come without its padding.
    let needed = (step as usize).saturating_mul(HEIGHT - 1).saturating_add(ROW_BYTES);
    if length < needed {
        return Err(MessageFault::EndsEarly { at: data.start, wanted: needed, length: data.end });
    }
    let data = cdr.bytes.get(data).unwrap_or_default();
    Ok(DepthImage { stamp, big_endian, step: step as usize, data })
}

/// Encoding and size of any image, for people: `rgb8 1280x720`.
pub(crate) fn image_form(message: &[u8]) -> Option<String> {
    let mut cdr = Cdr::new(message).ok()?;
    cdr.stamp().ok()?;
    cdr.string().ok()?;
    let (height, width) = (cdr.u32().ok()?, cdr.u32().ok()?);
    let encoding = cdr.string().ok()?;
    let encoding = String::from_utf8_lossy(encoding.get(..32).unwrap_or(encoding));
    Some(format!("{encoding} {width}x{height}"))
}

const ENCAPSULATION_BYTES: usize = 4;

struct Cdr<'a> {
    /// What follows the encapsulation header; alignment counts from its start.
    bytes: &'a [u8],
    at: usize,
    big_endian: bool,
}

impl<'a> Cdr<'a> {
    fn new(message: &'a [u8]) -> Result<Self, MessageFault> {
        let Some((&[zero, kind, _, _], bytes)) = message.split_first_chunk::<ENCAPSULATION_BYTES>() else {
            return Err(MessageFault::EndsEarly { at: 0, wanted: ENCAPSULATION_BYTES, length: message.len() });
        };
        match (zero, kind) {
            (0, 0 | 6) => Ok(Self { bytes, at: 0, big_endian: true }),
            (0, 1 | 7) => Ok(Self { bytes, at: 0, big_endian: false }),
            other => Err(MessageFault::Encapsulation([other.0, other.1])),
        }
    }

    /// That `wanted` bytes are left.
    fn expect(&self, wanted: usize) -> Result<(), MessageFault> {
        if self.bytes.len().saturating_sub(self.at) < wanted {
            return Err(MessageFault::EndsEarly { at: self.at, wanted, length: self.bytes.len() });
        }
        Ok(())
    }

    fn take(&mut self, count: usize) -> Result<Range<usize>, MessageFault> {
        self.expect(count)?;
        let range = self.at..self.at + count;
        self.at += count;
        Ok(range)
    }

    fn u8(&mut self) -> Result<u8, MessageFault> {
        let range = self.take(1)?;
        Ok(self.bytes.get(range.start).copied().unwrap_or_default())
    }

    fn u32(&mut self) -> Result<u32, MessageFault> {
        self.at = self.at.next_multiple_of(4);
        let range = self.take(4)?;
        let bytes = self.bytes.get(range.start..).and_then(<[u8]>::first_chunk::<4>).copied().unwrap_or_default();
        Ok(if self.big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) })
    }

    fn string(&mut self) -> Result<&'a [u8], MessageFault> {
        let length = self.u32()? as usize;
        let range = self.take(length)?;
        let text = self.bytes.get(range).unwrap_or_default();
        Ok(text.strip_suffix(b"\0").unwrap_or(text))
    }

    /// `builtin_interfaces/Time`; `None` when the driver left it zero or it is before 1970.
    fn stamp(&mut self) -> Result<Option<UnixNs>, MessageFault> {
        let seconds = i64::from(self.u32()?.cast_signed());
        let nanoseconds = i64::from(self.u32()?);
        let ns = seconds * 1_000_000_000 + nanoseconds;
        Ok((seconds >= 0 && ns > 0).then_some(UnixNs(ns)))
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Writes CDR in either byte order.
    pub(in super::super) struct Writer {
        bytes: Vec<u8>,
        big_endian: bool,
    }

    impl Writer {
        pub(in super::super) fn new(big_endian: bool) -> Self {
            Self { bytes: vec![0, u8::from(!big_endian), 0, 0], big_endian }
        }
        pub(in super::super) fn u32(mut self, value: u32) -> Self {
            self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
            self.bytes.extend(if self.big_endian { value.to_be_bytes() } else { value.to_le_bytes() });
            self
        }
        pub(in super::super) fn raw(mut self, bytes: &[u8]) -> Self {
            self.bytes.extend(bytes);
            self
        }
        pub(in super::super) fn string(self, text: &str) -> Self {
            self.u32(text.len() as u32 + 1).raw(text.as_bytes()).raw(&[0])
        }
        pub(in super::super) fn finish(self) -> Vec<u8> {
            self.bytes
        }
    }

    pub(in super::super) fn scan_message(big_endian: bool, packets: &[(u32, u32, u8)]) -> Vec<u8> {
        let mut cdr = Writer::new(big_endian).u32(1).u32(2).string("velodyne").u32(packets.len() as u32);
        for &(seconds, nanoseconds, fill) in packets {
            cdr = cdr.u32(seconds).u32(nanoseconds).raw(&[fill; PACKET_BYTES]);
        }
        cdr.finish()
    }

    pub(in super::super) fn image_message(
        stamp: (u32, u32),
        (width, height): (u32, u32),
        encoding: &str,
        big_endian: bool,
        step: u32,
        data: &[u8],
    ) -> Vec<u8> {
        Writer::new(false)
            .u32(stamp.0)
            .u32(stamp.1)
            .string("kinect_depth")
            .u32(height)
            .u32(width)
            .string(encoding)
            .raw(&[u8::from(big_endian)])
            .u32(step)
            .u32(data.len() as u32)
            .raw(data)
            .finish()
    }

    #[test]
    fn scans_of_both_byte_orders_give_their_packets_with_stamps() {
        for big_endian in [false, true] {
            let message = scan_message(big_endian, &[(10, 5, 0xaa), (11, 6, 0xbb), (0, 0, 0xcc)]);
            let packets = velodyne_scan(&message).unwrap();
            let stamps: Vec<_> = packets.iter().map(|packet| packet.stamp).collect();
            assert_eq!(stamps, [Some(UnixNs(10_000_000_005)), Some(UnixNs(11_000_000_006)), None]);
            for (packet, fill) in packets.iter().zip([0xaa, 0xbb, 0xcc]) {
                assert_eq!(message[packet.data.clone()], [fill; PACKET_BYTES]);
            }
        }
    }

    #[test]
    fn images_lose_their_row_padding_and_their_byte_order() {
        // Sample k is k mod 65 536; rows are 1 300 bytes, the last one comes without its padding.
        for big_endian in [false, true] {
            let mut data = Vec::new();
            for k in 0..WIDTH * HEIGHT {
                let sample = k as u16;
                data.extend(if big_endian { sample.to_be_bytes() } else { sample.to_le_bytes() });
                if k % WIDTH == WIDTH - 1 && k / WIDTH < HEIGHT - 1 {
                    data.extend([0xee; 20]);
                }
            }
            let message = image_message((3, 4), (640, 480), "16UC1", big_endian, 1300, &data);
            let image = depth_image(&message).unwrap();
            assert_eq!(image.stamp, Some(UnixNs(3_000_000_004)));
            let expected: Vec<u8> = (0..WIDTH * HEIGHT).flat_map(|k| (k as u16).to_le_bytes()).collect();
            assert!(image.samples() == expected, "big_endian {big_endian}");
        }
    }

    #[test]
    fn other_images_are_named() {
        let image = |size, encoding, step, bytes: usize| {
            depth_image(&image_message((1, 0), size, encoding, false, step, &vec![0; bytes])).unwrap_err()
        };
        assert_eq!(image((640, 480), "rgb8", 1920, 921_600), MessageFault::Encoding("rgb8".to_owned()));
        assert_eq!(image((320, 240), "16UC1", 640, 153_600), MessageFault::Size { width: 320, height: 240 });
        assert_eq!(image((640, 480), "mono16", 1279, 614_400), MessageFault::Step { step: 1279 });
        assert!(matches!(image((640, 480), "mono16", 1280, 614_399), MessageFault::EndsEarly { wanted: 614_400, .. }));
        let message = image_message((1, 0), (1280, 720), "bgr8", false, 3840, &[]);
        assert_eq!(image_form(&message).as_deref(), Some("bgr8 1280x720"));
    }

    #[test]
    fn a_count_that_the_message_cannot_hold_reserves_nothing() {
        let message = Writer::new(false).u32(1).u32(2).string("v").u32(u32::MAX).raw(&[0; 64]).finish();
        let expected = PACKET_BYTES * u32::MAX as usize;
        assert!(matches!(velodyne_scan(&message), Err(MessageFault::EndsEarly { wanted, .. }) if wanted == expected));
        assert_eq!(velodyne_scan(&[0, 3, 0, 0, 1]), Err(MessageFault::Encapsulation([0, 3])));
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn any_bytes_give_packets_inside_the_message_or_a_fault(
            mut message in prop::collection::vec(any::<u8>(), 0..3000), valid_head in any::<bool>(), count in 0u32..4,
        ) {
            if valid_head && message.len() > 32 {
                let head = Writer::new(false).u32(1).u32(2).string("velodyne").u32(count).finish();
                message.splice(..head.len(), head);
            }
            if let Ok(packets) = velodyne_scan(&message) {
                for packet in packets {
                    prop_assert_eq!(packet.data.len(), PACKET_BYTES);
                    prop_assert!(packet.data.end <= message.len());
                }
            }
            prop_assert!(depth_image(&message).is_err(), "3000 bytes hold no 640x480 image");
            if let Some(form) = image_form(&message) {
                prop_assert!(form.len() < 200);
            }
        }
    }
}

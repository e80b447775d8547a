//! Sizes of a depth frame and what its numbers mean.

use tumbled_model::{DepthEncoding, PacketMask};

/// Columns of a depth image. The last eight (632..=639) never carry data: the device's correlation window does not reach them.
pub const WIDTH: usize = 640;
/// Rows of a depth image.
pub const HEIGHT: usize = 480;
/// Pixels of a depth image: 640 × 480 = 307 200.
pub const PIXELS: usize = WIDTH * HEIGHT;

/// Bits of one disparity in the packed stream.
pub const BITS_PER_PIXEL: usize = 11;
/// Bytes of a packed frame: 307 200 × 11 / 8 = 422 400.
pub const PACKED_BYTES: usize = PIXELS * BITS_PER_PIXEL / 8;
/// Bytes of a frame with 16 bits a pixel: 614 400.
pub const UNPACKED_BYTES: usize = PIXELS * 2;
/// Depth payload of one isochronous USB packet (libfreenect `cameras.c`: 1 760 less a header of 12). The last of a frame holds 1 132.
pub const PACKET_PAYLOAD: usize = 1_748;

/// Different values a raw disparity can have: 2¹¹.
pub const RAW_CODES: usize = 2_048;
/// The greatest eleven-bit code; the device's "no data".
pub const GREATEST_CODE: u16 = 2_047;
/// The first code that is not a depth. By the factory law it stands for 10.04 m; from 1 090 on the law has passed its
/// pole, and the tables other software builds there hold the remains of integer overflow.
pub const FIRST_INVALID_RAW: u16 = 1_055;
/// Depths from here on are no data, in millimetres. libfreenect clamps its millimetre mode to this number, so a frame
/// holds it wherever the disparity was past the law's range; it is also what some recorders write as "far".
pub const FIRST_INVALID_MM: u16 = 10_000;

const _: () = assert!(PACKED_BYTES.div_ceil(PACKET_PAYLOAD) == PacketMask::PACKETS);

/// A raw disparity as the device gives it, 0..=2047, in eighths of a pixel (the code grows with distance).
///
/// Kept apart from millimetres by type: both are small integers in the same files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct RawDisparity(pub u16);

impl RawDisparity {
    /// The device's own "no data", 2047.
    pub const NO_DATA: Self = Self(GREATEST_CODE);

    /// Whether the code can stand for a depth: below [`FIRST_INVALID_RAW`].
    pub const fn is_depth(self) -> bool {
        self.0 < FIRST_INVALID_RAW
    }
}

/// How many bytes a whole frame has in this encoding.
pub const fn frame_bytes(encoding: DepthEncoding) -> usize {
    match encoding {
        DepthEncoding::Packed11 => PACKED_BYTES,
        DepthEncoding::Raw11 | DepthEncoding::Mm16 => UNPACKED_BYTES,
    }
}

/// A depth in millimetres that is one: 1..=9 999. 0 is "none", 65 535 the marker of some recorders, 10 000 and more
/// [see above](FIRST_INVALID_MM).
pub const fn is_depth_mm(mm: u16) -> bool {
    mm > 0 && mm < FIRST_INVALID_MM
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_sizes_are_the_devices() {
        // Packed: 241 packets of 1748 bytes and one of 1132; unpacked: two bytes a pixel.
        assert_eq!(frame_bytes(DepthEncoding::Packed11), 241 * 1_748 + 1_132);
        assert_eq!(frame_bytes(DepthEncoding::Raw11), 614_400);
        assert_eq!(frame_bytes(DepthEncoding::Mm16), 614_400);
    }

    #[test]
    fn no_data_codes_are_not_depths() {
        assert!(RawDisparity(1_054).is_depth() && !RawDisparity(1_055).is_depth() && !RawDisparity::NO_DATA.is_depth());
        let judged = [0, 1, 9_999, 10_000, 65_535].map(is_depth_mm);
        assert_eq!(judged, [false, true, true, false, false]);
    }
}

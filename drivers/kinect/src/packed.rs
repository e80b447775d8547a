//! The 11-bit stream as it is on the wire.
//!
//! A plain big-endian bit stream, most significant bit first, rows without padding: pixel k occupies bits 11k..=11k+10.
//! Eight pixels fill eleven bytes, so the stream is read and written in such groups:
//!
//! ```text
//!  byte   0        1        2        3        4        5        6        7        8        9        10
//!         00000000 00011111 11111122 22222222 23333333 33334444 44444445 55555555 55666666 66666777 77777777
//! ```

use crate::frame::{BITS_PER_PIXEL, RawDisparity};

/// Pixels of one group.
pub const GROUP_PIXELS: usize = 8;
/// Bytes of one group.
pub const GROUP_BYTES: usize = BITS_PER_PIXEL;

const CODE: u64 = 0x7FF;

/// The eight codes of a group, each 0..=2047.
#[inline(always)]
pub fn unpack_group(group: &[u8; GROUP_BYTES]) -> [u16; GROUP_PIXELS] {
    let &[b0, b1, b2, b3, b4, b5, b6, b7, b8, b9, b10] = group;
    // Two overlapping words instead of eleven bytes: `first` holds bits 0..64 (pixels 0 to 4 whole), `last` bits 24..88
    // (pixels 3 to 7 whole). Pixel k ends at bit 11k + 11, which is the shift's distance from the word's end.
    let first = u64::from_be_bytes([b0, b1, b2, b3, b4, b5, b6, b7]);
    let last = u64::from_be_bytes([b3, b4, b5, b6, b7, b8, b9, b10]);
    [
        (first >> 53 & CODE) as u16,
        (first >> 42 & CODE) as u16,
        (first >> 31 & CODE) as u16,
        (first >> 20 & CODE) as u16,
        (last >> 33 & CODE) as u16,
        (last >> 22 & CODE) as u16,
        (last >> 11 & CODE) as u16,
        (last & CODE) as u16,
    ]
}

/// The group that holds these eight codes; bits above the eleventh are dropped.
#[inline(always)]
pub fn pack_group(codes: [u16; GROUP_PIXELS]) -> [u8; GROUP_BYTES] {
    // 88 bits, built in 128: the codes from first to last, then the lowest eleven bytes of the word.
    let bits = codes.iter().fold(0_u128, |bits, &code| bits << BITS_PER_PIXEL | u128::from(u64::from(code) & CODE));
    let [_, _, _, _, _, group @ ..] = bits.to_be_bytes();
    group
}

/// Every code of a packed stream in order; a tail that is not a whole group is left out.
pub fn codes(packed: &[u8]) -> impl Iterator<Item = RawDisparity> + '_ {
    packed.as_chunks::<GROUP_BYTES>().0.iter().flat_map(unpack_group).map(RawDisparity)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn first_and_last_pixel_of_a_group_lie_where_the_layout_says() {
        // Pixel 0: byte 0 are its 8 high bits, the top 3 bits of byte 1 its low ones. 0b101_0101_0111 = 0x557.
        assert_eq!(unpack_group(&[0b1010_1010, 0b1110_0000, 0, 0, 0, 0, 0, 0, 0, 0, 0])[0], 0b101_0101_0111);
        // Pixel 7: the low 3 bits of byte 9, then byte 10. 0b011_1100_0011.
        assert_eq!(unpack_group(&[0, 0, 0, 0, 0, 0, 0, 0, 0, 0b0000_0011, 0b1100_0011])[7], 0b011_1100_0011);
    }

    #[test]
    fn all_ones_are_no_data() {
        assert!(codes(&[0xFF; 22]).all(|code| code == RawDisparity::NO_DATA));
        assert_eq!(codes(&[0xFF; 32]).count(), 16); // ten bytes are not a group
    }

    /// Bit by bit, as the layout is written down: slow, and independent of the words above.
    fn bitwise(group: &[u8; 11]) -> [u16; 8] {
        let bit = |i: usize| u16::from(group[i / 8] >> (7 - i % 8) & 1);
        std::array::from_fn(|k| (11 * k..11 * k + 11).fold(0, |code, i| code << 1 | bit(i)))
    }

    proptest! {
        #[test]
        fn words_read_what_single_bits_say(group in any::<[u8; 11]>()) {
            prop_assert_eq!(unpack_group(&group), bitwise(&group));
        }

        #[test]
        fn packing_undoes_unpacking(group in any::<[u8; 11]>()) {
            prop_assert_eq!(pack_group(unpack_group(&group)), group);
        }

        #[test]
        fn unpacking_undoes_packing(codes in any::<[u16; 8]>()) {
            prop_assert_eq!(unpack_group(&pack_group(codes)), codes.map(|code| code & 0x7FF));
        }
    }
}

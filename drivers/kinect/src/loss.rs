//! Which pixels a lost USB packet takes with it.
//!
//! A packed frame comes in 242 packets of 1 748 bytes (the last: 1 132), and a packet boundary falls anywhere within a
//! pixel's eleven bits. libfreenect delivers a frame with up to five packets missing: in the holes stand the bytes of the
//! frame *before*, unmarked. They look like depth and lie where the target was a frame ago. So every pixel that has a
//! single bit in a lost packet becomes no data.

use crate::frame::{BITS_PER_PIXEL, PACKED_BYTES, PACKET_PAYLOAD, PIXELS};
use core::ops::Range;
use tumbled_model::PacketMask;

/// The pixels that have a bit in packet `index`, 1 272 or 1 273 of them (13 984 bits); empty for an index past the last.
///
/// The same ranges hold for unpacked frames: they were unpacked from such packets.
pub fn packet_pixels(index: usize) -> Range<usize> {
    if index >= PacketMask::PACKETS {
        return PIXELS..PIXELS;
    }
    let first_byte = index * PACKET_PAYLOAD;
    let end_byte = (first_byte + PACKET_PAYLOAD).min(PACKED_BYTES);
    first_byte * 8 / BITS_PER_PIXEL..(end_byte * 8).div_ceil(BITS_PER_PIXEL)
}

/// The runs of pixels that lost packets leave without data: ascending, none touching another.
pub fn lost_pixels(lost: &PacketMask) -> impl Iterator<Item = Range<usize>> + '_ {
    let mut packets = lost.iter().map(packet_pixels).peekable();
    core::iter::from_fn(move || {
        let mut run = packets.next()?;
        // Neighbours share the pixel on their boundary: counted once.
        while let Some(next) = packets.next_if(|next| next.start <= run.end) {
            run.end = next.end;
        }
        Some(run)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn lost(packets: &[usize]) -> PacketMask {
        let mut mask = PacketMask::NONE;
        packets.iter().for_each(|&packet| mask.mark_lost(packet));
        mask
    }

    #[test]
    fn a_packet_takes_every_pixel_it_has_a_bit_of() {
        // Packet 0: bits 0..13984; 13984 / 11 = 1271.27: pixel 1271 has its first three bits here.
        assert_eq!(packet_pixels(0), 0..1_272);
        // Packet 1: bits 13984..27968; 27968 / 11 = 2542.55: pixels 1271 to 2542.
        assert_eq!(packet_pixels(1), 1_271..2_543);
        // Packet 241: the last 1132 bytes = 9056 bits = 823.3 pixels: from 306376 (bit 3370144 / 11 = 306376.7) to the end.
        assert_eq!(packet_pixels(241), 306_376..307_200);
        assert!(packet_pixels(242).is_empty());
    }

    #[test]
    fn neighbours_make_one_run() {
        let runs: Vec<_> = lost_pixels(&lost(&[0, 1, 5])).collect();
        // Packet 5: bits 69920..83904: 69920 / 11 = 6356.4, 83904 / 11 = 7627.6.
        assert_eq!(runs, [0..2_543, 6_356..7_628]);
        assert_eq!(lost_pixels(&PacketMask::NONE).count(), 0);
    }

    proptest! {
        #[test]
        fn a_pixel_is_lost_exactly_if_one_of_its_bits_is(packets in proptest::collection::vec(0usize..242, 0..6)) {
            let mask = lost(&packets);
            let mut by_run = vec![false; PIXELS];
            for run in lost_pixels(&mask) {
                by_run[run].fill(true);
            }
            for (pixel, &lost) in by_run.iter().enumerate() {
                // Eleven bits reach into two packets at most: the first and the last bit tell.
                let by_bit = [11 * pixel, 11 * pixel + 10].iter().any(|bit| mask.is_lost(bit / 8 / 1_748));
                prop_assert_eq!(lost, by_bit, "pixel {}", pixel);
            }
        }
    }
}

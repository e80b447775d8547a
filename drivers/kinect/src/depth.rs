//! A frame's bytes to an image.

use crate::frame::{FIRST_INVALID_RAW, RAW_CODES, RawDisparity, frame_bytes};
use crate::image::{DepthImage, MmImage, RawImage};
use crate::loss::lost_pixels;
use crate::packed::{GROUP_BYTES, GROUP_PIXELS, unpack_group};
use crate::table::DepthTable;
use tumbled_model::{DepthEncoding, PacketMask};

/// Why a frame has no image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum DecodeError {
    /// Not a whole frame of its encoding.
    #[error(
        "a depth frame as {encoding:?} has {expected} bytes, this one has {found}: it is cut short or of another encoding"
    )]
    WrongLength {
        /// How the bytes were to be read.
        encoding: DepthEncoding,
        /// Bytes found.
        found: usize,
        /// Bytes a frame of this encoding has.
        expected: usize,
    },
    /// Raw disparities were asked of a frame that has none.
    #[error("the frame holds millimetres, which are no raw disparities: record the raw stream to have them")]
    NotRaw,
}

/// What a frame lost on the way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameLoss {
    /// USB packets that never arrived, 0..=242.
    pub packets: u32,
    /// Pixels that became no data for it, 0..=307 200 (whether or not they would have had any).
    pub pixels: u32,
}

/// Decodes a frame to metres.
///
/// Disparities go through `table`; [`DepthEncoding::Mm16`] needs none and is divided by 1000, with 0, 10 000 and more as
/// no data. What `lost` names becomes no data in every encoding. Whatever `bytes` holds, each pixel is 0 or a depth below
/// 10 m; on an error all of `out` is no data, so that a frame which failed is never taken for the one before it.
///
/// # Errors
/// [`DecodeError::WrongLength`].
pub fn decode_metres(
    encoding: DepthEncoding,
    bytes: &[u8],
    lost: &PacketMask,
    table: &DepthTable,
    out: &mut DepthImage,
) -> Result<FrameLoss, DecodeError> {
    let metres = table.metres();
    let pixels = out.pixels_mut();
    check_length(encoding, bytes).inspect_err(|_| pixels.fill(0.0))?;
    match encoding {
        DepthEncoding::Packed11 => unpack(bytes, pixels, |code| look_up(metres, code)),
        DepthEncoding::Raw11 => read_u16(bytes, pixels, |code| look_up(metres, code)),
        DepthEncoding::Mm16 => read_u16(bytes, pixels, |mm| table.of_mm(mm)),
    }
    Ok(mask(lost, pixels, 0.0))
}

/// Decodes a frame to millimetres: for the factory law exactly libfreenect's numbers below 10 m, and 0 where it has
/// 10 000 or the remains of an overflow. Otherwise as [`decode_metres`].
///
/// # Errors
/// [`DecodeError::WrongLength`].
pub fn decode_mm(
    encoding: DepthEncoding,
    bytes: &[u8],
    lost: &PacketMask,
    table: &DepthTable,
    out: &mut MmImage,
) -> Result<FrameLoss, DecodeError> {
    let depths = table.mm();
    let pixels = out.pixels_mut();
    check_length(encoding, bytes).inspect_err(|_| pixels.fill(0))?;
    match encoding {
        DepthEncoding::Packed11 => unpack(bytes, pixels, |code| look_up(depths, code)),
        DepthEncoding::Raw11 => read_u16(bytes, pixels, |code| look_up(depths, code)),
        DepthEncoding::Mm16 => read_u16(bytes, pixels, |mm| table.mm_of_mm(mm)),
    }
    Ok(mask(lost, pixels, 0))
}

/// Decodes a frame to raw disparities, for calibration: codes of 1055 and more become [`RawDisparity::NO_DATA`].
///
/// # Errors
/// [`DecodeError::WrongLength`]; [`DecodeError::NotRaw`] for a frame in millimetres. Then all of `out` is no data.
pub fn decode_raw(
    encoding: DepthEncoding,
    bytes: &[u8],
    lost: &PacketMask,
    out: &mut RawImage,
) -> Result<FrameLoss, DecodeError> {
    let depth_or_none = |code| if code < FIRST_INVALID_RAW { RawDisparity(code) } else { RawDisparity::NO_DATA };
    let pixels = out.pixels_mut();
    check_length(encoding, bytes).inspect_err(|_| pixels.fill(RawDisparity::NO_DATA))?;
    match encoding {
        DepthEncoding::Packed11 => unpack(bytes, pixels, depth_or_none),
        DepthEncoding::Raw11 => read_u16(bytes, pixels, depth_or_none),
        DepthEncoding::Mm16 => {
            pixels.fill(RawDisparity::NO_DATA);
            return Err(DecodeError::NotRaw);
        }
    }
    Ok(mask(lost, pixels, RawDisparity::NO_DATA))
}

fn check_length(encoding: DepthEncoding, bytes: &[u8]) -> Result<(), DecodeError> {
    let (found, expected) = (bytes.len(), frame_bytes(encoding));
    if found == expected { Ok(()) } else { Err(DecodeError::WrongLength { encoding, found, expected }) }
}

/// The depth of a code that may have more than eleven bits: such a one is no data.
#[inline(always)]
fn look_up<T: Copy + Default>(depths: &[T; RAW_CODES], code: u16) -> T {
    // 2047 stands for no data in every table. With the index bounded in sight, the check in `get` is compiled away.
    depths.get(usize::from(code).min(RAW_CODES - 1)).copied().unwrap_or_default()
}

#[inline(always)]
fn unpack<T: Copy>(packed: &[u8], pixels: &mut [T], depth: impl Fn(u16) -> T) {
    let (groups, _) = packed.as_chunks::<GROUP_BYTES>();
    let (pixels, _) = pixels.as_chunks_mut::<GROUP_PIXELS>();
    for (group, pixels) in groups.iter().zip(pixels) {
        *pixels = unpack_group(group).map(&depth);
    }
}

#[inline(always)]
fn read_u16<T: Copy>(bytes: &[u8], pixels: &mut [T], depth: impl Fn(u16) -> T) {
    let (words, _) = bytes.as_chunks::<2>();
    for (word, pixel) in words.iter().zip(pixels) {
        *pixel = depth(u16::from_le_bytes(*word));
    }
}

fn mask<T: Copy>(lost: &PacketMask, pixels: &mut [T], no_data: T) -> FrameLoss {
    let mut loss = FrameLoss { packets: lost.count(), pixels: 0 };
    for run in lost_pixels(lost) {
        loss.pixels += run.len() as u32;
        if let Some(run) = pixels.get_mut(run) {
            run.fill(no_data);
        }
    }
    loss
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::encode::{encode_mm, encode_raw};
    use crate::frame::PIXELS;
    use crate::image::Image;
    use crate::law::ZeroPlane;
    use proptest::prelude::*;
    use std::cell::RefCell;
    use std::sync::LazyLock;

    const ENCODINGS: [DepthEncoding; 3] = [DepthEncoding::Packed11, DepthEncoding::Raw11, DepthEncoding::Mm16];

    fn factory() -> DepthTable {
        DepthTable::from_law(&ZeroPlane::default())
    }

    /// One scene in every encoding, every depth of the factory law in it.
    fn scene() -> [(DepthEncoding, Vec<u8>); 3] {
        let codes = Image::from_fn(|u, v| RawDisparity(((u + 7 * v) % 1_055) as u16));
        let mm = Image::from_fn(|u, v| ZeroPlane::default().mm(codes.at(u, v).unwrap()).unwrap());
        [
            (DepthEncoding::Packed11, encode_raw(&codes, DepthEncoding::Packed11).unwrap()),
            (DepthEncoding::Raw11, encode_raw(&codes, DepthEncoding::Raw11).unwrap()),
            (DepthEncoding::Mm16, encode_mm(&mm)),
        ]
    }

    #[test]
    fn every_encoding_gives_the_same_millimetres() {
        for (encoding, bytes) in scene() {
            let mut mm = MmImage::new();
            let loss = decode_mm(encoding, &bytes, &PacketMask::NONE, &factory(), &mut mm).expect("a whole frame");
            assert_eq!(loss, FrameLoss::default());
            for v in 0..480 {
                for u in 0..640 {
                    let code = RawDisparity(((u + 7 * v) % 1_055) as u16);
                    assert_eq!(mm.at(u, v), ZeroPlane::default().mm(code), "{encoding:?} at {u}, {v}");
                }
            }
        }
    }

    #[test]
    fn metres_are_the_laws_not_the_millimetres() {
        for (encoding, bytes) in &scene()[..2] {
            let mut depth = DepthImage::new();
            decode_metres(*encoding, bytes, &PacketMask::NONE, &factory(), &mut depth).expect("a whole frame");
            // Row 0 holds codes 0 to 639.
            assert_eq!(depth.at(500, 0), ZeroPlane::default().metres(500.0).map(|z| z as f32), "{encoding:?}");
        }
    }

    #[test]
    fn codes_that_are_no_depth_are_no_data() {
        let mut codes = RawImage::filled(RawDisparity(800));
        let special = [1_054, 1_055, 1_089, 1_090, 2_046, 2_047];
        for (pixel, code) in codes.pixels_mut().iter_mut().zip(special) {
            *pixel = RawDisparity(code);
        }
        for encoding in [DepthEncoding::Packed11, DepthEncoding::Raw11] {
            let (mut mm, mut depth) = (MmImage::new(), DepthImage::new());
            let bytes = encode_raw(&codes, encoding).expect("eleven bits");
            decode_mm(encoding, &bytes, &PacketMask::NONE, &factory(), &mut mm).expect("a whole frame");
            decode_metres(encoding, &bytes, &PacketMask::NONE, &factory(), &mut depth).expect("a whole frame");
            assert_eq!(mm.pixels()[..7], [9_757, 0, 0, 0, 0, 0, 1_193], "{encoding:?}");
            assert!(depth.pixels()[1..6].iter().all(|&z| z == 0.0), "{encoding:?}");
        }
    }

    #[test]
    fn unpacked_codes_of_more_than_eleven_bits_are_no_data() {
        // 0x0B20 is 800 with bit 11 set: reading eleven bits of it would give a depth nobody measured.
        let bytes: Vec<u8> = [0x20, 0x0B].repeat(PIXELS);
        let mut mm = MmImage::new();
        decode_mm(DepthEncoding::Raw11, &bytes, &PacketMask::NONE, &factory(), &mut mm).expect("a whole frame");
        assert!(mm.pixels().iter().all(|&mm| mm == 0));
    }

    #[test]
    fn millimetres_that_are_no_depth_are_no_data() {
        let mut mm = MmImage::filled(2_000);
        mm.pixels_mut()[..5].copy_from_slice(&[1, 9_999, 10_000, 12_844, 65_535]);
        let (mut again, mut depth) = (MmImage::new(), DepthImage::new());
        decode_mm(DepthEncoding::Mm16, &encode_mm(&mm), &PacketMask::NONE, &factory(), &mut again)
            .expect("a whole frame");
        decode_metres(DepthEncoding::Mm16, &encode_mm(&mm), &PacketMask::NONE, &factory(), &mut depth)
            .expect("a whole frame");
        assert_eq!(again.pixels()[..6], [1, 9_999, 0, 0, 0, 2_000]);
        assert_eq!(depth.pixels()[..6], [0.001, 9.999, 0.0, 0.0, 0.0, 2.0]);
    }

    #[test]
    fn what_lost_packets_held_is_no_data_and_the_rest_is_untouched() {
        let mut lost = PacketMask::NONE;
        [0, 1, 120, 241].iter().for_each(|&packet| lost.mark_lost(packet));
        for (encoding, bytes) in scene() {
            let (mut whole, mut masked) = (DepthImage::new(), DepthImage::new());
            decode_metres(encoding, &bytes, &PacketMask::NONE, &factory(), &mut whole).expect("a whole frame");
            let loss = decode_metres(encoding, &bytes, &lost, &factory(), &mut masked).expect("a whole frame");
            for (pixel, (&masked, &whole)) in masked.pixels().iter().zip(whole.pixels()).enumerate() {
                // A pixel's first and last bit tell the packets it lies in.
                let gone = [11 * pixel, 11 * pixel + 10].iter().any(|bit| lost.is_lost(bit / 8 / 1_748));
                assert_eq!(masked, if gone { 0.0 } else { whole }, "{encoding:?}, pixel {pixel}");
            }
            // Packets 0 and 1: 2543 pixels. Packet 120: bits 1678080..1692064, pixels 152552 to 153823: 1272.
            // Packet 241: 824.
            assert_eq!(loss, FrameLoss { packets: 4, pixels: 2_543 + 1_272 + 824 }, "{encoding:?}");
        }
    }

    #[test]
    fn a_frame_of_the_wrong_length_leaves_no_data_behind() {
        for encoding in ENCODINGS {
            let expected = frame_bytes(encoding);
            for found in [0, 1, expected - 1, expected + 1, 640 * 488 * 2] {
                let error = Err(DecodeError::WrongLength { encoding, found, expected });
                let bytes = vec![1; found];
                let (mut depth, mut mm) = (DepthImage::filled(1.0), MmImage::filled(1));
                let mut raw = RawImage::filled(RawDisparity(1));
                assert_eq!(decode_metres(encoding, &bytes, &PacketMask::NONE, &factory(), &mut depth), error);
                assert_eq!(decode_mm(encoding, &bytes, &PacketMask::NONE, &factory(), &mut mm), error);
                assert_eq!(decode_raw(encoding, &bytes, &PacketMask::NONE, &mut raw), error);
                assert!(depth == DepthImage::new() && mm == MmImage::new() && raw == RawImage::new());
            }
        }
    }

    #[test]
    fn millimetres_have_no_raw_disparities() {
        let mut raw = RawImage::filled(RawDisparity(1));
        let bytes = encode_mm(&MmImage::filled(1_000));
        assert_eq!(decode_raw(DepthEncoding::Mm16, &bytes, &PacketMask::NONE, &mut raw), Err(DecodeError::NotRaw));
        assert_eq!(raw, RawImage::new());
    }

    /// Frames of the right length: a short random pattern, repeated. The group of 11 bytes and a pattern of another
    /// length run through every alignment of each other.
    fn whole_frame() -> impl Strategy<Value = (DepthEncoding, Vec<u8>)> {
        let pattern = proptest::collection::vec(any::<u8>(), 1..64);
        (proptest::sample::select(ENCODINGS.as_slice()), pattern).prop_map(|(encoding, pattern)| {
            let length = frame_bytes(encoding);
            let mut bytes = pattern.repeat(length.div_ceil(pattern.len()));
            bytes.truncate(length);
            (encoding, bytes)
        })
    }

    static FACTORY: LazyLock<DepthTable> = LazyLock::new(factory);
    thread_local! {
        /// Kept from case to case, as a caller keeps them from frame to frame.
        static IMAGES: RefCell<(DepthImage, MmImage)> = RefCell::default();
    }

    proptest! {
        #[test]
        fn arbitrary_whole_frames_give_depths_below_ten_metres_or_none(
            (encoding, bytes) in whole_frame(), packets in proptest::collection::vec(any::<usize>(), 0..4)
        ) {
            let mut lost = PacketMask::NONE;
            packets.iter().for_each(|&packet| lost.mark_lost(packet % 300));
            IMAGES.with_borrow_mut(|(depth, mm)| {
                let by_metres = decode_metres(encoding, &bytes, &lost, &FACTORY, depth);
                let by_mm = decode_mm(encoding, &bytes, &lost, &FACTORY, mm);
                prop_assert!(by_metres.is_ok() && by_metres == by_mm);
                let agree = |(&z, &mm): (&f32, &u16)| (0.0..10.0).contains(&z) && mm < 10_000 && (z > 0.0) == (mm > 0);
                prop_assert!(depth.pixels().iter().zip(mm.pixels()).all(agree));
                Ok(())
            })?;
        }

        #[test]
        fn arbitrary_bytes_are_refused_with_their_length(
            encoding in proptest::sample::select(ENCODINGS.as_slice()),
            bytes in proptest::collection::vec(any::<u8>(), 0..3_000),
        ) {
            let refused = DecodeError::WrongLength { encoding, found: bytes.len(), expected: frame_bytes(encoding) };
            prop_assert_eq!(check_length(encoding, &bytes), Err(refused));
        }
    }
}

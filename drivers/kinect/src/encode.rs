//! Frames as a device would send them, for tests and the simulator.

use crate::frame::{GREATEST_CODE, PACKED_BYTES, RawDisparity, UNPACKED_BYTES};
use crate::image::{MmImage, RawImage};
use crate::packed::{GROUP_BYTES, GROUP_PIXELS, pack_group};
use tumbled_model::DepthEncoding;

/// Why an image cannot be a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum EncodeError {
    /// A code of more than eleven bits.
    #[error("pixel {pixel} has the raw disparity {found}, expected 0 to 2047: use 2047 for no data")]
    Code {
        /// Which pixel, row by row.
        pixel: usize,
        /// Its code.
        found: u16,
    },
    /// Millimetres were asked for where disparities are given.
    #[error(
        "raw disparities cannot be encoded as millimetres without a depth table: decode them to millimetres, then use encode_mm"
    )]
    NotMm,
}

/// A frame of raw disparities, as [`DepthEncoding::Packed11`] or [`DepthEncoding::Raw11`].
///
/// # Errors
/// [`EncodeError::Code`] for the first code of more than eleven bits; [`EncodeError::NotMm`] for [`DepthEncoding::Mm16`].
pub fn encode_raw(image: &RawImage, encoding: DepthEncoding) -> Result<Vec<u8>, EncodeError> {
    let too_large = image.pixels().iter().enumerate().find(|(_, code)| code.0 > GREATEST_CODE);
    if let Some((pixel, &RawDisparity(found))) = too_large {
        return Err(EncodeError::Code { pixel, found });
    }
    match encoding {
        DepthEncoding::Packed11 => {
            let (groups, _) = image.pixels().as_chunks::<GROUP_PIXELS>();
            let mut bytes = Vec::with_capacity(PACKED_BYTES);
            for group in groups {
                let group: [u8; GROUP_BYTES] = pack_group(group.map(|code| code.0));
                bytes.extend_from_slice(&group);
            }
            Ok(bytes)
        }
        DepthEncoding::Raw11 => Ok(little_endian(image.pixels().iter().map(|code| code.0))),
        DepthEncoding::Mm16 => Err(EncodeError::NotMm),
    }
}

/// A frame in millimetres, as [`DepthEncoding::Mm16`]. Every value is written as it is.
pub fn encode_mm(image: &MmImage) -> Vec<u8> {
    little_endian(image.pixels().iter().copied())
}

fn little_endian(words: impl Iterator<Item = u16>) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(UNPACKED_BYTES);
    for word in words {
        bytes.extend_from_slice(&word.to_le_bytes());
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::depth::{decode_metres, decode_mm, decode_raw};
    use crate::frame::FIRST_INVALID_RAW;
    use crate::image::{DepthImage, Image};
    use crate::law::ZeroPlane;
    use crate::table::DepthTable;
    use tumbled_model::PacketMask;

    /// Every code there is, in an order that puts each at each place of a group of eight.
    fn all_codes() -> RawImage {
        Image::from_fn(|u, v| RawDisparity(((u * 3 + v * 641) % 2_048) as u16))
    }

    #[test]
    fn raw_frames_come_back_from_both_encodings() {
        let image = all_codes();
        let expected = Image::from_fn(|u, v| {
            image.at(u, v).filter(|code| code.0 < FIRST_INVALID_RAW).unwrap_or(RawDisparity::NO_DATA)
        });
        for encoding in [DepthEncoding::Packed11, DepthEncoding::Raw11] {
            let bytes = encode_raw(&image, encoding).expect("eleven bits");
            let mut decoded = RawImage::new();
            decode_raw(encoding, &bytes, &PacketMask::NONE, &mut decoded).expect("a whole frame");
            assert_eq!(decoded, expected, "{encoding:?}");
        }
    }

    #[test]
    fn millimetres_of_a_raw_frame_encoded_again_decode_to_the_same() {
        let table = DepthTable::from_law(&ZeroPlane::default());
        let bytes = encode_raw(&all_codes(), DepthEncoding::Packed11).expect("eleven bits");
        let (mut mm, mut again) = (MmImage::new(), MmImage::new());
        decode_mm(DepthEncoding::Packed11, &bytes, &PacketMask::NONE, &table, &mut mm).expect("a whole frame");
        decode_mm(DepthEncoding::Mm16, &encode_mm(&mm), &PacketMask::NONE, &table, &mut again).expect("a whole frame");
        assert_eq!(mm, again);
    }

    #[test]
    fn a_simulated_depth_is_decoded_to_within_half_a_step() {
        let law = ZeroPlane::default();
        let truth = DepthImage::from_fn(|u, v| 0.6 + 0.005 * u as f32 + 0.002 * v as f32); // 0.6 to 4.8 m
        let codes =
            Image::from_fn(|u, v| law.code_at(f64::from(truth.at(u, v).unwrap())).unwrap_or(RawDisparity::NO_DATA));
        let bytes = encode_raw(&codes, DepthEncoding::Packed11).expect("eleven bits");
        let mut depth = DepthImage::new();
        let table = DepthTable::from_law(&law);
        decode_metres(DepthEncoding::Packed11, &bytes, &PacketMask::NONE, &table, &mut depth).expect("a whole frame");
        for (&is, &was) in depth.pixels().iter().zip(truth.pixels()) {
            // Half a step of 2.894e-3 z², 1 % for the law's curvature over it.
            assert!((is - was).abs() <= 0.5 * 2.894e-3 * was * was * 1.01, "{is} m for {was} m");
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let mut image = RawImage::new();
        image.pixels_mut()[1_234] = RawDisparity(2_048);
        assert_eq!(encode_raw(&image, DepthEncoding::Packed11), Err(EncodeError::Code { pixel: 1_234, found: 2_048 }));
        assert_eq!(encode_raw(&RawImage::new(), DepthEncoding::Mm16), Err(EncodeError::NotMm));
    }
}

//! The depth law's constants as the device itself reports them.
//!
//! A host asks the camera twice before it starts the depth stream; these are the payloads of the answers, without the
//! eight bytes of header (`RB`, length, command, tag):
//!
//! | question | reply, bytes | offset | field |
//! |---|---|---|---|
//! | 0x04 fixed parameters | 322 (model 1414) or 334 (1473, Kinect for Windows) | 94 | f32 LE projector to infrared camera, cm |
//! | | | 98 | f32 LE infrared to colour camera, cm |
//! | | | 102 | f32 LE distance of the reference plane, cm |
//! | | | 106 | f32 LE pixel size at the reference plane, cm |
//! | 0x16, parameter 0: constant shift | 4 | 2 | u16 LE constant shift, pixels |
//!
//! Source: libfreenect 0.5.3, `cameras.c` (`freenect_fetch_zero_plane_info`, `freenect_fetch_zero_plane_const_shift`).

use crate::law::ZeroPlane;

/// Length of the fixed parameters' reply of a model 1414, bytes.
pub const ZERO_PLANE_REPLY_1414: usize = 322;
/// Length of the same reply of a model 1473 or a Kinect for Windows, bytes.
pub const ZERO_PLANE_REPLY_1473: usize = 334;
/// Length of the constant shift's reply, bytes.
pub const CONST_SHIFT_REPLY: usize = 4;

const ZERO_PLANE_OFFSET: usize = 94;
const CONST_SHIFT_OFFSET: usize = 2;

/// Why a device's reply is not used.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ReplyError {
    /// Neither model's length.
    #[error(
        "the fixed parameters' reply has {found} bytes, expected 322 (model 1414) or 334 (1473, Kinect for Windows): pass the payload without its header of 8 bytes"
    )]
    ZeroPlaneLength {
        /// Bytes found.
        found: usize,
    },
    /// Not four bytes.
    #[error("the constant shift's reply has {found} bytes, expected 4: pass the payload without its header of 8 bytes")]
    ConstShiftLength {
        /// Bytes found.
        found: usize,
    },
    /// A constant no Kinect can have.
    #[error(
        "the device reports a {constant} of {found}, expected {least} to {most}: read it again, or use the factory's constants"
    )]
    Implausible {
        /// Which constant, with its unit.
        constant: &'static str,
        /// What the device says.
        found: f64,
        /// The least that is believed.
        least: f64,
        /// The most that is believed.
        most: f64,
    },
}

/// The depth law from both replies' payloads.
///
/// A constant is believed within a factor of two of the factory's: far more than devices differ, and enough to refuse a
/// reply of zeros, of noise or of another firmware's layout, which would give depths that look real and are not.
///
/// # Errors
/// [`ReplyError`]: a wrong length, or a constant outside these bounds.
pub fn parse_zero_plane(fixed_parameters: &[u8], const_shift: &[u8]) -> Result<ZeroPlane, ReplyError> {
    let found = fixed_parameters.len();
    let wrong_length = ReplyError::ZeroPlaneLength { found };
    if found != ZERO_PLANE_REPLY_1414 && found != ZERO_PLANE_REPLY_1473 {
        return Err(wrong_length);
    }
    let constants =
        fixed_parameters.get(ZERO_PLANE_OFFSET..).and_then(|rest| rest.first_chunk::<16>()).ok_or(wrong_length)?;
    let (floats, _) = constants.as_chunks::<4>();
    let &[baseline, _infrared_to_colour, reference, pixel] = floats else { return Err(wrong_length) };
    let factory = ZeroPlane::default();
    Ok(ZeroPlane {
        baseline_cm: plausible(
            "projector distance in cm",
            f64::from(f32::from_le_bytes(baseline)),
            factory.baseline_cm,
        )?,
        reference_cm: plausible(
            "reference distance in cm",
            f64::from(f32::from_le_bytes(reference)),
            factory.reference_cm,
        )?,
        pixel_cm: plausible("reference pixel size in cm", f64::from(f32::from_le_bytes(pixel)), factory.pixel_cm)?,
        const_shift: parse_const_shift(const_shift)?,
    })
}

/// The constant shift from its reply's payload, pixels.
///
/// # Errors
/// [`ReplyError`]: a length other than 4, or a shift outside 100..=400.
pub fn parse_const_shift(reply: &[u8]) -> Result<u16, ReplyError> {
    let wrong_length = ReplyError::ConstShiftLength { found: reply.len() };
    if reply.len() != CONST_SHIFT_REPLY {
        return Err(wrong_length);
    }
    let shift = reply.get(CONST_SHIFT_OFFSET..).and_then(|rest| rest.first_chunk::<2>()).ok_or(wrong_length)?;
    let shift = u16::from_le_bytes(*shift);
    plausible("constant shift in pixels", f64::from(shift), f64::from(ZeroPlane::default().const_shift))?;
    Ok(shift)
}

fn plausible(constant: &'static str, found: f64, factory: f64) -> Result<f64, ReplyError> {
    let (least, most) = (factory / 2.0, factory * 2.0);
    if (least..=most).contains(&found) {
        Ok(found)
    } else {
        Err(ReplyError::Implausible { constant, found, least, most })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A reply of `length` bytes that holds the given constants where a device has them, and 0xEE elsewhere.
    fn fixed_parameters(length: usize, constants: [f32; 4]) -> Vec<u8> {
        let mut reply = vec![0xEE; length];
        for (i, constant) in constants.iter().enumerate() {
            reply[94 + 4 * i..98 + 4 * i].copy_from_slice(&constant.to_le_bytes());
        }
        reply
    }

    const FACTORY: [f32; 4] = [7.5, 2.3, 120.0, 0.1042];

    #[test]
    fn both_models_factory_replies_give_the_factory_law() {
        for length in [322, 334] {
            let law = parse_zero_plane(&fixed_parameters(length, FACTORY), &[0, 0, 200, 0]).expect("a device's reply");
            assert_eq!(law, ZeroPlane::default());
        }
    }

    #[test]
    fn each_constant_is_read_from_its_own_place() {
        let law = parse_zero_plane(&fixed_parameters(322, [7.25, 2.5, 121.5, 0.125]), &[0, 0, 0x2C, 0x01])
            .expect("plausible");
        assert_eq!(law, ZeroPlane { baseline_cm: 7.25, reference_cm: 121.5, pixel_cm: 0.125, const_shift: 300 });
    }

    #[test]
    fn other_lengths_are_refused_by_name() {
        let reply = fixed_parameters(330, FACTORY); // 322 with its header still on
        assert_eq!(parse_zero_plane(&reply, &[0, 0, 200, 0]), Err(ReplyError::ZeroPlaneLength { found: 330 }));
        let reply = fixed_parameters(322, FACTORY);
        assert_eq!(parse_zero_plane(&reply, &[200, 0]), Err(ReplyError::ConstShiftLength { found: 2 }));
    }

    #[test]
    fn constants_no_kinect_has_are_refused() {
        for (i, wrong) in [(0, 0.0), (0, f32::NAN), (2, f32::INFINITY), (2, 1.2), (3, -0.1042), (3, 0.3)] {
            let mut constants = FACTORY;
            constants[i] = wrong;
            let refused = parse_zero_plane(&fixed_parameters(334, constants), &[0, 0, 200, 0]);
            assert!(matches!(refused, Err(ReplyError::Implausible { .. })), "{wrong} as constant {i}: {refused:?}");
        }
        // A shift of zero is what a mute device's cleared buffer holds.
        assert!(matches!(parse_const_shift(&[0; 4]), Err(ReplyError::Implausible { found: 0.0, .. })));
    }

    proptest! {
        #[test]
        fn arbitrary_replies_give_a_usable_law_or_an_error(
            reply in prop_oneof![
                proptest::collection::vec(any::<u8>(), 0..400),
                proptest::collection::vec(any::<u8>(), 322),
                any::<[f32; 4]>().prop_map(|constants| fixed_parameters(334, constants)),
                (3.0f32..16.0, 50.0f32..250.0, 0.04f32..0.22)
                    .prop_map(|(b, z, p)| fixed_parameters(322, [b, 2.3, z, p])),
            ],
            shift in prop_oneof![proptest::collection::vec(any::<u8>(), 0..8), Just(vec![0, 0, 200, 0])],
        ) {
            if let Ok(law) = parse_zero_plane(&reply, &shift) {
                prop_assert!(law.step_per_metre() > 0.0 && law.pole().is_finite());
            }
        }
    }
}

//! The factory depth law: raw disparity ⇄ depth.
//!
//! The device compares the infrared dots with a stored image of them on a plane at a known distance, the *zero plane*.
//! The disparity it sends is the shift against that image in eighths of a pixel of the 640-wide image, plus a constant:
//!
//! ```text
//!  x = d/4 − S − 0.375          shift in pixels of the 1280-wide sensor; S: constant shift, 0.375: half the window's step
//!  m = x · p                    the same at the zero plane, cm
//!  z = Z₀ · m / (b − m) + Z₀    depth, cm        (libfreenect registration.c and OpenNI compute it in this form)
//! ```
//!
//! which is z = 1 / (s · (B − d)) with s = p / (4 · Z₀ · b) and B = 4 · (b/p + S + 0.375): depth is the reciprocal of an
//! affine disparity, one step of d is s·z² of depth, and at d = B the law has its pole.

use crate::frame::{FIRST_INVALID_MM, RawDisparity};

/// The fraction of a sensor pixel by which the device's disparities are offset, pixels (libfreenect `registration.c`).
const WINDOW_OFFSET_PX: f64 = 0.375;

/// The constants of the depth law. Every device reports its own; all seen so far report the factory's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ZeroPlane {
    /// Distance between infrared projector and infrared camera, cm. Factory: 7.5.
    pub baseline_cm: f64,
    /// Distance of the stored reference plane, cm. Factory: 120.
    pub reference_cm: f64,
    /// Size of one pixel of the 1280-wide sensor projected to the reference plane, cm. Factory: 0.1042.
    pub pixel_cm: f64,
    /// The constant added to every shift, pixels of the 1280-wide sensor. Factory: 200.
    pub const_shift: u16,
}

impl Default for ZeroPlane {
    /// The factory's constants: what devices report and libfreenect builds its nominal table from.
    ///
    /// The device reports 32-bit floats, and so does this: 0.1042 is 0.104 199 998 as one.
    fn default() -> Self {
        Self { baseline_cm: 7.5, reference_cm: 120.0, pixel_cm: f64::from(0.1042_f32), const_shift: 200 }
    }
}

impl ZeroPlane {
    /// Depth in metres of a raw disparity, or of a fraction between two. `None` at and past the law's pole.
    ///
    /// The range is not cut here: [`DepthTable`](crate::DepthTable) leaves out what is too far to be true.
    pub fn metres(&self, disparity: f64) -> Option<f64> {
        let shift_cm = self.shift_cm(disparity);
        if shift_cm < self.baseline_cm { Some(self.depth_cm(shift_cm) / 100.0) } else { None }
    }

    /// Depth in whole millimetres, cut off (not rounded) as libfreenect's table does; `None` for codes that are not
    /// depths and for depths of 10 m and more.
    pub fn mm(&self, code: RawDisparity) -> Option<u16> {
        if !code.is_depth() {
            return None;
        }
        let shift_cm = self.shift_cm(f64::from(code.0));
        let mm = 10.0 * self.depth_cm(shift_cm);
        let in_range = shift_cm < self.baseline_cm && mm >= 1.0 && mm < f64::from(FIRST_INVALID_MM); // false for NaN
        in_range.then_some(mm as u16)
    }

    /// The disparity, not rounded, at which a depth in metres would be measured. The simulator adds its noise to this
    /// number: the device rounds in disparity, not in depth.
    ///
    /// `None` for depths that are not positive and finite.
    pub fn disparity(&self, metres: f64) -> Option<f64> {
        let valid = metres.is_finite() && metres > 0.0;
        valid.then(|| self.pole() - 1.0 / (self.step_per_metre() * metres))
    }

    /// The code the device would send for a depth in metres: the nearest one that is a depth. `None` where there is
    /// none: nearer than code 0 (0.317 m by the factory law) or farther than code 1054 (9.757 m) by more than half a step.
    pub fn code_at(&self, metres: f64) -> Option<RawDisparity> {
        let code = self.disparity(metres)?.round();
        let code = (0.0..=f64::from(u16::MAX)).contains(&code).then_some(RawDisparity(code as u16))?;
        code.is_depth().then_some(code)
    }

    /// s in Δz = s · z² (z in m): the depth of one disparity step at 1 m, in 1/m. Factory: 2.8944e-3.
    pub fn step_per_metre(&self) -> f64 {
        100.0 * self.pixel_cm / (4.0 * self.reference_cm * self.baseline_cm)
    }

    /// B, the disparity of infinity. Factory: 1089.41.
    pub fn pole(&self) -> f64 {
        4.0 * (self.baseline_cm / self.pixel_cm + f64::from(self.const_shift) + WINDOW_OFFSET_PX)
    }

    /// The focal length the law implies, pixels of the 640-wide image: Z₀ / p / 2. Factory: 575.8.
    pub fn focal_px(&self) -> f64 {
        self.reference_cm / self.pixel_cm / 2.0
    }

    fn shift_cm(&self, disparity: f64) -> f64 {
        (disparity / 4.0 - f64::from(self.const_shift) - WINDOW_OFFSET_PX) * self.pixel_cm
    }

    fn depth_cm(&self, shift_cm: f64) -> f64 {
        shift_cm * self.reference_cm / (self.baseline_cm - shift_cm) + self.reference_cm
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_reference_plane_is_where_the_shift_is_zero() {
        // d/4 = 200 + 0.375 → d = 801.5: the depth is Z0 = 1.2 m whatever the other constants are.
        assert_eq!(ZeroPlane::default().metres(801.5), Some(1.2));
    }

    #[test]
    fn factory_millimetres_of_the_published_rows() {
        let expected = [(300, 437), (400, 501), (500, 586), (700, 887), (900, 1_824), (1_000, 3_864), (1_054, 9_757)];
        for (code, mm) in expected {
            assert_eq!(ZeroPlane::default().mm(RawDisparity(code)), Some(mm), "raw {code}");
        }
        for code in [1_055, 1_089, 1_090, 2_046, 2_047, 65_535] {
            assert_eq!(ZeroPlane::default().mm(RawDisparity(code)), None, "raw {code}");
        }
    }

    #[test]
    fn constants_follow_from_the_factory_numbers() {
        let law = ZeroPlane::default();
        // 0.1042 / (4 · 120 · 7.5) per cm = 2.894444e-5 per cm; ×100 per metre. f32 makes 0.1042 short by 2e-9.
        assert!((law.step_per_metre() - 2.894_444e-3).abs() < 1e-9, "{}", law.step_per_metre());
        // 4 · (7.5/0.1042 + 200.375) = 4 · (71.97697 + 200.375) = 1089.40787.
        assert!((law.pole() - 1_089.407_87).abs() < 1e-4, "{}", law.pole());
        // 120 / 0.1042 / 2 = 575.816.
        assert!((law.focal_px() - 575.816).abs() < 1e-3, "{}", law.focal_px());
    }

    #[test]
    fn there_is_no_depth_past_the_pole() {
        let law = ZeroPlane::default();
        assert!(law.metres(1_089.4).is_some_and(|z| z > 1_000.0));
        assert_eq!(law.metres(1_089.5), None);
        assert_eq!(law.metres(f64::NAN), None);
    }

    #[test]
    fn depths_no_code_stands_for_have_none() {
        let law = ZeroPlane::default();
        for metres in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, -1.0, 0.0, 1e-300, 0.3, 9.95, 50.0] {
            assert_eq!(law.code_at(metres), None, "{metres} m");
        }
    }

    #[test]
    fn a_plane_whose_pole_comes_early_has_no_depth_behind_it() {
        // const_shift 190 puts the pole at 1089.4 − 40 = 1049.4: codes below 1055 are behind it and must not wrap round.
        let law = ZeroPlane { const_shift: 190, ..ZeroPlane::default() };
        assert_eq!(law.mm(RawDisparity(1_050)), None);
        assert_eq!(law.mm(RawDisparity(1_014)), ZeroPlane::default().mm(RawDisparity(1_054)));
    }

    proptest! {
        #[test]
        fn every_code_comes_back_from_its_depth(code in 0u16..1_055) {
            let law = ZeroPlane::default();
            let metres = law.metres(f64::from(code)).expect("before the pole");
            prop_assert_eq!(law.code_at(metres), Some(RawDisparity(code)));
        }

        #[test]
        fn a_depth_is_measured_within_half_a_step(metres in 0.33f64..9.0) {
            let law = ZeroPlane::default();
            let code = law.code_at(metres).expect("in range");
            let measured = law.metres(f64::from(code.0)).expect("before the pole");
            // Half a step of s·z², and the law's curvature over it (s²z³/4 < 0.2 % of a step below 9 m).
            let half_step = 0.5 * law.step_per_metre() * metres * metres;
            prop_assert!((measured - metres).abs() <= half_step * 1.05, "{} for {}", measured, metres);
        }
    }
}

//! The depth of every code, looked up instead of computed.

use crate::frame::{RAW_CODES, RawDisparity, is_depth_mm};
use crate::law::ZeroPlane;

/// 2 048 raw disparities to depth, in metres and in millimetres; 0 = no data.
///
/// Whatever it was made from, codes of 1055 and more and depths of 10 m and more are no data in it, and metres are zero
/// exactly where millimetres are.
#[derive(Clone, Debug, PartialEq)]
pub struct DepthTable {
    metres: Box<[f32; RAW_CODES]>,
    mm: Box<[u16; RAW_CODES]>,
    /// What depths that came in millimetres are multiplied by.
    scale: f64,
}

impl DepthTable {
    /// The table of a depth law. Metres are the law's own, not rounded to millimetres: at 0.5 m a disparity step is
    /// 0.7 mm, and whole millimetres would make steps of unequal length of it.
    pub fn from_law(law: &ZeroPlane) -> Self {
        let mut table = Self::empty();
        for code in (0..RAW_CODES as u16).map(RawDisparity) {
            if let (Some(metres), Some(mm)) = (law.metres(f64::from(code.0)), law.mm(code)) {
                table.set(code, metres, mm);
            }
        }
        table
    }

    /// The same with every depth multiplied by `factor`: those of frames in millimetres too, which no law has made.
    /// Depths that leave the range are no data.
    pub fn scaled(self, factor: f64) -> Self {
        if factor == 1.0 {
            return self;
        }
        let mut scaled = Self { scale: self.scale * factor, ..Self::empty() };
        for (code, &depth) in (0..).map(RawDisparity).zip(self.metres.iter()) {
            let metres = f64::from(depth) * factor;
            // Cut off as the law's are.
            scaled.set(code, metres, (metres * 1_000.0) as u16);
        }
        scaled
    }

    /// A depth that came in millimetres, m.
    pub(crate) fn of_mm(&self, mm: u16) -> f32 {
        if self.scale == 1.0 {
            return if is_depth_mm(mm) { f32::from(mm) / 1_000.0 } else { 0.0 };
        }
        if self.mm_of_mm(mm) > 0 { (f64::from(mm) * 1e-3 * self.scale) as f32 } else { 0.0 }
    }

    /// The same in millimetres.
    pub(crate) fn mm_of_mm(&self, mm: u16) -> u16 {
        if self.scale == 1.0 {
            return if is_depth_mm(mm) { mm } else { 0 };
        }
        let scaled = (f64::from(mm) * self.scale).round() as u16;
        if is_depth_mm(mm) && is_depth_mm(scaled) { scaled } else { 0 }
    }

    /// Depth in metres by code; 0 = no data.
    pub fn metres(&self) -> &[f32; RAW_CODES] {
        &self.metres
    }

    /// Depth in millimetres by code; 0 = no data.
    pub fn mm(&self) -> &[u16; RAW_CODES] {
        &self.mm
    }

    /// How many codes have a depth.
    pub fn depths(&self) -> usize {
        self.mm.iter().filter(|&&mm| mm > 0).count()
    }

    /// A table in which no code has a depth.
    pub(crate) fn empty() -> Self {
        Self { metres: Box::new([0.0; RAW_CODES]), mm: Box::new([0; RAW_CODES]), scale: 1.0 }
    }

    /// Gives a code its depth, unless one or the other is not one.
    pub(crate) fn set(&mut self, code: RawDisparity, metres: f64, mm: u16) {
        if !code.is_depth() || !is_depth_mm(mm) {
            return;
        }
        if let (Some(to_metres), Some(to_mm)) =
            (self.metres.get_mut(usize::from(code.0)), self.mm.get_mut(usize::from(code.0)))
        {
            *to_metres = metres as f32;
            *to_mm = mm;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_factory_law_gives_a_depth_to_codes_below_1055_and_to_no_other() {
        let table = DepthTable::from_law(&ZeroPlane::default());
        assert_eq!(table.depths(), 1_055);
        assert!(table.mm()[..1_055].iter().all(|&mm| (317..=9_757).contains(&mm)));
        assert!(table.mm()[1_055..].iter().all(|&mm| mm == 0));
    }

    #[test]
    fn metres_are_the_laws_and_millimetres_are_them_cut_off() {
        let table = DepthTable::from_law(&ZeroPlane::default());
        for (&metres, &mm) in table.metres().iter().zip(table.mm()) {
            // f32 holds 10 m to 1e-6 m, so the two agree to the millimetre below, give or take that.
            let past = f64::from(metres) * 1_000.0 - f64::from(mm);
            assert!((-0.001..1.001).contains(&past), "{metres} m, {mm} mm");
        }
    }

    #[test]
    fn a_scale_multiplies_every_depth_and_what_leaves_the_range_is_no_data() {
        let (table, scaled) =
            (DepthTable::from_law(&ZeroPlane::default()), DepthTable::from_law(&ZeroPlane::default()).scaled(1.1));
        for (&before, &after) in table.metres().iter().zip(scaled.metres()) {
            let expected = if before * 1.1 < 10.0 { before * 1.1 } else { 0.0 };
            assert!((after - expected).abs() < 1e-5, "{before} {after}");
        }
        assert!(scaled.metres().iter().zip(scaled.mm()).all(|(&metres, &mm)| (metres > 0.0) == (mm > 0)));
        assert!((scaled.of_mm(2_000) - 2.2).abs() < 1e-6 && scaled.mm_of_mm(2_000) == 2_200);
        assert_eq!([0, 9_500].map(|mm| (scaled.of_mm(mm), scaled.mm_of_mm(mm))), [(0.0, 0); 2]);
        assert_eq!(table.clone().scaled(1.0), table);
    }

    #[test]
    fn no_data_is_the_same_in_both_units() {
        // The pole at 1049.4 (const_shift 190): codes before 1055 without a depth.
        let table = DepthTable::from_law(&ZeroPlane { const_shift: 190, ..ZeroPlane::default() });
        assert!(table.depths() < 1_055);
        assert!(table.metres().iter().zip(table.mm()).all(|(&metres, &mm)| (metres > 0.0) == (mm > 0)));
    }
}

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
        Self { metres: Box::new([0.0; RAW_CODES]), mm: Box::new([0; RAW_CODES]) }
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
    fn no_data_is_the_same_in_both_units() {
        // The pole at 1049.4 (const_shift 190): codes before 1055 without a depth.
        let table = DepthTable::from_law(&ZeroPlane { const_shift: 190, ..ZeroPlane::default() });
        assert!(table.depths() < 1_055);
        assert!(table.metres().iter().zip(table.mm()).all(|(&metres, &mm)| (metres > 0.0) == (mm > 0)));
    }
}

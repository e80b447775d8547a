//! Four places at once: what the surface is at each, number by number in registers of four.

use super::lookup::Lookup;
use super::patch::Patch;
use wide::f32x4;

/// The patches that four places met, column by column. Where none was met the numbers are some patch's: finite, and to
/// be left out.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FourPatches {
    /// Anchors, m.
    pub(crate) p: [f32x4; 3],
    /// Curvatures, 1/m.
    pub(crate) a: f32x4,
    /// Unit normals.
    pub(crate) n: [f32x4; 3],
    /// A mask: the place is in the grid.
    pub(crate) is_met: f32x4,
}

impl FourPatches {
    #[inline(always)]
    pub(crate) fn look(patches: &[Patch], lookup: &Lookup, places: &[f32x4; 3]) -> Self {
        let (indices, is_met) = lookup.four(places);
        let four = indices.map(|index| patches.get(index).unwrap_or(&Patch::NOWHERE));
        let [px, py, pz, a] = f32x4::transpose(four.map(|Patch { p: [x, y, z], a, .. }| f32x4::new([*x, *y, *z, *a])));
        let normals = four.map(|Patch { n: [x, y, z], sigma, .. }| f32x4::new([*x, *y, *z, *sigma]));
        let [nx, ny, nz, _] = f32x4::transpose(normals);
        Self { p: [px, py, pz], a, n: [nx, ny, nz], is_met }
    }

    /// From the anchors to places.
    #[inline(always)]
    pub(crate) fn offset(&self, [x, y, z]: &[f32x4; 3]) -> [f32x4; 3] {
        let [px, py, pz] = self.p;
        [*x - px, *y - py, *z - pz]
    }
}

/// Products of vectors, four at a time.
#[inline(always)]
pub(crate) fn dot(a: &[f32x4; 3], b: &[f32x4; 3]) -> f32x4 {
    let ([ax, ay, az], [bx, by, bz]) = (*a, *b);
    ax * bx + ay * by + az * bz
}

/// Whole numbers below 2²⁴ of numbers that are not below 0, as floats.
#[inline(always)]
pub(crate) fn whole(number: f32x4) -> f32x4 {
    f32x4::from_i32x4(number.fast_trunc_int())
}

/// Indices into a list, of whole numbers below 2²⁴.
#[inline(always)]
pub(crate) fn indices(number: f32x4) -> [usize; 4] {
    number.fast_trunc_int().to_array().map(|index| index as usize)
}

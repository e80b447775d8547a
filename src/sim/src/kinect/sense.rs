//! From what a row sees to the codes the device sends.

use crate::kinect::dropout::Dropout;
use crate::kinect::edges::{self, Straying, apart};
use crate::kinect::facets::Facet;
use crate::kinect::grain::{self, SigmaTable};
use crate::kinect::optics::Optics;
use crate::kinect::parameters::KinectParameters;
use crate::kinect::raster::{NOTHING, lit};
use crate::kinect::warp::Warp;
use crate::noise::Noise;
use tumbled_kinect::{HEIGHT, RawDisparity, WIDTH};

/// Columns that carry data; the device's window does not reach the last eight.
const USED: usize = 632;
/// The greatest code that stands for a depth: 9.757 m by the factory's law.
const GREATEST: f64 = 1_054.0;

/// A frame after drawing, before it is measured.
pub(super) struct Sensed<'a> {
    pub(super) parameters: &'a KinectParameters,
    pub(super) optics: &'a Optics,
    pub(super) facets: &'a [Facet],
    /// 1/z by pixel.
    pub(super) inverse_depth: &'a [f64],
    /// Triangle by pixel.
    pub(super) facet: &'a [u32],
    /// Steps in depth by pixel.
    pub(super) steps: &'a [u8],
    /// Noise by pixel, not yet through the window down the columns.
    pub(super) grain: &'a [f32],
    pub(super) straying: &'a Straying,
    pub(super) warp: &'a Warp,
    pub(super) sigma: &'a SigmaTable,
    pub(super) dropout: Dropout,
}

/// What a pixel measures: a triangle's plane or a place between two.
struct Surface {
    inverse_depth: f64,
    facet: u32,
}

impl Sensed<'_> {
    /// The codes of row `v`. `chance`: the row's dice.
    pub(super) fn row(&self, v: usize, chance: &mut Noise, codes: &mut [RawDisparity]) {
        let row = v * WIDTH..(v + 1) * WIDTH;
        let (Some(depths), Some(facets)) = (self.inverse_depth.get(row.clone()), self.facet.get(row)) else { return };
        let mut near = [0_u8; WIDTH];
        edges::near(self.steps, v, &mut near);
        if near.iter().all(|near| *near == 0) && !facets.iter().any(|facet| lit(*facet)) {
            return;
        }
        let grain = self.grain_row(v);
        let (warp, law) = (self.warp.row(v), &self.parameters.law);
        let mut plane = (NOTHING, 0.0); // the last pixel's: mostly this one's too
        let pixels = depths.iter().zip(facets).zip(&near).zip(&grain).enumerate().take(USED);
        for ((u, (((&w, &facet), &near), &noise)), code) in pixels.zip(codes) {
            let here = Surface { inverse_depth: w, facet };
            let surface = if near == 0 { here } else { self.strayed(u, v, here, chance) };
            let Some(facet) = lit(surface.facet).then(|| self.facets.get(surface.facet as usize)).flatten() else {
                continue;
            };
            let w = surface.inverse_depth;
            let metres = 1.0 / w;
            let [x, y] = self.optics.ray(u, v);
            if plane.0 != surface.facet {
                plane = (surface.facet, facet.inverse_distance_squared(v));
            }
            let cos_squared = w * w / (plane.1 * (x * x + y * y + 1.0));
            let border = || {
                let [_, _, border] = self.straying.at(u, v);
                f64::from(border)
            };
            if self.dropout.loses(metres, cos_squared, facet.material, border, chance) {
                continue;
            }
            let metres = self.parameters.depth_scale * metres + warp.at(u);
            // Rounded by cutting off half a step more: no call of a rounding function, which the loop would feel.
            let code_and_half = law.disparity(metres) + f64::from(self.sigma.at(w) * noise) + 0.5;
            if (0.0..GREATEST + 1.0).contains(&code_and_half) {
                *code = RawDisparity(code_and_half as u16);
            }
        }
    }

    /// The noise of row `v`, standard deviation 1.
    fn grain_row(&self, v: usize) -> [f32; WIDTH] {
        let mut noise = [0.0_f32; WIDTH];
        for (at, tap) in grain::WINDOW.iter().enumerate() {
            // At the border the nearest row again.
            let row = (v + at).saturating_sub(grain::REACH).min(HEIGHT - 1);
            let row = self.grain.get(row * WIDTH..(row + 1) * WIDTH).unwrap_or_default();
            noise.iter_mut().zip(row).for_each(|(noise, along)| *noise += tap * along);
        }
        noise
    }

    /// What a pixel near an edge measures: the surface beside it where that strays over, in the pixel's own direction; now
    /// and then a place between that and its own.
    fn strayed(&self, u: usize, v: usize, here: Surface, chance: &mut Noise) -> Surface {
        let Some((from_u, from_v)) = self.straying.source(u, v, self.straying.at(u, v)) else { return here };
        let at = from_v * WIDTH + from_u;
        let (Some(&w), Some(&facet)) = (self.inverse_depth.get(at), self.facet.get(at)) else { return here };
        if !apart((here.inverse_depth, here.facet), (w, facet)) {
            return here;
        }
        let mut there = Surface { inverse_depth: w, facet };
        if !lit(facet) {
            return there;
        }
        // The plane goes on into this pixel, unless it is seen so flatly that a few pixels are a step themselves.
        let cone = self.facets.get(facet as usize).and_then(|facet| facet.cone(v));
        let continued = cone.map_or(w, |cone| cone.inverse_depth_at(self.optics.ray(u, v)));
        if !apart((continued, facet), (w, u32::MAX >> 1)) {
            there.inverse_depth = continued;
        }
        if lit(here.facet) && chance.chance(self.parameters.flying_share) {
            there.inverse_depth += chance.uniform() * (here.inverse_depth - there.inverse_depth);
        }
        there
    }
}

//! Ragged edges: near a step in depth a pixel may see what lies up to four pixels beside it.

use crate::kinect::grain::nearly_normal;
use crate::kinect::raster::lit;
use crate::noise::Noise;
use tumbled_kinect::{HEIGHT, WIDTH};

/// How far an edge may stray, px.
pub(super) const REACH: usize = 4;
/// Pixels between two numbers of the straying, which is smooth between them.
const CELL: usize = 4;
const NODES_ACROSS: usize = WIDTH / CELL + 1;
const NODES_DOWN: usize = HEIGHT / CELL + 1;
/// Bilinear interpolation between independent numbers has 2/3 of their variance in each direction, on average over a cell.
const RESTORE: f64 = 1.5;

/// A frame's straying: three smooth fields over the image, drawn by the frame.
#[derive(Debug)]
pub(super) struct Straying {
    /// Across, px; down, px; and one with standard deviation 1 for whatever else has a ragged border.
    nodes: Vec<[f32; 3]>,
}

impl Straying {
    pub(super) fn new(seed: u64, name: &str, index: u64, edge_px: f64) -> Self {
        let mut noise = Noise::new(seed, name, index);
        let (far, spread) = ((RESTORE * edge_px) as f32, RESTORE as f32);
        let mut node = || {
            let (both, third) = (noise.bits(), noise.bits());
            let [across, down, other] = [both as u32, (both >> 32) as u32, third as u32].map(nearly_normal);
            [across * far, down * far, other * spread]
        };
        Self { nodes: (0..NODES_ACROSS * NODES_DOWN).map(|_| node()).collect() }
    }

    /// The three fields at a pixel.
    pub(super) fn at(&self, u: usize, v: usize) -> [f32; 3] {
        let share = |pixel: usize| (pixel % CELL) as f32 / CELL as f32;
        let (column, row, right, down) = (u / CELL, v / CELL, share(u), share(v));
        let node = |column, row| self.nodes.get(row * NODES_ACROSS + column).copied().unwrap_or_default();
        let mix = |a: [f32; 3], b: [f32; 3], share: f32| {
            let ([a0, a1, a2], [b0, b1, b2]) = (a, b);
            [a0 + (b0 - a0) * share, a1 + (b1 - a1) * share, a2 + (b2 - a2) * share]
        };
        let top = mix(node(column, row), node(column + 1, row), right);
        mix(top, mix(node(column, row + 1), node(column + 1, row + 1), right), down)
    }

    /// The pixel that a pixel near an edge sees; `None`: one outside the image.
    pub(super) fn source(&self, u: usize, v: usize, [across, down, _]: [f32; 3]) -> Option<(usize, usize)> {
        let reach = REACH as f32;
        let step = |px: f32| px.clamp(-reach, reach).round() as isize;
        let (u, v) = (u.checked_add_signed(step(across))?, v.checked_add_signed(step(down))?);
        (u < WIDTH && v < HEIGHT).then_some((u, v))
    }
}

/// Steps in depth above this share of the nearer one's inverse are edges. A surface at 80° and 2 m changes by 1 % a pixel.
const EDGE_SHARE: f64 = 0.02;

/// Whether two neighbours see different surfaces with a step between: nearness and triangle of each.
pub(super) fn apart((w, facet): (f64, u32), (other_w, other): (f64, u32)) -> bool {
    if facet == other {
        return false;
    }
    if lit(facet) != lit(other) {
        return true;
    }
    lit(facet) && (w - other_w).abs() > EDGE_SHARE * w.max(other_w)
}

/// A row: 1/z and triangle by pixel.
type Row<'a> = (&'a [f64], &'a [u32]);

fn pixels<'a>((depths, facets): Row<'a>) -> impl Iterator<Item = (f64, u32)> + 'a {
    depths.iter().copied().zip(facets.iter().copied())
}

/// Marks the pixels of a row beyond which, to the right or below, the depth steps.
pub(super) fn mark(row: Row<'_>, below: Option<Row<'_>>, steps: &mut [u8]) {
    for ((step, here), right) in steps.iter_mut().zip(pixels(row)).zip(pixels(row).skip(1)) {
        *step = u8::from(apart(here, right));
    }
    let Some(below) = below else { return };
    for ((step, here), under) in steps.iter_mut().zip(pixels(row)).zip(pixels(below)) {
        *step |= u8::from(apart(here, under));
    }
}

/// The pixels of row `v` within [`REACH`] of a step, from the steps of all rows.
pub(super) fn near(steps: &[u8], v: usize, near: &mut [u8]) {
    let mut any = [0_u8; WIDTH];
    for row in v.saturating_sub(REACH)..(v + REACH + 1).min(HEIGHT) {
        let Some(row) = steps.get(row * WIDTH..(row + 1) * WIDTH) else { continue };
        any.iter_mut().zip(row).for_each(|(any, step)| *any |= step);
    }
    near.fill(0);
    if any.iter().all(|step| *step == 0) {
        return;
    }
    for (u, _) in any.iter().enumerate().filter(|(_, step)| **step != 0) {
        // The step lies between u and u + 1.
        let reached = (u + 1).saturating_sub(REACH)..(u + REACH + 1).min(WIDTH);
        near.get_mut(reached).into_iter().for_each(|pixels| pixels.fill(1));
    }
}

//! What is unknown of a depth camera, and which of it a model solves for.

use nalgebra::{Isometry3, Point3, Vector3};
use tumbled_model::se3::exp_rotation;

/// Terms of the surface over the picture: 1, x, x², x³, y, xy, x²y, y², xy², y³.
pub const SURFACE_TERMS: usize = 10;
/// Rotation 3, translation 3, depth scale, surface 10, lens 6, edges 2.
pub const UNKNOWNS: usize = 25;
pub(super) const SCALE: usize = 6;
pub(super) const SURFACE: usize = 7;
pub(super) const LENS: usize = 17;
pub(super) const EDGE: usize = 23;
/// Of the terms, those of a surface of the second order.
const QUADRATIC: [usize; 6] = [0, 1, 2, 4, 5, 7];

/// What a lens is solved for: the pinhole and radial distortion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Focal length across, px.
    pub fx: f64,
    /// Focal length down, px.
    pub fy: f64,
    /// Principal point, column.
    pub cx: f64,
    /// Principal point, row.
    pub cy: f64,
    /// Radial distortion, r².
    pub k1: f64,
    /// Radial distortion, r⁴.
    pub k2: f64,
}

impl Lens {
    fn plus(&self, step: &[f64]) -> Self {
        let at = |n: usize| step.get(n).copied().unwrap_or_default();
        Self {
            fx: self.fx + at(0),
            fy: self.fy + at(1),
            cx: self.cx + at(2),
            cy: self.cy + at(3),
            k1: self.k1 + at(4),
            k2: self.k2 + at(5),
        }
    }
}

/// The camera whose lens and depths are looked for: its geometry is the decoder's.
pub trait Camera {
    /// The picture's columns and rows.
    fn size(&self) -> [f64; 2];
    /// The lens it is said to have.
    fn lens(&self) -> Lens;
    /// x/z and y/z of the ray seen at a pixel through a lens; `None`: there is none.
    fn ray(&self, lens: &Lens, u: f64, v: f64) -> Option<[f64; 2]>;
    /// Where the ray x/z, y/z is seen through the lens it is said to have: column and row.
    fn pixel(&self, x: f64, y: f64) -> [f64; 2];
    /// The surface's terms at a pixel.
    fn terms(&self, u: f64, v: f64) -> [f64; SURFACE_TERMS];
}

/// Which of the unknowns a model solves for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Model {
    /// The surface's order: 0 (none), 2 or 3.
    pub order: u8,
    /// The power of the depth that the surface is multiplied by: 0 or 2.
    pub power: u8,
    /// Whether focal lengths and principal point are solved for.
    pub pinhole: bool,
    /// Whether radial distortion is.
    pub radial: bool,
}

impl Model {
    /// A scale alone.
    pub const SCALE: Self = Self { order: 0, power: 0, pinhole: false, radial: false };

    /// In reports.
    pub fn name(&self) -> String {
        let surface = match (self.order, self.power) {
            (0, _) => "scale".to_owned(),
            (order, 0) => format!("scale, surface of order {order} in metres"),
            (order, _) => format!("scale, surface of order {order} in disparity"),
        };
        let pinhole = if self.pinhole { ", fx fy cx cy" } else { "" };
        format!("{surface}{pinhole}{}", if self.radial { ", k1 k2" } else { "" })
    }

    /// The unknowns that are solved for, by number.
    pub(super) fn active(&self) -> Vec<usize> {
        let mut active: Vec<usize> = (0..=SCALE).collect();
        match self.order {
            0 => {}
            2 => active.extend(QUADRATIC.map(|term| SURFACE + term)),
            _ => active.extend(SURFACE..SURFACE + SURFACE_TERMS),
        }
        if self.pinhole {
            active.extend(LENS..LENS + 4);
        }
        if self.radial {
            active.extend(LENS + 4..LENS + 6);
        }
        active.extend([EDGE, EDGE + 1]);
        active
    }
}

/// How far an unknown may be off before anything is measured, one standard deviation: rad, m, share, m^(1 − power), px, –.
/// It keeps apart what the boards hardly tell apart: an error that is the same everywhere from a camera that is as much nearer.
/// Published surfaces of warm cameras have 5 to 10 mm at 2 m.
pub(super) fn prior(unknown: usize, power: u8) -> f64 {
    match unknown {
        0..6 => 0.5,
        SCALE => 0.05,
        SURFACE if power == 0 => 0.0025,
        SURFACE => 0.0006,
        8..17 if power == 0 => 0.005,
        8..17 => 0.00125,
        17..21 => 20.0,
        21..23 => 0.2,
        _ => 3.0,
    }
}

/// Current values.
#[derive(Clone, Debug, PartialEq)]
pub struct State {
    /// The camera in the LiDAR's frame.
    pub t_lidar_camera: Isometry3<f64>,
    /// True depth over measured depth, before the surface.
    pub depth_scale: f64,
    /// The power of the depth that the surface is multiplied by.
    pub power: u8,
    /// The surface's factors.
    pub surface: [f64; SURFACE_TERMS],
    /// The lens.
    pub lens: Lens,
    /// How far beyond the last pixel of the board its edge lies along rows and along columns, px: what the device does at edges.
    pub edge_px: [f64; 2],
    /// What it began with, for the prior.
    pub(super) from: Option<Box<State>>,
}

impl State {
    pub(super) fn new(t_lidar_camera: Isometry3<f64>, lens: Lens, power: u8) -> Self {
        let surface = [0.0; SURFACE_TERMS];
        let state = Self { t_lidar_camera, depth_scale: 1.0, power, surface, lens, edge_px: [0.0; 2], from: None };
        Self { from: Some(Box::new(state.clone())), ..state }
    }

    /// The true depth of a measured one, where the surface's terms are `terms`.
    pub fn depth(&self, measured: f64, terms: &[f64; SURFACE_TERMS]) -> f64 {
        let scaled = self.depth_scale * measured;
        let surface: f64 = self.surface.iter().zip(terms).map(|(factor, term)| factor * term).sum();
        scaled + surface * self.size(scaled)
    }

    /// The depth to the surface's power.
    pub(super) fn size(&self, scaled: f64) -> f64 {
        if self.power == 2 { scaled * scaled } else { 1.0 }
    }

    /// `∂depth/∂scale`.
    pub(super) fn by_scale(&self, measured: f64, terms: &[f64; SURFACE_TERMS]) -> f64 {
        let surface: f64 = self.surface.iter().zip(terms).map(|(factor, term)| factor * term).sum();
        let slope = if self.power == 2 { 2.0 * self.depth_scale * measured } else { 0.0 };
        measured * (1.0 + surface * slope)
    }

    /// The lens with one of its six numbers changed.
    pub(super) fn lens_with(&self, number: usize, change: f64) -> Lens {
        let mut step = [0.0; 6];
        step.iter_mut().skip(number).take(1).for_each(|entry| *entry = change);
        self.lens.plus(&step)
    }

    pub(super) fn advance(&mut self, step: &[f64; UNKNOWNS]) {
        let at = |n: usize| step.get(n).copied().unwrap_or_default();
        let turn = exp_rotation(&Vector3::new(at(0), at(1), at(2)));
        self.t_lidar_camera.rotation = turn * self.t_lidar_camera.rotation;
        self.t_lidar_camera.translation.vector += Vector3::new(at(3), at(4), at(5));
        self.depth_scale += at(SCALE);
        for (factor, change) in self.surface.iter_mut().zip(step.iter().skip(SURFACE)) {
            *factor += change;
        }
        self.lens = self.lens.plus(step.get(LENS..EDGE).unwrap_or_default());
        self.edge_px = [self.edge_px[0] + at(EDGE), self.edge_px[1] + at(EDGE + 1)];
    }

    /// How far an unknown but those of the place is from where it began.
    pub(super) fn moved(&self, unknown: usize) -> f64 {
        let Some(from) = &self.from else { return 0.0 };
        let list = |state: &Self| {
            let l = &state.lens;
            [l.fx, l.fy, l.cx, l.cy, l.k1, l.k2].get(unknown.wrapping_sub(LENS)).copied().unwrap_or_default()
        };
        match unknown {
            SCALE => self.depth_scale - from.depth_scale,
            7..17 => self.surface.get(unknown - SURFACE).copied().unwrap_or_default(),
            17..23 => list(self) - list(from),
            EDGE => self.edge_px[0] - from.edge_px[0],
            24 => self.edge_px[1] - from.edge_px[1],
            _ => 0.0,
        }
    }

    /// The point of a pixel with its measured depth.
    pub fn point(&self, camera: &dyn Camera, [u, v]: [f64; 2], measured: f64) -> Option<Point3<f64>> {
        let [x, y] = camera.ray(&self.lens, u, v)?;
        let z = self.depth(measured, &camera.terms(u, v));
        Some(Point3::new(x * z, y * z, z))
    }
}

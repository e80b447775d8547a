//! The simulated Kinect v1: raw 11-bit frames of a world, as the device would send them.
//!
//! ```text
//!  world ─ facets ─▶ raster ─▶ shadow ─▶ edges ─▶ dropout ─▶ warp ─▶ law + grain ─▶ rounding ─▶ codes
//! ```
//!
//! * `facets`, `optics`, `raster`: the nearest triangle and its exact depth by pixel, row by row at its own time;
//! * `shadow`: where the projector does not shine; `edges`: ragged edges and flying pixels;
//! * `dropout`: range, incidence and material; `warp`: a smooth error of the depth;
//! * [`law`], `grain`: depth to disparity, and its noise; rounded in disparity, as the device does.
//!
//! Every random number belongs to the seed, the device's name, and a frame's index and row: frames may be made in any
//! order, rows on any number of threads, and the bytes are the same.

mod dropout;
mod edges;
mod facets;
mod grain;
pub mod law;
mod optics;
pub mod parameters;
mod raster;
mod sense;
mod shadow;
mod warp;

use crate::noise::Noise;
use crate::world::{Role, World};
use nalgebra::Isometry3;
use rayon::ThreadPool;
use rayon::prelude::*;
use tumbled_kinect::{
    DepthImage, EncodeError, HEIGHT, Image, Intrinsics, IntrinsicsError, PIXELS, RawImage, WIDTH, encode_raw,
};
use tumbled_model::{DepthEncoding, RigNs};

pub use law::DepthLaw;
pub use parameters::{KinectParameters, ParameterError};

/// Rows drawn at once: what they need stays in a core's cache, and there are enough of them for every core.
const BAND_ROWS: usize = 16;

/// A simulated Kinect.
#[derive(Clone, Debug)]
pub struct KinectModel {
    optics: optics::Optics,
    sigma: grain::SigmaTable,
    t_rig_kinect: Isometry3<f64>,
    parameters: KinectParameters,
    names: Names,
    truth: bool,
}

/// Names of the streams of random numbers.
#[derive(Clone, Debug)]
struct Names {
    noise: String,
    edges: String,
    chance: String,
    warp: String,
}

/// A frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// The codes; [`NO_DATA`](tumbled_kinect::RawDisparity::NO_DATA) where there is none.
    pub raw: RawImage,
    /// What there was to see, if [asked for](KinectModel::with_truth).
    pub truth: Option<Truth>,
}

/// What a frame would have measured without any error.
#[derive(Clone, Debug, PartialEq)]
pub struct Truth {
    /// Depth along the optical axis by pixel, m; 0 = nothing in sight. All 640 columns, and in the projector's shadow too.
    pub depth: DepthImage,
    /// Whose surface it is.
    pub role: Image<Option<Role>>,
}

/// A device that cannot be simulated.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ModelError {
    /// Its camera.
    #[error(transparent)]
    Intrinsics(#[from] IntrinsicsError),
    /// One of its parameters.
    #[error(transparent)]
    Parameter(#[from] ParameterError),
}

impl Frame {
    /// The frame as on the wire: 422 400 bytes.
    ///
    /// # Errors
    /// [`EncodeError::Code`] if `raw` was given a code of more than eleven bits.
    pub fn packed(&self) -> Result<Vec<u8>, EncodeError> {
        encode_raw(&self.raw, DepthEncoding::Packed11)
    }
}

impl KinectModel {
    /// A device. `name` keeps its random numbers from another device's; `t_rig_kinect` is the infrared camera's frame
    /// (x right, y down, z forward) in the rig's.
    ///
    /// # Errors
    /// [`ModelError`]: intrinsics that describe no camera, or parameters no device has.
    pub fn new(
        name: &str,
        intrinsics: &Intrinsics,
        t_rig_kinect: Isometry3<f64>,
        parameters: KinectParameters,
    ) -> Result<Self, ModelError> {
        parameters.check()?;
        let stream = |what: &str| format!("kinect.{name}.{what}");
        Ok(Self {
            optics: optics::Optics::new(intrinsics)?,
            sigma: grain::SigmaTable::new(parameters.noise_share),
            t_rig_kinect,
            parameters,
            names: Names {
                noise: stream("noise"),
                edges: stream("edges"),
                chance: stream("chance"),
                warp: stream("warp"),
            },
            truth: false,
        })
    }

    /// The same device, whose frames have their truth with them.
    #[must_use]
    pub fn with_truth(self) -> Self {
        Self { truth: true, ..self }
    }

    /// What the device adds to its scaled depth at a pixel and an instant, m: its warp, drawn by `seed`. A truth, for tests.
    pub fn warp_m(&self, t: RigNs, seed: u64, u: usize, v: usize) -> f64 {
        warp::Warp::new(&self.parameters, seed, &self.names.warp, t).row(v).at(u)
    }

    /// The frame whose middle row is seen at `t`, the session's `index`-th, on this thread.
    pub fn frame(&self, world: &World, t: RigNs, index: u64, seed: u64) -> Frame {
        self.render(world, t, index, seed, None)
    }

    /// The same frame, its rows shared out over a pool's threads.
    pub fn frame_on(&self, pool: &ThreadPool, world: &World, t: RigNs, index: u64, seed: u64) -> Frame {
        self.render(world, t, index, seed, Some(pool))
    }

    fn render(&self, world: &World, t: RigNs, index: u64, seed: u64, pool: Option<&ThreadPool>) -> Frame {
        let half = RigNs((self.parameters.readout_s * 0.5e9).round() as i64).0;
        let times = [RigNs(t.0.saturating_sub(half)), RigNs(t.0.saturating_add(half))];
        let facets = facets::facets(world, &self.t_rig_kinect, &self.optics, times);

        let mut inverse_depth = vec![0.0_f64; PIXELS];
        let mut facet = vec![raster::NOTHING; PIXELS];
        let bands = inverse_depth.chunks_mut(BAND_ROWS * WIDTH).zip(facet.chunks_mut(BAND_ROWS * WIDTH)).enumerate();
        each(pool, bands.collect(), |(band, (inverse_depth, facet))| {
            self.draw(raster::Band { first: band * BAND_ROWS, inverse_depth, facet }, &facets);
        });

        let lit: Vec<bool> = facet.chunks(WIDTH).map(|row| row.iter().any(|facet| raster::lit(*facet))).collect();
        let used = |v: usize| lit.get(v).is_some_and(|lit| *lit);
        let mut steps = vec![0_u8; PIXELS];
        let mut grain = vec![0.0_f32; PIXELS];
        let rows = steps.chunks_mut(WIDTH).zip(grain.chunks_mut(WIDTH)).enumerate();
        each(pool, rows.collect(), |(v, (steps, grain))| {
            let pixels = |v| slice(&inverse_depth, v).zip(slice(&facet, v));
            if let Some(here) = pixels(v).filter(|_| used(v) || used(v + 1)) {
                edges::mark(here, pixels(v + 1), steps);
            }
            // A row of noise is needed where one within the window's reach, or a strayed edge, may have data.
            let reach = grain::REACH + edges::REACH;
            if (v.saturating_sub(reach)..=v + reach).any(&used) {
                grain::along(seed, &self.names.noise, index, v, grain);
            }
        });

        let straying = edges::Straying::new(seed, &self.names.edges, index, self.parameters.edge_px);
        let warp = warp::Warp::new(&self.parameters, seed, &self.names.warp, t);
        let sensed = sense::Sensed {
            parameters: &self.parameters,
            optics: &self.optics,
            facets: &facets,
            inverse_depth: &inverse_depth,
            facet: &facet,
            steps: &steps,
            grain: &grain,
            straying: &straying,
            warp: &warp,
            sigma: &self.sigma,
            dropout: dropout::Dropout::new(&self.parameters),
        };
        let mut raw = RawImage::new();
        each(pool, raw.pixels_mut().chunks_mut(WIDTH).enumerate().collect(), |(v, codes)| {
            let row = index.wrapping_mul(HEIGHT as u64).wrapping_add(v as u64);
            sensed.row(v, &mut Noise::new(seed, &self.names.chance, row), codes);
        });
        let truth = self.truth.then(|| truth(&facets, &inverse_depth, &facet));
        Frame { raw, truth }
    }

    /// Draws a band and the shadows in it.
    fn draw(&self, mut band: raster::Band<'_>, facets: &[facets::Facet]) {
        raster::draw(&mut band, facets, &self.optics);
        let mut columns = Vec::new();
        let rows = band.inverse_depth.chunks(WIDTH).zip(band.facet.chunks_mut(WIDTH));
        for (v, (inverse_depth, facet)) in (band.first..).zip(rows) {
            shadow::cast(&self.optics, self.parameters.baseline_m, v, inverse_depth, facet, &mut columns);
        }
    }
}

/// Does every piece of work, on a pool's threads or on this one.
fn each<T: Send>(pool: Option<&ThreadPool>, work: Vec<T>, does: impl Fn(T) + Send + Sync) {
    match pool {
        None => work.into_iter().for_each(does),
        Some(pool) => pool.install(|| work.into_par_iter().for_each(does)),
    }
}

/// Row `v` of an image.
fn slice<T>(image: &[T], v: usize) -> Option<&[T]> {
    image.get(v * WIDTH..(v + 1) * WIDTH)
}

fn truth(facets: &[facets::Facet], inverse_depth: &[f64], facet: &[u32]) -> Truth {
    let (mut depth, mut role) = (DepthImage::new(), Image::filled(None));
    let places = depth.pixels_mut().iter_mut().zip(role.pixels_mut());
    for ((depth, role), (w, facet)) in places.zip(inverse_depth.iter().zip(facet)) {
        if *facet != raster::NOTHING {
            *depth = (1.0 / w) as f32;
            *role = facets.get((facet & !raster::SHADOWED) as usize).map(|facet| facet.role);
        }
    }
    Truth { depth, role }
}

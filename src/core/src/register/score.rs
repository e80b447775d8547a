//! How well a pose explains what both sensors saw (method.md §3.4, §3.4b): points on the other's surface speak for it,
//! points where the other sensor saw through speak against it, and points it could not see are explained as well.

use super::cloud::{Cloud, SensorKind, View};
use super::freespace::{FreeSpace, Sighting};
use crate::surface::{Surface, farthest_points, spacing_m};
use nalgebra::{Isometry3, Point3};

/// Standard deviation of a supported point's height over the surface, m.
const SIGMA_M: f32 = 0.02;
/// Points farther than this from the nearest patch's anchor are on no surface, m.
const REACH_M: f32 = 0.06;
/// A surface faces a sensor whose sight makes an angle of a greater cosine with its normal: a little beyond edge-on,
/// normals being what they are.
const FACING: f32 = -0.1;
/// A surface faces it so well that its returns were due.
const WELL_FACING: f32 = 0.15;
/// A dense point is supported by a return at its range within this, m.
const SAME_RANGE_M: f32 = 0.05;
/// Dense points that are held against the sparse sensor's sights.
pub const PROBES: usize = 400;

/// The most that hidden points count beside supported ones: two views that share a third of what they see have 30 to 37 %
/// hidden points beside 30 to 50 % supported ones (method.md §3.4b).
const HIDDEN_BESIDE: f64 = 1.2;

/// Points that go from step to step together: each step's code then fits the processor, and its sums its registers.
const BLOCK: usize = 16;

/// Largest error of the Gaussian in a score: absolute, of a value of 0..=1.
pub const BELL_ERROR: f32 = 1e-5;

/// A rigid motion in single precision: coordinates of the sparse cloud to coordinates of the dense one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placement {
    /// Rows of the rotation matrix.
    pub rotation: [[f32; 3]; 3],
    /// The sparse frame's origin in the dense frame, m.
    pub translation: [f32; 3],
}

impl From<&Isometry3<f64>> for Placement {
    fn from(pose: &Isometry3<f64>) -> Self {
        let r = pose.rotation.to_rotation_matrix().into_inner().cast::<f32>();
        Self {
            rotation: [[r.m11, r.m12, r.m13], [r.m21, r.m22, r.m23], [r.m31, r.m32, r.m33]],
            translation: pose.translation.vector.cast::<f32>().into(),
        }
    }
}

impl Placement {
    /// From the sparse frame to the dense one.
    #[inline(always)]
    pub fn forth(&self, place: &[f32; 3]) -> [f32; 3] {
        let [row_x, row_y, row_z] = &self.rotation;
        let [tx, ty, tz] = self.translation;
        [dot(row_x, place) + tx, dot(row_y, place) + ty, dot(row_z, place) + tz]
    }

    /// From the dense frame to the sparse one.
    #[inline(always)]
    pub fn back(&self, [x, y, z]: &[f32; 3]) -> [f32; 3] {
        let [tx, ty, tz] = self.translation;
        let (x, y, z) = (x - tx, y - ty, z - tz);
        let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = self.rotation;
        [xx * x + yx * y + zx * z, xy * x + yy * y + zy * z, xz * x + yz * y + zz * z]
    }
}

/// What each part of a score counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weights {
    /// Of [`Parts::facing`].
    pub facing: f64,
    /// Of [`Parts::support`].
    pub support: f64,
    /// Of [`Parts::hidden`].
    pub hidden: f64,
    /// Of [`Parts::front`], taken off.
    pub front: f64,
    /// Of [`Parts::sky`], taken off.
    pub sky: f64,
    /// Of [`Parts::seen_support`].
    pub seen_support: f64,
    /// Of [`Parts::seen_hidden`].
    pub seen_hidden: f64,
    /// Of [`Parts::seen_front`], taken off.
    pub seen_front: f64,
    /// Of [`Parts::seen_sky`], taken off.
    pub seen_sky: f64,
    /// Of [`Parts::seen_sky_averted`], taken off.
    pub seen_sky_averted: f64,
}

impl Weights {
    /// Conditional logit on simulated pairs, rounded (method.md §3.4b). Of the two the better one, also where the misses
    /// are known: only it knows that a hidden point is explained.
    pub const HIDDEN_EXPLAINED: Self = Self {
        facing: 0.15,
        support: 0.85,
        hidden: 0.7,
        front: 1.0,
        sky: 0.4,
        seen_support: 0.35,
        seen_hidden: 0.4,
        seen_front: 1.0,
        seen_sky: 0.8,
        seen_sky_averted: 0.25,
    };
    /// The same with violations twice as heavy: at the right pose hardly a point floats where the other sensor saw through
    /// (in 300 simulated pairs 1 to 5 % of all parts together), at a half turn of a box several times as many do.
    pub const SIGHTS_STRICT: Self =
        Self { front: 2.0, sky: 1.0, seen_front: 2.0, seen_sky: 1.4, seen_sky_averted: 0.5, ..Self::HIDDEN_EXPLAINED };
    /// support − violation₁ + 0.7 (support₂ − violation₂): for images with their misses (method.md §3.4).
    pub const VIOLATIONS: Self = Self {
        facing: 0.0,
        support: 1.0,
        hidden: 0.0,
        front: 1.0,
        sky: 1.0,
        seen_support: 0.7,
        seen_hidden: 0.0,
        seen_front: 0.7,
        seen_sky: 0.7,
        seen_sky_averted: 0.7,
    };
    /// Points on the surface and nothing else: where lines of sight shall not count.
    pub const SUPPORT: Self = Self {
        facing: 0.15,
        support: 0.85,
        hidden: 0.0,
        front: 0.0,
        sky: 0.0,
        seen_support: 0.0,
        seen_hidden: 0.0,
        seen_front: 0.0,
        seen_sky: 0.0,
        seen_sky_averted: 0.0,
    };
}

/// What a score consists of, each 0..=1.
///
/// The first five are means over the sparse points, the `seen_` ones over those dense points of which the sparse sensor
/// knows something.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Parts {
    /// On the dense surface, on a side that faces the sparse sensor.
    pub facing: f64,
    /// On the dense surface.
    pub support: f64,
    /// Behind it as the dense sensor sees it.
    pub hidden: f64,
    /// In front of it: the dense sensor would have seen them.
    pub front: f64,
    /// Where the dense sensor saw nothing.
    pub sky: f64,
    /// Where the sparse sensor saw a surface at that range, facing it.
    pub seen_support: f64,
    /// Behind what the sparse sensor saw.
    pub seen_hidden: f64,
    /// In front of it.
    pub seen_front: f64,
    /// Where the sparse sensor saw nothing, on surfaces that face it.
    pub seen_sky: f64,
    /// The same on surfaces that are averted or nearly edge-on.
    pub seen_sky_averted: f64,
    /// The share of the dense points of which the sparse sensor knows something.
    pub seen: f64,
}

impl Parts {
    /// The weighted sum. What is hidden counts as long as something is supported: two clouds back to back hide each other
    /// and explain nothing.
    pub fn score(&self, w: &Weights) -> f64 {
        let hidden = self.hidden.min(HIDDEN_BESIDE * self.support);
        let seen_hidden = self.seen_hidden.min(HIDDEN_BESIDE * self.seen_support);
        let first = w.facing * self.facing + w.support * self.support + w.hidden * hidden
            - w.front * self.front
            - w.sky * self.sky;
        let second = w.seen_support * self.seen_support + w.seen_hidden * seen_hidden
            - w.seen_front * self.seen_front
            - w.seen_sky * self.seen_sky
            - w.seen_sky_averted * self.seen_sky_averted;
        first + second
    }

    /// The shares of points in front of what the other sensor saw there, both sides together: of all that contradicts a
    /// pose the surest, for nothing that fails to return light looks like it.
    pub fn in_front(&self) -> f64 {
        self.front + self.seen_front
    }

    /// The shares of points that float where the other sensor saw through, both sides together. Averted surfaces return
    /// little light and are half believed.
    pub fn violated(&self) -> f64 {
        self.front + self.sky + self.seen_front + self.seen_sky + 0.5 * self.seen_sky_averted
    }
}

/// A dense point and its normal.
#[derive(Clone, Copy, Debug)]
struct Probe {
    place: [f32; 3],
    normal: [f32; 3],
}

/// Scores poses of a sparse cloud on a dense surface.
#[derive(Clone, Debug)]
pub struct Scorer<'a> {
    surface: &'a Surface,
    dense_sights: Option<FreeSpace>,
    sparse_sights: Option<FreeSpace>,
    sparse_viewpoint: Option<[f32; 3]>,
    probes: Vec<Probe>,
    weights: Weights,
}

impl<'a> Scorer<'a> {
    /// For a dense cloud with its surface and a sparse cloud. A cloud without a viewpoint has no sights: its side of the
    /// score is then 0.
    pub fn new(surface: &'a Surface, dense: &Cloud, sparse: &Cloud, weights: Weights) -> Self {
        let sparse_sights = FreeSpace::build(sparse, sparse_spacing(sparse));
        let probe = |index: u32| {
            let point = surface.points().get(index as usize)?;
            let patch = surface.patches().get(index as usize)?;
            Some(Probe { place: point.coords.into(), normal: patch.n })
        };
        // Nobody asks them where the sparse sensor's sights are not known.
        let count = if sparse_sights.is_some() { PROBES } else { 0 };
        Self {
            surface,
            dense_sights: FreeSpace::build(dense, surface.spacing_m()),
            sparse_sights,
            sparse_viewpoint: sparse.viewpoint.map(|viewpoint| viewpoint.coords.into()),
            probes: farthest_points(surface.points(), count).into_iter().filter_map(probe).collect(),
            weights,
        }
    }

    /// The score of a pose for sparse points (in the sparse cloud's frame) and the first `probes` of the dense ones
    /// (spread evenly; [`PROBES`] at most). 0 for a pose that is not a number.
    pub fn score(&self, pose: &Placement, sparse: &[Point3<f32>], probes: usize) -> f64 {
        self.parts(pose, sparse, probes).score(&self.weights)
    }

    /// What the score of a pose consists of.
    pub fn parts(&self, pose: &Placement, sparse: &[Point3<f32>], probes: usize) -> Parts {
        let sparse_sensor = self.sparse_viewpoint.map(|viewpoint| pose.forth(&viewpoint));
        let mut parts = self.of_sparse(pose, sparse, sparse_sensor);
        self.add_dense(&mut parts, pose, sparse_sensor, probes);
        parts
    }

    /// The dense sensor's sights.
    pub fn dense_sights(&self) -> Option<&FreeSpace> {
        self.dense_sights.as_ref()
    }

    /// The sparse sensor's sights.
    pub fn sparse_sights(&self) -> Option<&FreeSpace> {
        self.sparse_sights.as_ref()
    }

    /// What the parts count.
    pub fn weights(&self) -> &Weights {
        &self.weights
    }

    /// The sparse points on the dense surface and in the dense sensor's sights.
    fn of_sparse(&self, pose: &Placement, sparse: &[Point3<f32>], sensor: Option<[f32; 3]>) -> Parts {
        let [mut facing, mut support, mut hidden, mut front, mut sky] = [0.0f64; 5];
        let mut places = [[0.0; 3]; BLOCK];
        let mut unsupported = [0.0; BLOCK];
        let mut sightings = [Sighting::UNKNOWN; BLOCK];
        for points in sparse.chunks(BLOCK) {
            for ((point, place), unsupported) in points.iter().zip(&mut places).zip(&mut unsupported) {
                *place = pose.forth(&point.coords.into());
                let (supported, is_facing) = self.support(place, sensor);
                support += f64::from(supported);
                facing += f64::from(if is_facing { supported } else { 0.0 });
                *unsupported = 1.0 - supported;
            }
            if let Some(sights) = &self.dense_sights {
                sights.look_at(places.get(..points.len()).unwrap_or_default(), &mut sightings);
                for ((_, sighting), unsupported) in points.iter().zip(&sightings).zip(&unsupported) {
                    hidden += f64::from(unsupported * sighting.hidden);
                    front += f64::from(unsupported * sighting.front);
                    sky += f64::from(unsupported * sighting.sky);
                }
            }
        }
        let share = 1.0 / sparse.len().max(1) as f64;
        let [facing, support, hidden, front, sky] = [facing, support, hidden, front, sky].map(|sum| sum * share);
        Parts { facing, support, hidden, front, sky, ..Parts::default() }
    }

    /// How much a place lies on the surface, and whether that faces the sparse sensor (nobody knows where it is: it does).
    #[inline(always)]
    fn support(&self, place: &[f32; 3], sensor: Option<[f32; 3]>) -> (f32, bool) {
        let Some(patch) = self.surface.look(place) else { return (0.0, false) };
        let offset = patch.offset(place);
        let height = patch.height(&offset);
        let is_facing = sensor.is_none_or(|sensor| {
            let sight = patch.offset(&sensor);
            exceeds(dot(&sight, &patch.n), dot(&sight, &sight), FACING)
        });
        let supported = bell(height * height * (0.5 / (SIGMA_M * SIGMA_M)));
        // Near or far is chance: a value not wanted is quicker than a wrong guess.
        (if dot(&offset, &offset) < REACH_M * REACH_M { supported } else { 0.0 }, is_facing)
    }

    /// The dense points in the sparse sensor's sights.
    fn add_dense(&self, parts: &mut Parts, pose: &Placement, sensor: Option<[f32; 3]>, probes: usize) {
        let (Some(sights), Some([sx, sy, sz])) = (&self.sparse_sights, sensor) else { return };
        let [mut support, mut hidden, mut front, mut sky, mut averted] = [0.0f64; 5];
        let mut known = 0u32;
        let asked = self.probes.get(..probes).unwrap_or(&self.probes);
        let mut places = [[0.0; 3]; BLOCK];
        let mut sightings = [Sighting::UNKNOWN; BLOCK];
        for probes in asked.chunks(BLOCK) {
            for (probe, place) in probes.iter().zip(&mut places) {
                *place = pose.back(&probe.place);
            }
            sights.look_at(places.get(..probes.len()).unwrap_or_default(), &mut sightings);
            // Which way a place goes is chance: sums of zeros are quicker than wrong guesses.
            for (Probe { place: [x, y, z], normal }, sighting) in probes.iter().zip(&sightings) {
                known += u32::from(sighting.known);
                front += f64::from(sighting.front);
                hidden += f64::from(sighting.hidden);
                let to_sensor = [sx - x, sy - y, sz - z];
                let (along, square) = (dot(&to_sensor, normal), dot(&to_sensor, &to_sensor));
                let well = exceeds(along, square, WELL_FACING);
                sky += f64::from(if well { sighting.sky } else { 0.0 });
                averted += f64::from(if well { 0.0 } else { sighting.sky });
                let is_seen = (sighting.behind_m.abs() < SAME_RANGE_M) & exceeds(along, square, FACING);
                support += f64::from(u8::from(is_seen));
            }
        }
        let share = 1.0 / f64::from(known.max(1));
        parts.seen_support = support * share;
        parts.seen_hidden = hidden * share;
        parts.seen_front = front * share;
        parts.seen_sky = sky * share;
        parts.seen_sky_averted = averted * share;
        parts.seen = f64::from(known) / asked.len().max(1) as f64;
    }
}

/// Only the sights of bare camera points want to know the spacing: everybody else is spared the search.
fn sparse_spacing(sparse: &Cloud) -> f32 {
    match (sparse.sensor, &sparse.view) {
        (SensorKind::Kinect, View::Bare) => spacing_m(&sparse.points),
        _ => 0.0,
    }
}

#[inline(always)]
fn dot([ax, ay, az]: &[f32; 3], [bx, by, bz]: &[f32; 3]) -> f32 {
    ax * bx + ay * by + az * bz
}

/// Whether the cosine between a vector and a unit normal exceeds a limit: from their product and the vector's square.
/// Without a root: squares with their signs keep the order.
#[inline(always)]
fn exceeds(along: f32, square: f32, limit: f32) -> bool {
    along * along.abs() > limit * limit.abs() * square
}

/// exp(−x) for x ≥ 0 with an absolute error of at most [`BELL_ERROR`].
#[inline(always)]
fn bell(x: f32) -> f32 {
    // Beyond, the value is below the error.
    let x = if x < 16.0 { x } else { 16.0 };
    // The 32nd power of exp(−x/32), whose series is cut after the fourth power.
    let y = x * (1.0 / 32.0);
    let root = 1.0 - y * (1.0 - y * (0.5 - y * (1.0 / 6.0 - y * (1.0 / 24.0))));
    let two = root * root;
    let four = two * two;
    let eight = four * four;
    let sixteen = eight * eight;
    sixteen * sixteen
}

#[cfg(test)]
mod tests;

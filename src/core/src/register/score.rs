//! How well a pose explains what both sensors saw (method.md §3.4, §3.4b): points on the other's surface speak for it,
//! points where the other sensor saw through speak against it, and points it could not see are explained as well.

use super::cloud::{Cloud, SensorKind, View};
use super::freespace::FreeSpace;
use crate::surface::four::dot;
use crate::surface::{Surface, farthest_points, spacing_m};
use nalgebra::{Isometry3, Point3};
use wide::f32x4;

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

/// Points that are asked together.
const BLOCK: usize = 4;
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
    fn forth(&self, places: &[f32x4; 3]) -> [f32x4; 3] {
        let [tx, ty, tz] = self.translation.map(f32x4::splat);
        let [x, y, z] = self.rotation.map(|row| dot(&row.map(f32x4::splat), places));
        [x + tx, y + ty, z + tz]
    }

    /// From the dense frame to the sparse one.
    #[inline(always)]
    fn back(&self, [x, y, z]: &[f32x4; 3]) -> [f32x4; 3] {
        let [tx, ty, tz] = self.translation.map(f32x4::splat);
        let place = [*x - tx, *y - ty, *z - tz];
        let [[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]] = self.rotation.map(|row| row.map(f32x4::splat));
        [dot(&[xx, yx, zx], &place), dot(&[xy, yy, zy], &place), dot(&[xz, yz, zz], &place)]
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
        self.in_front() + self.sky + self.seen_sky + 0.5 * self.seen_sky_averted
    }
}

/// Four points, column by column; the last block's lanes without a point are left out by the mask.
#[inline(always)]
fn columns(points: &[Point3<f32>]) -> ([f32x4; 3], f32x4) {
    let mut four = [Point3::origin(); BLOCK];
    let mut is_point = [0.0; BLOCK];
    for ((to, is_point), point) in four.iter_mut().zip(&mut is_point).zip(points) {
        (*to, *is_point) = (*point, 1.0);
    }
    let [a, b, c, d] = four;
    let columns = [[a.x, b.x, c.x, d.x], [a.y, b.y, c.y, d.y], [a.z, b.z, c.z, d.z]].map(f32x4::new);
    (columns, f32x4::new(is_point).simd_gt(f32x4::ZERO))
}

/// Four dense points and their normals.
#[derive(Clone, Copy, Debug)]
struct Probes {
    places: [f32x4; 3],
    normals: [f32x4; 3],
    is_probe: f32x4,
}

/// Scores poses of a sparse cloud on a dense surface.
#[derive(Clone, Debug)]
pub struct Scorer<'a> {
    surface: &'a Surface,
    dense_sights: Option<FreeSpace>,
    sparse_sights: Option<FreeSpace>,
    sparse_viewpoint: Option<[f32; 3]>,
    probes: Vec<Probes>,
    probe_count: usize,
    weights: Weights,
}

impl<'a> Scorer<'a> {
    /// For a dense cloud with its surface and a sparse cloud. A cloud without a viewpoint has no sights: its side of the
    /// score is then 0.
    pub fn new(surface: &'a Surface, dense: &Cloud, sparse: &Cloud, weights: Weights) -> Self {
        let sparse_sights = FreeSpace::build(sparse, sparse_spacing(sparse));
        // Nobody asks them where the sparse sensor's sights are not known.
        let count = if sparse_sights.is_some() { PROBES } else { 0 };
        let chosen = farthest_points(surface.points(), count);
        let probes = |indices: &[u32]| {
            let place = |index: &u32| surface.points().get(*index as usize).copied();
            let normal = |index: &u32| surface.patches().get(*index as usize).map(|patch| Point3::from(patch.n));
            let (places, is_probe) = columns(&indices.iter().filter_map(place).collect::<Vec<_>>());
            let (normals, _) = columns(&indices.iter().filter_map(normal).collect::<Vec<_>>());
            Probes { places, normals, is_probe }
        };
        Self {
            surface,
            dense_sights: FreeSpace::build(dense, surface.spacing_m()),
            sparse_sights,
            sparse_viewpoint: sparse.viewpoint.map(|viewpoint| viewpoint.coords.into()),
            probes: chosen.chunks(BLOCK).map(probes).collect(),
            probe_count: chosen.len(),
            weights,
        }
    }

    /// The score of a pose for sparse points (in the sparse cloud's frame) and the first `probes` of the dense ones
    /// (spread evenly, in whole fours; [`PROBES`] at most). 0 for a pose that is not a number.
    pub fn score(&self, pose: &Placement, sparse: &[Point3<f32>], probes: usize) -> f64 {
        self.parts(pose, sparse, probes).score(&self.weights)
    }

    /// What the score of a pose consists of.
    pub fn parts(&self, pose: &Placement, sparse: &[Point3<f32>], probes: usize) -> Parts {
        let sparse_sensor = self.sparse_viewpoint.map(|viewpoint| pose.forth(&viewpoint.map(f32x4::splat)));
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
    fn of_sparse(&self, pose: &Placement, sparse: &[Point3<f32>], sensor: Option<[f32x4; 3]>) -> Parts {
        let mut sums = [f32x4::ZERO; 5];
        for points in sparse.chunks(BLOCK) {
            let (places, is_point) = columns(points);
            let places = pose.forth(&places);
            let (supported, is_facing) = self.support(&places, sensor.as_ref());
            let supported = supported & is_point;
            let unsupported = (f32x4::ONE - supported) & is_point;
            let (hidden, front, sky) = match &self.dense_sights {
                Some(sights) => {
                    let seen = sights.look_at_four(&places);
                    (unsupported * seen.hidden, unsupported * seen.front, unsupported * seen.sky)
                }
                None => Default::default(),
            };
            for (sum, part) in sums.iter_mut().zip([supported & is_facing, supported, hidden, front, sky]) {
                *sum += part;
            }
        }
        let share = 1.0 / sparse.len().max(1) as f64;
        let [facing, support, hidden, front, sky] = sums.map(|sum| total(sum) * share);
        Parts { facing, support, hidden, front, sky, ..Parts::default() }
    }

    /// How much four places lie on the surface, and a mask of where that faces the sparse sensor (nobody knows where it
    /// is: it does).
    #[inline(always)]
    fn support(&self, places: &[f32x4; 3], sensor: Option<&[f32x4; 3]>) -> (f32x4, f32x4) {
        let patches = self.surface.look_at_four(places);
        let offset = patches.offset(places);
        let square = dot(&offset, &offset);
        let height = dot(&offset, &patches.n) + f32x4::splat(0.5) * patches.a * square;
        let is_facing = sensor.map_or(patches.is_met, |sensor| {
            let sight = patches.offset(sensor);
            exceeds(dot(&sight, &patches.n), dot(&sight, &sight), FACING)
        });
        let supported = bell(height * height * f32x4::splat(0.5 / (SIGMA_M * SIGMA_M)));
        let is_near = patches.is_met & square.simd_lt(f32x4::splat(REACH_M * REACH_M));
        (supported & is_near, is_facing)
    }

    /// The dense points in the sparse sensor's sights.
    fn add_dense(&self, parts: &mut Parts, pose: &Placement, sensor: Option<[f32x4; 3]>, probes: usize) {
        let (Some(sights), Some([sx, sy, sz])) = (&self.sparse_sights, sensor) else { return };
        let mut sums = [f32x4::ZERO; 6];
        let asked = self.probes.get(..probes.div_ceil(BLOCK)).unwrap_or(&self.probes);
        for Probes { places, normals, is_probe } in asked {
            let seen = sights.look_at_four(&pose.back(places));
            let [x, y, z] = *places;
            let to_sensor = [sx - x, sy - y, sz - z];
            let (along, square) = (dot(&to_sensor, normals), dot(&to_sensor, &to_sensor));
            let well = exceeds(along, square, WELL_FACING);
            let is_same = seen.behind_m.abs().simd_lt(f32x4::splat(SAME_RANGE_M));
            let parts = [
                seen.known & f32x4::ONE,
                is_same & exceeds(along, square, FACING) & f32x4::ONE,
                seen.hidden,
                seen.front,
                seen.sky & well,
                well.select(f32x4::ZERO, seen.sky),
            ];
            for (sum, part) in sums.iter_mut().zip(parts) {
                *sum += part & *is_probe;
            }
        }
        let [known, support, hidden, front, sky, averted] = sums.map(total);
        let share = 1.0 / known.max(1.0);
        parts.seen_support = support * share;
        parts.seen_hidden = hidden * share;
        parts.seen_front = front * share;
        parts.seen_sky = sky * share;
        parts.seen_sky_averted = averted * share;
        parts.seen = known / (asked.len() * BLOCK).min(self.probe_count).max(1) as f64;
    }
}

/// The sum of all lanes.
fn total(sum: f32x4) -> f64 {
    let [a, b, c, d] = sum.to_array().map(f64::from);
    (a + b) + (c + d)
}

/// Only the sights of bare camera points want to know the spacing: everybody else is spared the search.
fn sparse_spacing(sparse: &Cloud) -> f32 {
    match (sparse.sensor, &sparse.view) {
        (SensorKind::Kinect, View::Bare) => spacing_m(&sparse.points),
        _ => 0.0,
    }
}

/// A mask: whether the cosine between a vector and a unit normal exceeds a limit, from their product and the vector's
/// square: squares with their signs keep the order.
#[inline(always)]
fn exceeds(along: f32x4, square: f32x4, limit: f32) -> f32x4 {
    (along * along.abs()).simd_gt(f32x4::splat(limit * limit.abs()) * square)
}

/// exp(−x) for x ≥ 0 with an absolute error of at most [`BELL_ERROR`].
#[inline(always)]
fn bell(x: f32x4) -> f32x4 {
    // Beyond, the value is below the error.
    let x = x.fast_min(f32x4::splat(16.0));
    // The 32nd power of exp(−x/32), whose series is cut after the fourth power.
    let [half, third, fourth] = [0.5, 1.0 / 6.0, 1.0 / 24.0].map(f32x4::splat);
    let y = x * f32x4::splat(1.0 / 32.0);
    let root = f32x4::ONE - y * (f32x4::ONE - y * (half - y * (third - y * fourth)));
    let two = root * root;
    let four = two * two;
    let eight = four * four;
    let sixteen = eight * eight;
    sixteen * sixteen
}

#[cfg(test)]
mod tests;

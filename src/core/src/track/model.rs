//! The model of the target that grows while it is tracked: how points are fused into surfels (method.md §7, 3b).

use super::bins::Bins;
use super::surfels::Surfels;
use super::voxels::{self, Voxels};
use crate::surface::least_eigenvector;
use nalgebra::{Point3, Vector3};
use std::collections::VecDeque;
use tumbled_model::RigNs;

/// Surfels at most: 13 mm apart they cover 34 m², more than all sides of a body of 2 m; 18 MB with what belongs to them.
pub const MOST_SURFELS: usize = 200_000;
/// How far from the target's origin the model reaches, m: a body of 5 m, wherever in it the origin is taken.
pub const MODEL_REACH_M: f64 = 4.5;

/// A point moves a surfel that is nearer along the surface than this, m.
const SAME_M: f64 = 0.011;
/// One nearer than this, m, but not so near, is too near to make another; it is dropped.
const APART_M: f64 = 0.013;
/// Off a surfel along its normal a point may be this, m, or this many σ.
const OFF_M: f64 = 0.018;
const OFF_SIGMAS: f64 = 2.5;
/// Facing the same way: the least cosine of the normals. The sides of a panel 15 mm thick are told apart by it.
const SAME_FACING: f64 = 0.5;
/// The farthest gate, m, however noisy the point.
const MOST_OFF_M: f64 = 0.06;
/// Surfels that give a surfel its normal: so near at least and at most, m, the cosine of their normals at least this, so many,
/// of no greater weight each than this, 1/m².
const PATCH_M: (f64, f64) = (0.032, 0.130);
const PATCH_FACING: f64 = 0.35;
const PATCH_LEAST: u32 = 6;
const PATCH_WEIGHT: f64 = 2e5;
/// A patch whose second spread is less than this share of its first is a line, and has no normal.
const LINE: f64 = 0.1;
/// How steep the noise of its surfels may make a patch, rad: where a camera sees the target, and where LiDARs alone do. A wrong
/// normal holds fast what slides along it. A LiDAR's rings stay at their heights while the surface turns under them: measured
/// with a VLP-32C alone at 2.2 m, about an axis tilted by 7°, patches of 32 mm leave the axis 2 to 4.5° upright, and these 0.8
/// to 3°; at 0.010 rad 0.7 to 1.7°, but then a still thing in a real capture slips by 5 cm.
/// A camera's small patches show what is small: with larger ones a body's height is lost where little else shows it.
pub(crate) const CAMERA_SLOPE_RAD: f64 = 0.05;
pub(crate) const LIDAR_SLOPE_RAD: f64 = 0.026;
/// Every normal is made anew once in so many insertions; sooner those of surfels that came in the last ones, and at once those
/// that are new: the normals of single frames are rough.
const RENEWED_IN: usize = 30;
const RENEWED_YOUNG_IN: usize = 6;
const YOUNG: usize = 24;

/// A point as it is inserted, target's frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Observed {
    pub(crate) place: Point3<f64>,
    /// Unit, out of the body.
    pub(crate) normal: Vector3<f64>,
    /// m.
    pub(crate) sigma_m: f64,
}

/// What becomes of a point.
enum Fate {
    Moves(usize),
    Dropped,
    New,
}

/// The surfels, and the memory their growth needs.
#[derive(Clone, Debug, Default)]
pub(crate) struct Model {
    pub(crate) surfels: Surfels,
    insertions: usize,
    refused: u64,
    bins: Bins,
    /// Σ w and Σ w r of this insertion, surfel by surfel.
    moves: Vec<(f64, f64)>,
    fresh: Vec<Observed>,
    /// How many surfels there were before each of the last insertions, the oldest first.
    before: VecDeque<usize>,
}

/// Sums of the points that make one surfel together.
#[derive(Clone, Copy, Default)]
struct Seed {
    weight: f64,
    place: Vector3<f64>,
    normal: Vector3<f64>,
}

impl Model {
    /// One that another session has made.
    pub(super) fn known(surfels: Surfels) -> Self {
        Self { surfels, ..Self::default() }
    }

    /// Points that would have made a surfel too far out or too many.
    pub(super) fn refused(&self) -> u64 {
        self.refused
    }

    /// Insertions so far.
    pub(super) fn insertions(&self) -> usize {
        self.insertions
    }

    /// Takes the points of a frame, of which the noisiest has a σ of `noisiest` m; noise may make a patch as steep as
    /// `slope_rad`. The same points in the same order make the same model.
    pub(crate) fn insert(&mut self, points: impl Iterator<Item = Observed>, noisiest: f64, slope_rad: f64, t: RigNs) {
        self.bins.fill(places(&self.surfels), reach_m(gate_m(noisiest)));
        self.moves.clear();
        self.moves.resize(self.surfels.len(), (0.0, 0.0));
        self.fresh.clear();
        for point in points {
            match self.fate(&point) {
                Fate::Moves(surfel) => self.pull(surfel, &point),
                Fate::Dropped => {}
                Fate::New => self.fresh.push(point),
            }
        }
        self.apply(t);
        if self.before.len() == YOUNG {
            self.before.pop_front();
        }
        self.before.push_back(self.surfels.len());
        self.add(t);
        self.insertions += 1;
        self.renew(slope_rad);
    }

    /// The surfel that each of a frame's points is part of, as it is now; of which the noisiest has a σ of `noisiest` m.
    pub(crate) fn homes(
        &mut self,
        points: impl Iterator<Item = Observed>,
        noisiest: f64,
    ) -> impl Iterator<Item = Option<u32>> {
        self.bins.fill(places(&self.surfels), reach_m(gate_m(noisiest)));
        points.map(|point| self.nearest(&point).map(|(_, surfel)| surfel as u32))
    }

    /// What becomes of a point, by the surfel nearest to it.
    fn fate(&self, point: &Observed) -> Fate {
        match self.nearest(point) {
            None => Fate::New,
            Some((aside, surfel)) if aside < SAME_M * SAME_M => Fate::Moves(surfel),
            Some(_) => Fate::Dropped,
        }
    }

    /// Of the surfels that face as a point does and are near enough along the normal the one nearest along the surface, if it
    /// is too near for another: its squared distance along the surface, m², and its number.
    fn nearest(&self, point: &Observed) -> Option<(f64, usize)> {
        let gate = gate_m(point.sigma_m);
        let reach = reach_m(gate);
        let mut best = (APART_M * APART_M, usize::MAX);
        self.bins.within(place(&point.place), reach * reach, |surfel| {
            let columns = (self.surfels.positions.get(surfel), self.surfels.normals.get(surfel));
            let (Some(position), Some(normal)) = columns else { return };
            if normal.dot(&point.normal) < SAME_FACING {
                return;
            }
            let offset = point.place - position;
            let along = offset.dot(normal);
            let aside = offset.norm_squared() - along * along;
            if along.abs() < gate && (aside, surfel) < best {
                best = (aside, surfel);
            }
        });
        (best.1 != usize::MAX).then_some(best)
    }

    fn pull(&mut self, surfel: usize, point: &Observed) {
        let columns =
            (self.surfels.positions.get(surfel), self.surfels.normals.get(surfel), self.moves.get_mut(surfel));
        if let (Some(position), Some(normal), Some((weight, pull))) = columns {
            let w = 1.0 / (point.sigma_m * point.sigma_m);
            *weight += w;
            *pull += w * (point.place - position).dot(normal);
        }
    }

    /// Moves surfels along their normals to the mean of all that was measured of them.
    fn apply(&mut self, t: RigNs) {
        let Surfels { positions, normals, weights, last_seen } = &mut self.surfels;
        let rows = positions.iter_mut().zip(normals).zip(weights).zip(last_seen).zip(&self.moves);
        for ((((position, normal), held), seen), (weight, pull)) in rows {
            if *weight > 0.0 {
                *held += weight;
                *position += *normal * (pull / *held);
                *seen = t;
            }
        }
    }

    /// One surfel for the new points of each voxel and facing.
    fn add(&mut self, t: RigNs) {
        let mut voxels = Voxels::with_capacity(self.fresh.len());
        let mut seeds: Vec<Seed> = Vec::new();
        for Observed { place, normal, sigma_m } in &self.fresh {
            let Some(number) = voxels.number(voxels::key(place, APART_M, facing(normal))) else { continue };
            if number == seeds.len() {
                seeds.push(Seed::default());
            }
            if let Some(seed) = seeds.get_mut(number) {
                let weight = 1.0 / (sigma_m * sigma_m);
                seed.weight += weight;
                seed.place += place.coords * weight;
                seed.normal += normal * weight;
            }
        }
        for seed in seeds {
            let place = seed.place / seed.weight;
            let Some(normal) = seed.normal.try_normalize(1e-9) else { continue };
            // Not so for what is no number either.
            let is_near = place.norm() <= MODEL_REACH_M;
            if !is_near || self.surfels.len() >= MOST_SURFELS {
                self.refused += 1;
                continue;
            }
            self.surfels.positions.push(place.into());
            self.surfels.normals.push(normal);
            self.surfels.weights.push(seed.weight);
            self.surfels.last_seen.push(t);
        }
    }

    /// Makes normals anew from where the surfels lie now: those of new surfels, and another share of the others at every
    /// insertion.
    fn renew(&mut self, slope_rad: f64) {
        let young = self.before.front().copied().unwrap_or_default();
        let new = self.before.back().copied().unwrap_or_default();
        let old = (self.insertions % RENEWED_IN..young).step_by(RENEWED_IN);
        let rough = (young + self.insertions % RENEWED_YOUNG_IN..new).step_by(RENEWED_YOUNG_IN);
        let due = old.chain(rough).chain(new..self.surfels.len());
        let reach = |surfel| self.surfels.weights.get(surfel).map_or(0.0, |weight| patch_m(*weight, slope_rad));
        let farthest = due.clone().map(reach).fold(PATCH_M.0, f64::max);
        self.bins.fill(places(&self.surfels), farthest as f32);
        for surfel in due {
            if let Some(normal) = self.patch_normal(surfel, slope_rad)
                && let Some(to) = self.surfels.normals.get_mut(surfel)
            {
                *to = normal;
            }
        }
    }

    /// The normal of the surfels around one that face as it does. `None`: too few, or all along a line.
    fn patch_normal(&self, surfel: usize, slope_rad: f64) -> Option<Vector3<f64>> {
        let (middle, own) = (self.surfels.positions.get(surfel)?, self.surfels.normals.get(surfel)?);
        let reach = patch_m(*self.surfels.weights.get(surfel)?, slope_rad) as f32;
        let (mut count, mut weight, mut sum, mut square) = (0, 0.0, Vector3::zeros(), [0.0; 6]);
        self.bins.within(place(middle), reach * reach, |other| {
            let columns =
                (self.surfels.positions.get(other), self.surfels.normals.get(other), self.surfels.weights.get(other));
            let (Some(position), Some(normal), Some(held)) = columns else { return };
            if normal.dot(own) <= PATCH_FACING {
                return;
            }
            let (offset, w) = (position - middle, held.min(PATCH_WEIGHT));
            count += 1;
            weight += w;
            sum += offset * w;
            let [x, y, z] = offset.into();
            for (entry, term) in square.iter_mut().zip([x * x, x * y, x * z, y * y, y * z, z * z]) {
                *entry += term * w;
            }
        });
        if count < PATCH_LEAST {
            return None;
        }
        let [x, y, z] = (sum / weight).into();
        for (entry, mean) in square.iter_mut().zip([x * x, x * y, x * z, y * y, y * z, z * z]) {
            *entry = *entry / weight - mean;
        }
        let ([_, second, first], normal) = least_eigenvector(square);
        if second < LINE * first {
            return None;
        }
        Some(if normal.dot(own) < 0.0 { -normal } else { normal })
    }
}

/// How large a patch gives a surfel of a weight its normal, m. A disc of radius r holds π r²/d² surfels d apart, and their noise
/// σ makes it steep by 2 σ d/(√π r²), which is to be `slope_rad`.
fn patch_m(weight: f64, slope_rad: f64) -> f64 {
    let square = 2.0 / libm::sqrt(core::f64::consts::PI * weight) * APART_M / slope_rad;
    libm::sqrt(square).clamp(PATCH_M.0, PATCH_M.1)
}

/// How far off a surfel a point of a σ may be, m.
fn gate_m(sigma_m: f64) -> f64 {
    OFF_M.max(OFF_SIGMAS * sigma_m).min(MOST_OFF_M)
}

/// How far a surfel can be from a point within its gate, m.
fn reach_m(gate: f64) -> f32 {
    (gate * gate + APART_M * APART_M).sqrt() as f32
}

/// Which of the six axis directions a normal is nearest to, 0..6; of equals the first.
fn facing(normal: &Vector3<f64>) -> u8 {
    let [x, y, z] = [normal.x.abs(), normal.y.abs(), normal.z.abs()];
    let (axis, along) = match (x >= y && x >= z, y >= z) {
        (true, _) => (0, normal.x),
        (false, true) => (1, normal.y),
        _ => (2, normal.z),
    };
    2 * axis + u8::from(along > 0.0)
}

fn places(surfels: &Surfels) -> impl Iterator<Item = [f32; 3]> + Clone {
    surfels.positions.iter().map(place)
}

fn place(point: &Point3<f64>) -> [f32; 3] {
    point.coords.cast::<f32>().into()
}

#[cfg(test)]
mod tests;

//! Planes grown from the flattest points on, and merged (method.md §6).

use super::fuse::steady;
use super::moments::{Fitted, Moments};
use super::plane::FoundPlane;
use super::raster::Raster;
use super::{FusedPoint, ReconSettings};
use crate::neighbours::KdTree;
use nalgebra::{Point3, Vector3};
use std::collections::VecDeque;

/// Neighbours that a plane grows over and that tell how flat a place is: so many spacings away.
const STEP: f64 = 1.8;
const FLATNESS: f64 = 2.8;
/// A seed is at least so flat, by c_p.
const LEAST_PLANARITY: f64 = 0.45;
/// A point is taken within so many σ, its normal within so great a cosine.
const SIGMAS: f64 = 2.5;
const SAME_NORMAL: f64 = 0.85;
/// A plane is fitted again when its points have grown by this.
const REFIT: f64 = 1.5;
/// Rounds of the robust fit at the end.
const ROUNDS: usize = 5;
/// Planes within 5° whose points are on the average within 1.5 σ of each other are one.
const MERGED_COSINE: f64 = 0.996_194_698;
const MERGED_SIGMAS: f64 = 1.5;
/// A cell of a plane's raster, in spacings.
const CELL: f64 = 0.7;
/// Planes at most.
const MOST_PLANES: usize = 256;
/// Errors of points near each other are alike: as many points as there are in this many count as one for a plane's covariance.
const ALIKE: f64 = 4.0;
/// Across a plane its points' normals do not turn by more than this from one end to the other, r.m.s., rad: 7°. A cylinder's strip
/// that is as flat as the noise allows turns by more.
const CURVED_RAD: f64 = 0.12;

struct Cloud<'a> {
    points: &'a [FusedPoint],
    variances: Vec<f64>,
    starts: Vec<usize>,
    near: Vec<u32>,
}

impl Cloud<'_> {
    fn point(&self, number: u32) -> Option<(&FusedPoint, f64)> {
        Some((self.points.get(number as usize)?, *self.variances.get(number as usize)?))
    }

    fn near(&self, number: u32) -> &[u32] {
        let at = number as usize;
        match (self.starts.get(at), self.starts.get(at + 1)) {
            (Some(from), Some(to)) => self.near.get(*from..*to).unwrap_or_default(),
            _ => &[],
        }
    }
}

/// A plane while it is being grown.
#[derive(Clone, Copy)]
struct Guess {
    normal: Vector3<f64>,
    height: f64,
}

impl Guess {
    fn of(fitted: &Fitted, facing: &Vector3<f64>) -> Self {
        let normal = if fitted.normal.dot(facing) < 0.0 { -fitted.normal } else { fitted.normal };
        Self { normal, height: normal.dot(&fitted.centroid.coords) }
    }

    fn off(&self, place: &Point3<f64>) -> f64 {
        self.normal.dot(&place.coords) - self.height
    }

    fn takes(&self, point: &FusedPoint, variance: f64) -> bool {
        let off = self.off(&point.place);
        off * off < SIGMAS * SIGMAS * variance && self.normal.dot(&point.normal) > SAME_NORMAL
    }
}

/// The planes of points with a spacing, the one with the most points first.
pub(super) fn planes(
    points: &[FusedPoint],
    tree: &KdTree,
    spacing_m: f64,
    settings: &ReconSettings,
) -> Vec<FoundPlane> {
    let slow = settings.slow_sigma_m * settings.slow_sigma_m;
    let variances: Vec<f64> = points.iter().map(|point| point.sigma_m * point.sigma_m + slow).collect();
    let mut cloud = Cloud { points, variances, starts: vec![0], near: Vec::new() };
    let mut seeds: Vec<(f64, u32, Guess)> = Vec::new();
    for (point, number) in points.iter().zip(0u32..) {
        let reach = (FLATNESS * spacing_m) as f32;
        let step = (STEP * spacing_m) as f32;
        let mut around = Moments::about(&point.place);
        let mut found: Vec<(u32, f32)> = Vec::new();
        tree.within(&point.place.cast(), reach * reach, |other, squared| found.push((other, squared)));
        found.sort_unstable_by_key(|(other, _)| *other);
        let mut noise = 0.0;
        for (other, squared) in found {
            let Some((neighbour, variance)) = cloud.point(other) else { continue };
            if neighbour.normal.dot(&point.normal) <= super::SAME_FACING {
                continue;
            }
            around.add(&neighbour.place, 1.0 / variance);
            noise += variance;
            if squared <= step * step && other != number {
                cloud.near.push(other);
            }
        }
        cloud.starts.push(cloud.near.len());
        if around.count >= 8
            && let Some(fitted) = around.plane(noise / around.count as f64)
            && fitted.planarity >= LEAST_PLANARITY
        {
            seeds.push((fitted.planarity, number, Guess::of(&fitted, &point.normal)));
        }
    }
    seeds.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut taken = vec![false; points.len()];
    let mut grown: Vec<Vec<u32>> = Vec::new();
    for (_, seed, guess) in &seeds {
        if grown.len() >= MOST_PLANES {
            break;
        }
        if taken.get(*seed as usize).copied().unwrap_or(true) {
            continue;
        }
        let Some(members) = grow(&cloud, *seed, *guess, &taken, settings.least_points) else { continue };
        members.iter().for_each(|member| mark(&mut taken, *member, true));
        grown.push(members);
    }
    merge(&cloud, &mut grown);
    let mut planes: Vec<FoundPlane> =
        grown.into_iter().filter_map(|members| found(&cloud, members, spacing_m)).collect();
    planes.sort_by(|a, b| b.members.len().cmp(&a.members.len()).then(a.members.cmp(&b.members)));
    planes
}

fn mark(taken: &mut [bool], number: u32, value: bool) {
    if let Some(taken) = taken.get_mut(number as usize) {
        *taken = value;
    }
}

/// Breadth-first from a seed, then once more from there with the plane that was found: what was refused while it was still
/// known badly has its second chance.
fn grow(cloud: &Cloud<'_>, seed: u32, guess: Guess, taken: &[bool], least: usize) -> Option<Vec<u32>> {
    let (mut members, mut guess) = spread(cloud, seed, guess, taken, true);
    for _ in 0..2 {
        if members.len() < least / 2 {
            return None;
        }
        guess = robust(cloud, &members, guess)?;
        (members, guess) = spread(cloud, seed, guess, taken, false);
    }
    (members.len() >= least && !is_curved(cloud, &members)).then_some(members)
}

fn spread(cloud: &Cloud<'_>, seed: u32, guess: Guess, taken: &[bool], refits: bool) -> (Vec<u32>, Guess) {
    let mut guess = guess;
    let mut met: Vec<bool> = taken.to_vec();
    let mut members = vec![seed];
    let mut waiting = VecDeque::from([seed]);
    mark(&mut met, seed, true);
    let Some((first, variance)) = cloud.point(seed) else { return (Vec::new(), guess) };
    let mut moments = Moments::about(&first.place);
    moments.add(&first.place, 1.0 / variance);
    let mut fitted_at = 12.0;
    while let Some(number) = waiting.pop_front() {
        for other in cloud.near(number) {
            let Some((point, variance)) = cloud.point(*other) else { continue };
            if met.get(*other as usize).copied().unwrap_or(true) || !guess.takes(point, variance) {
                continue;
            }
            mark(&mut met, *other, true);
            members.push(*other);
            waiting.push_back(*other);
            moments.add(&point.place, 1.0 / variance);
            if refits && moments.count as f64 >= fitted_at {
                fitted_at = moments.count as f64 * REFIT;
                if let Some(fitted) = moments.plane(0.0) {
                    guess = Guess::of(&fitted, &guess.normal);
                }
            }
        }
    }
    members.sort_unstable();
    (members, guess)
}

/// Weighted least squares in which far points lose their say.
fn robust(cloud: &Cloud<'_>, members: &[u32], guess: Guess) -> Option<Guess> {
    let mut guess = guess;
    for _ in 0..ROUNDS {
        guess = Guess::of(&weighted(cloud, members, &guess)?.plane(0.0)?, &guess.normal);
    }
    Some(guess)
}

fn weighted(cloud: &Cloud<'_>, members: &[u32], guess: &Guess) -> Option<Moments> {
    let mut moments = Moments::about(&cloud.point(*members.first()?)?.0.place);
    for (point, variance) in members.iter().filter_map(|member| cloud.point(*member)) {
        let off = guess.off(&point.place);
        let robust = 1.0 / (1.0 + off * off / (4.0 * variance));
        moments.add(&point.place, robust * robust / variance);
    }
    Some(moments)
}

/// Whether normals turn along with the place: regressed on the places in the two tangent directions.
fn is_curved(cloud: &Cloud<'_>, members: &[u32]) -> bool {
    let all: Vec<&FusedPoint> = members.iter().filter_map(|member| Some(cloud.point(*member)?.0)).collect();
    let Some(first) = all.first() else { return true };
    let mut moments = Moments::about(&first.place);
    all.iter().for_each(|point| moments.add(&point.place, 1.0));
    let Some(fitted) = moments.plane(0.0) else { return true };
    moments.tangents(&fitted.normal).iter().any(|(axis, scatter)| {
        let count = all.len() as f64;
        let mean = all.iter().map(|point| point.normal.dot(axis)).sum::<f64>() / count;
        let together = all.iter().map(|point| {
            let along = (point.place - fitted.centroid).dot(axis);
            along * (point.normal.dot(axis) - mean)
        });
        let slope = together.sum::<f64>() / (count * scatter.max(1e-9));
        (slope * libm::sqrt(*scatter)).abs() > CURVED_RAD
    })
}

/// Joins planes that are one, the largest first.
fn merge(cloud: &Cloud<'_>, grown: &mut Vec<Vec<u32>>) {
    grown.sort_by(|a, b| b.len().cmp(&a.len()).then(a.cmp(b)));
    let mut kept: Vec<(Vec<u32>, Guess)> = Vec::new();
    for members in grown.drain(..) {
        let Some(guess) = fitted(cloud, &members) else { continue };
        let same = kept.iter_mut().find(|(others, other)| {
            // Never across opposite facing: the cosine has a sign.
            other.normal.dot(&guess.normal) > MERGED_COSINE
                && lies_on(cloud, &members, other)
                && lies_on(cloud, others, &guess)
        });
        match same {
            Some((others, other)) => {
                others.extend(&members);
                others.sort_unstable();
                *other = robust(cloud, others, *other).unwrap_or(*other);
            }
            None => kept.push((members, guess)),
        }
    }
    grown.extend(kept.into_iter().map(|(members, _)| members));
}

fn fitted(cloud: &Cloud<'_>, members: &[u32]) -> Option<Guess> {
    let first = cloud.point(*members.first()?)?.0;
    let mut moments = Moments::about(&first.place);
    for (point, variance) in members.iter().filter_map(|member| cloud.point(*member)) {
        moments.add(&point.place, 1.0 / variance);
    }
    robust(cloud, members, Guess::of(&moments.plane(0.0)?, &first.normal))
}

/// Whether points lie on a plane on the average.
fn lies_on(cloud: &Cloud<'_>, members: &[u32], guess: &Guess) -> bool {
    let (mut off, mut sigma) = (0.0, 0.0);
    for (point, variance) in members.iter().filter_map(|member| cloud.point(*member)) {
        off += guess.off(&point.place).abs();
        sigma += libm::sqrt(variance);
    }
    off < MERGED_SIGMAS * sigma
}

/// A plane with its covariance: σ² / N of the height, σ² / (N λ_k) of the tilt along each tangent.
fn found(cloud: &Cloud<'_>, members: Vec<u32>, spacing_m: f64) -> Option<FoundPlane> {
    let guess = fitted(cloud, &members)?;
    let moments = weighted(cloud, &members, &guess)?;
    let plane = moments.plane(0.0)?;
    let [(first, along), (second, across)] = moments.tangents(&guess.normal);
    let all = || members.iter().filter_map(|member| cloud.point(*member));
    let count = members.len() as f64;
    let square = all().map(|(point, _)| guess.off(&point.place) * guess.off(&point.place)).sum::<f64>() / count;
    let stated = all().map(|(_, variance)| variance).sum::<f64>() / count;
    let independent = (count / ALIKE).max(1.0);
    let variance = square.max(stated) / independent;
    let mut made = FoundPlane {
        normal: guess.normal,
        height_m: guess.height,
        centroid: plane.centroid,
        tangents: [first, second],
        height_sigma_m: libm::sqrt(variance),
        tilt_sigma_rad: [along, across].map(|scatter| libm::sqrt(variance / scatter.max(1e-9))),
        rms_m: libm::sqrt(square),
        area_m2: 0.0,
        members: Vec::new(),
        raster: Raster::default(),
    };
    let flat: Vec<_> = steady(cloud.points, &members).map(|point| made.in_plane(&point.place)).collect();
    made.raster = Raster::of(&flat, CELL * spacing_m);
    made.area_m2 = made.raster.occupied() as f64 * made.raster.cell_m() * made.raster.cell_m();
    made.members = members;
    Some(made)
}

//! Which feature sphere belongs to which sample.

use super::descriptor::{Describer, Feature};
use super::options::{Candidate, Neighbourhood, PaperOptions, ShellTolerance, Weighting};
use super::sample::farthest_points;
use crate::cga::PointPair;
use crate::register::baseline::prepare::Prepared;
use nalgebra::{Isometry3, Point3};

/// Pairs of a sample and the centre of a feature sphere.
#[derive(Debug, Default)]
pub(super) struct Pairs {
    /// `point`: the sample; `center`: the sphere's centre, in its own cloud's frame.
    pub(super) pairs: Vec<PointPair>,
    /// T, m.
    pub(super) tolerance_m: f64,
    /// Mean reach of the spheres' neighbourhoods, m.
    pub(super) reach_m: f64,
}

/// What has been found out about a point of the sphere cloud.
#[derive(Clone, Copy)]
enum Known {
    NotYet,
    TooFewNeighbours,
    Described(Feature),
}

/// Matches samples of one cloud with feature spheres of the other.
pub(super) struct Matcher<'a> {
    options: &'a PaperOptions,
    samples_of: &'a Prepared,
    spheres_of: &'a Prepared,
    /// Farthest point samples with their features, in the order they were drawn; samples without one are left out.
    samples: Vec<(Point3<f64>, Feature)>,
    describer: Describer<'a>,
    features: Vec<Known>,
    /// (distance from the centroid, index) of the sphere cloud's points, rising.
    shells: Vec<(f32, u32)>,
    tolerance_m: f64,
}

impl<'a> Matcher<'a> {
    pub(super) fn new(samples_of: &'a Prepared, spheres_of: &'a Prepared, options: &'a PaperOptions) -> Self {
        let chosen = farthest_points(samples_of.points(), options.samples, &samples_of.centroid());
        let mut describer = Describer::new(samples_of, options);
        let samples =
            chosen.into_iter().filter_map(|index| Some((samples_of.point(index)?, describer.feature(index)?)));
        let samples = samples.collect();
        let center = spheres_of.centroid();
        let from_center = |point: &Point3<f32>| (point.cast::<f64>() - center).norm() as f32;
        let mut shells: Vec<(f32, u32)> = spheres_of.points().iter().map(from_center).zip(0..).collect();
        shells.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let tolerance_m = match options.tolerance {
            ShellTolerance::MeanSpacing { times } => times * spheres_of.mean_spacing_m(),
            ShellTolerance::Metres(length) => length,
        };
        let features = vec![Known::NotYet; spheres_of.points().len()];
        let describer = Describer::new(spheres_of, options);
        Self { options, samples_of, spheres_of, samples, describer, features, shells, tolerance_m }
    }

    /// The published matching: candidates are the points whose distance from their centroid is the sample's from its own.
    pub(super) fn by_shells(&mut self) -> Pairs {
        let samples = core::mem::take(&mut self.samples);
        let mut pairs = Pairs { tolerance_m: self.tolerance_m, ..Pairs::default() };
        for (point, feature) in &samples {
            if pairs.pairs.len() >= self.options.pairs {
                break;
            }
            let distance = (point - self.samples_of.centroid()).norm();
            let (low, high) = ((distance - self.tolerance_m) as f32, (distance + self.tolerance_m) as f32);
            let first = self.shells.partition_point(|shell| shell.0 <= low);
            let last = self.shells.partition_point(|shell| shell.0 < high).max(first);
            let mut best = Best::default();
            for place in first..last {
                let Some(&(shell, index)) = self.shells.get(place) else { break };
                self.offer(&mut best, feature, index, (f64::from(shell) - distance).abs());
            }
            self.take(&mut pairs, point, &best);
        }
        self.samples = samples;
        pairs
    }

    /// Ours, for further rounds: candidates are the points near the sample under a pose (sphere cloud → sample cloud).
    pub(super) fn by_place(&mut self, pose: &Isometry3<f64>) -> Pairs {
        let samples = core::mem::take(&mut self.samples);
        let mut pairs = Pairs { tolerance_m: self.tolerance_m, ..Pairs::default() };
        let back = pose.inverse();
        let mut near = Vec::new();
        for (point, feature) in &samples {
            if pairs.pairs.len() >= self.options.pairs {
                break;
            }
            let reach = match self.options.neighbourhood {
                Neighbourhood::Ball { radius_m } => radius_m,
                Neighbourhood::Nearest { .. } => feature.reach_m,
            };
            near.clear();
            let query: Point3<f32> = (back * point).cast();
            self.spheres_of.tree().within(&query, (reach * reach) as f32, |index, squared| near.push((squared, index)));
            let mut best = Best::default();
            for &(squared, index) in &near {
                self.offer(&mut best, feature, index, f64::from(squared).sqrt());
            }
            self.take(&mut pairs, point, &best);
        }
        self.samples = samples;
        pairs
    }

    /// A candidate: taken if it passes the gate and is better than the best so far; of equals the lowest index.
    fn offer(&mut self, best: &mut Best, sample: &Feature, index: u32, away: f64) {
        let Some(feature) = self.feature(index) else { return };
        let difference = sample.difference(&feature);
        // A descriptor that is no number fails the gate.
        if difference.is_nan() || difference >= self.options.epsilon {
            return;
        }
        let rank = match self.options.candidate {
            Candidate::NearestDescriptor => difference,
            Candidate::NearestShell => away,
        };
        let better = best.chosen.is_none_or(|_| rank < best.rank || (rank == best.rank && index < best.index));
        if better {
            *best = Best { rank, index, chosen: Some(feature) };
        }
    }

    /// A point's feature, found when it is first asked for.
    fn feature(&mut self, index: u32) -> Option<Feature> {
        let known = self.features.get_mut(index as usize)?;
        if matches!(known, Known::NotYet) {
            *known = self.describer.feature(index).map_or(Known::TooFewNeighbours, Known::Described);
        }
        match known {
            Known::Described(feature) => Some(*feature),
            _ => None,
        }
    }

    fn take(&self, pairs: &mut Pairs, point: &Point3<f64>, best: &Best) {
        let Some(feature) = best.chosen else { return };
        let weight = match self.options.weighting {
            Weighting::Equal => 1.0,
            Weighting::Radius => {
                let noise = self.spheres_of.noise_m(&feature.center);
                1.0 / (noise * noise + feature.radius_m * feature.radius_m)
            }
        };
        let before = pairs.pairs.len() as f64;
        pairs.reach_m = (pairs.reach_m * before + feature.reach_m) / (before + 1.0);
        pairs.pairs.push(PointPair { point: *point, center: feature.center, weight });
    }
}

/// The best candidate so far.
#[derive(Default)]
struct Best {
    rank: f64,
    index: u32,
    chosen: Option<Feature>,
}

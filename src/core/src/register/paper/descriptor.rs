//! The descriptor of a point: numbers of its feature sphere that no rigid motion changes.

use super::options::{Entries, Neighbourhood, PaperOptions, SphereReading};
use crate::cga::{MomentSphere, fit_sphere};
use crate::neighbours::Neighbours;
use crate::register::baseline::prepare::{Moments, Prepared};
use nalgebra::{Point3, Vector3};

/// A fitted sphere of so many neighbourhood radii is flat.
const FLAT: f64 = 10.0;

/// The feature sphere of a point's neighbourhood, and the point's descriptor.
#[derive(Clone, Copy, Debug)]
pub(super) struct Feature {
    /// The sphere's centre, m.
    pub(super) center: Point3<f64>,
    /// Its radius, m.
    pub(super) radius_m: f64,
    /// ρ: how far the neighbourhood reaches, m.
    pub(super) reach_m: f64,
    /// `(σ/ρ, P·S/ρ², |n·r̂|, c_l, c_p)`; entries that are off are 0.
    entries: [f64; 5],
}

impl Feature {
    /// The largest difference of any entry.
    pub(super) fn difference(&self, other: &Self) -> f64 {
        self.entries.iter().zip(&other.entries).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }
}

/// Makes features of a cloud's points.
pub(super) struct Describer<'a> {
    cloud: &'a Prepared,
    options: &'a PaperOptions,
    scratch: Neighbours,
    members: Vec<Point3<f64>>,
}

impl<'a> Describer<'a> {
    pub(super) fn new(cloud: &'a Prepared, options: &'a PaperOptions) -> Self {
        Self { cloud, options, scratch: Neighbours::default(), members: Vec::new() }
    }

    /// The feature of a point. `None`: fewer than five neighbours.
    pub(super) fn feature(&mut self, index: u32) -> Option<Feature> {
        let point = self.cloud.points().get(index as usize)?;
        let (moments, reach_m) = match self.options.neighbourhood {
            Neighbourhood::Ball { radius_m } => (self.cloud.ball_moments(point, radius_m)?, radius_m),
            Neighbourhood::Nearest { count } => {
                let moments = self.cloud.nearest_moments(point, count, &mut self.scratch)?;
                (moments, moments.reach_m)
            }
        };
        let at: Point3<f64> = point.cast();
        let (center, radius_m, shape) = self.sphere(&at, &moments, reach_m);
        let ray = (at - self.cloud.centroid()).try_normalize(0.0).unwrap_or_else(Vector3::zeros);
        let [linear, planar] = moments.shape();
        let [size, product] = shape;
        let entries = pick(&self.options.entries, [size, product, moments.normal.dot(&ray).abs(), linear, planar]);
        Some(Feature { center, radius_m, reach_m, entries })
    }

    /// Centre and radius of the feature sphere, and its two entries.
    fn sphere(&mut self, at: &Point3<f64>, moments: &Moments, reach_m: f64) -> (Point3<f64>, f64, [f64; 2]) {
        let moment = MomentSphere { center: moments.mean, radius: moments.radius_m() };
        let by_moments = [moment.radius / reach_m, moment.product(at) / (reach_m * reach_m)];
        if self.options.sphere == SphereReading::Moment {
            return (moment.center, moment.radius, by_moments);
        }
        self.gather(&at.cast(), moments, reach_m);
        let Ok(fitted) = fit_sphere(self.members.iter().map(|member| (*member, 1.0))) else {
            // On a line: no sphere, but still a neighbourhood.
            return (moment.center, moment.radius, [0.0, 0.0]);
        };
        let surface = fitted.surface;
        let entries = [reach_m * surface.curvature.abs(), surface.product(at).abs() / reach_m];
        match surface.sphere().filter(|_| surface.curvature.abs() * reach_m * FLAT > 1.0) {
            Some(sphere) => (sphere.center(), sphere.squared_radius().max(0.0).sqrt(), entries),
            None => (moment.center, moment.radius, entries),
        }
    }

    /// The neighbourhood's points.
    fn gather(&mut self, at: &Point3<f32>, moments: &Moments, reach_m: f64) {
        self.members.clear();
        let points = self.cloud.points();
        let member = |index: u32| points.get(index as usize).map(|point| point.cast());
        match self.options.neighbourhood {
            Neighbourhood::Ball { .. } => {
                let members = &mut self.members;
                let square = (reach_m * reach_m) as f32;
                self.cloud.tree().within(at, square, |index, _| members.extend(member(index)));
            }
            Neighbourhood::Nearest { .. } => {
                self.cloud.tree().knn(at, moments.count, &mut self.scratch);
                self.members.extend(self.scratch.iter().filter_map(|(index, _)| member(index)));
            }
        }
    }
}

fn pick(on: &Entries, values: [f64; 5]) -> [f64; 5] {
    let flags = [on.radius, on.product, on.ray, on.linear, on.planar];
    let mut picked = [0.0; 5];
    for ((to, value), flag) in picked.iter_mut().zip(values).zip(flags) {
        *to = if flag { value } else { 0.0 };
    }
    picked
}

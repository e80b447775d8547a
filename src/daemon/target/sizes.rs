//! How large a model is.

use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::track::Surfels;

/// A model's extent in its own frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Sizes {
    /// The least coordinates, m.
    pub least_m: [f64; 3],
    /// The largest, m.
    pub most_m: [f64; 3],
    /// The farthest point from the origin, m.
    pub radius_m: f64,
    /// How far the surface is closed, 0 to 1: the normals of a closed surface cancel each other, so this is 1 less the length of
    /// their mean. One flat side alone has 0, a box without its floor 0.8.
    pub closed: f64,
    /// One standard deviation of the points along their normals, the median, m.
    pub sigma_m: f64,
}

impl Sizes {
    /// Of a model that is not empty.
    pub fn of(surfels: &Surfels) -> Self {
        let places = surfels.positions();
        let bound = |pick: fn(f64, f64) -> f64, from: f64| {
            places.iter().fold(Point3::new(from, from, from), |so_far, place| {
                Point3::from(so_far.coords.zip_map(&place.coords, pick))
            })
        };
        let radius_m = places.iter().map(|place| place.coords.norm()).fold(0.0, f64::max);
        let mut variances: Vec<f64> = surfels.weights().iter().map(|weight| 1.0 / weight).collect();
        variances.sort_by(f64::total_cmp);
        let sigma_m = variances.get(variances.len() / 2).map_or(0.0, |variance| variance.sqrt());
        let sum: Vector3<f64> = surfels.normals().iter().sum();
        Self {
            least_m: bound(f64::min, f64::INFINITY).into(),
            most_m: bound(f64::max, f64::NEG_INFINITY).into(),
            radius_m,
            closed: 1.0 - sum.norm() / places.len().max(1) as f64,
            sigma_m,
        }
    }
}

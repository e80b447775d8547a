//! What a sensor says of a place: a surface was seen there, it lies in front of one or behind one, the sensor saw
//! through it, or nobody knows (method.md §3.4, §3.4b).
//!
//! * with the misses: [`depth`] (a depth image), [`ranges`] (a LiDAR's range image);
//! * from bare points: [`camera`] and [`lidar`], over a raster of what lies around each direction; a missing return
//!   says something exactly where the density of the returns around it says that one was due ([`rings`]);
//! * [`angle`]: arcs, quick; all of them answer four places at once.

pub mod angle;
pub mod camera;
pub mod depth;
pub mod lidar;
pub mod ranges;
mod raster;
pub mod rings;

pub use camera::CameraMask;
pub use depth::DepthMask;
pub use lidar::LidarMask;
pub use ranges::RangeMask;

use super::cloud::{Cloud, SensorKind, View};
use nalgebra::{Point3, Vector3};
use wide::f32x4;

/// What a sensor says of a place. The shares are graded, 0..=1, so that a score has no steps; at most one is above 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sighting {
    /// Whether the sensor would have seen a surface there: otherwise the place tells nothing, and the shares are 0.
    pub known: bool,
    /// The place lies before what was seen in its direction: it would have been seen instead.
    pub front: f32,
    /// It lies behind: it could not be seen.
    pub hidden: f32,
    /// The sensor saw nothing in its direction though it looked: nothing is there.
    pub sky: f32,
    /// By how much the place is farther away than what was seen nearest to its direction, m; infinite: nothing was.
    pub behind_m: f32,
}

impl Sighting {
    /// Nothing is known of the place.
    pub const UNKNOWN: Self = Self { known: false, front: 0.0, hidden: 0.0, sky: 0.0, behind_m: f32::INFINITY };
}

/// What it says of four places.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sightings {
    /// A mask.
    pub(crate) known: f32x4,
    pub(crate) front: f32x4,
    pub(crate) hidden: f32x4,
    pub(crate) sky: f32x4,
    pub(crate) behind_m: f32x4,
}

impl Sightings {
    /// Of an image with its misses, where it was looked at (a mask): how far the places are, the least depth or range
    /// around each (infinite: nothing came back; not a number: not known) and that of its own ray, m; and how much sky
    /// counts where nothing came back.
    #[inline(always)]
    pub(crate) fn of_image(in_view: f32x4, [place, least, middle]: [f32x4; 3], depths: Depths, sky: f32x4) -> Self {
        let infinity = f32x4::splat(f32::INFINITY);
        let known = in_view & least.simd_eq(least);
        let (is_sky, is_seen) = (known & least.simd_eq(infinity), known & least.simd_lt(infinity));
        Self {
            known,
            front: is_seen & depths.share(least - place),
            hidden: is_seen & depths.share(place - least),
            sky: is_sky & sky,
            behind_m: (is_seen & middle.simd_lt(infinity)).select(place - middle, infinity),
        }
    }

    /// Of the first place.
    fn first(&self) -> Sighting {
        let first = |numbers: f32x4| {
            let [number, ..] = numbers.to_array();
            number
        };
        Sighting {
            known: self.known.to_bitmask() & 1 == 1,
            front: first(self.front),
            hidden: first(self.hidden),
            sky: first(self.sky),
            behind_m: first(self.behind_m),
        }
    }
}

/// How far before or behind a seen surface a place begins to count, m, and how steeply the count rises to 1: over 4 cm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Depths {
    pub(crate) from_m: f32,
    /// One over the length of the rise, 1/m.
    pub(crate) per_m: f32,
}

impl Depths {
    /// Of a camera's (method.md §3.4b).
    pub(crate) const CAMERA: Self = Self { from_m: 0.05, per_m: 25.0 };
    /// Of a LiDAR's: its ranges scatter more.
    pub(crate) const LIDAR: Self = Self { from_m: 0.06, per_m: 25.0 };

    /// The shares of distances beyond a surface.
    #[inline(always)]
    pub(crate) fn share(self, beyond_m: f32x4) -> f32x4 {
        graded((beyond_m - f32x4::splat(self.from_m)) * f32x4::splat(self.per_m))
    }
}

/// ⟨a⟩: clamped to 0..=1; not a number is 0.
#[inline(always)]
pub(crate) fn graded(a: f32x4) -> f32x4 {
    let a = a & a.simd_gt(f32x4::ZERO);
    a.simd_lt(f32x4::ONE).select(a, f32x4::ONE)
}

/// The free space of one sensor. Places are in the frame of the sensor's cloud.
#[derive(Clone, Debug)]
pub struct FreeSpace {
    viewpoint: [f32; 3],
    mask: Mask,
}

#[derive(Clone, Debug)]
enum Mask {
    Camera(CameraMask),
    Lidar(LidarMask),
    Depth(DepthMask),
    Ranges(RangeMask),
}

impl FreeSpace {
    /// From a cloud and its spacing (m). `None`: nobody knows where the sensor stood, there are no points, or the image
    /// does not have the size it says; then lines of sight tell nothing.
    pub fn build(cloud: &Cloud, spacing_m: f32) -> Option<Self> {
        let viewpoint = cloud.viewpoint?;
        let seen = |point: &Point3<f32>| {
            let ray = point - viewpoint;
            // Closer than that no sensor measures, and it has no direction.
            (ray.norm_squared() > LEAST_RANGE_M * LEAST_RANGE_M && ray.norm_squared() < f32::INFINITY).then_some(ray)
        };
        let rays = || cloud.points.iter().filter_map(seen).collect::<Vec<Vector3<f32>>>();
        let mask = match (&cloud.view, cloud.sensor) {
            (View::Depth(view), _) => Mask::Depth(DepthMask::build(view)?),
            (View::Ranges(view), _) => Mask::Ranges(RangeMask::build(view)?),
            (View::Bare, SensorKind::Kinect) => Mask::Camera(CameraMask::build(&rays(), spacing_m)?),
            (View::Bare, SensorKind::Lidar) => Mask::Lidar(LidarMask::build(&rays())?),
        };
        Some(Self { viewpoint: viewpoint.coords.into(), mask })
    }

    /// What the sensor says of a place in its cloud's frame, m.
    pub fn look(&self, place: &[f32; 3]) -> Sighting {
        self.look_at_four(&place.map(f32x4::splat)).first()
    }

    /// What it says of four places.
    #[inline]
    pub(crate) fn look_at_four(&self, [x, y, z]: &[f32x4; 3]) -> Sightings {
        let [vx, vy, vz] = self.viewpoint.map(f32x4::splat);
        let rays = [*x - vx, *y - vy, *z - vz];
        match &self.mask {
            Mask::Camera(mask) => mask.look_at_four(rays),
            Mask::Lidar(mask) => mask.look_at_four(rays),
            Mask::Depth(mask) => mask.look_at_four(rays),
            Mask::Ranges(mask) => mask.look_at_four(rays),
        }
    }

    /// Where the sensor stood, in its cloud's frame, m.
    #[inline]
    pub fn viewpoint(&self) -> [f32; 3] {
        self.viewpoint
    }

    /// The rings that a LiDAR's points lie on: its image's, or found from bare points. `None`: it is none, or has no rings.
    pub fn rings(&self) -> Option<&rings::Rings> {
        match &self.mask {
            Mask::Lidar(mask) => mask.rings(),
            Mask::Ranges(mask) => Some(mask.rings()),
            _ => None,
        }
    }
}

/// Nearer than this nothing is measured, m.
const LEAST_RANGE_M: f32 = 0.05;

#[cfg(test)]
pub(crate) mod caster;
#[cfg(test)]
mod tests;

//! One patch of a surface.

use super::local::Local;
use super::noise::INDEPENDENT;
use nalgebra::{Point3, Vector3};

/// An anchored unit sphere, small enough for two to share a cache line: anchor, curvature, normal, noise.
///
/// `f(x) = n·v + ½ a |v|²` with v = x − p is 0 on it and positive on the side the normal points to; its gradient is
/// g = n + a v with |g|² = 1 + 2 a f (method.md §1). a = 0 is the plane.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C, align(32))]
pub struct Patch {
    /// The anchor: the cloud's point, laid onto the fitted sphere along the normal, m.
    pub p: [f32; 3],
    /// Curvature, 1/m: positive is convex (the centre is behind the surface), 0 flat.
    pub a: f32,
    /// Unit normal at the anchor, towards the viewpoint.
    pub n: [f32; 3],
    /// Standard deviation of the patch along its normal, m: noise left after averaging, and roughness.
    pub sigma: f32,
}

impl Patch {
    /// Of a surface without points.
    pub(crate) const NOWHERE: Self = Self { p: [0.0; 3], a: 0.0, n: [0.0; 3], sigma: 0.0 };

    /// From the anchor to a place.
    #[inline]
    pub fn offset(&self, [x, y, z]: &[f32; 3]) -> [f32; 3] {
        let [px, py, pz] = self.p;
        [x - px, y - py, z - pz]
    }

    /// f of a place by its offset from the anchor, m: to first order the signed distance from the surface.
    #[inline]
    pub fn height(&self, [vx, vy, vz]: &[f32; 3]) -> f32 {
        let [nx, ny, nz] = self.n;
        nx * vx + ny * vy + nz * vz + 0.5 * self.a * (vx * vx + vy * vy + vz * vz)
    }
}

/// How a neighbourhood is spread out: shares that sum to 1 (method.md §6). All 0: noise explains the spread, or nothing
/// is spread.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Shape {
    /// (λ₁ − λ₂)/Σλ: along a line.
    pub linear: f64,
    /// 2(λ₂ − λ₃)/Σλ: over a plane.
    pub planar: f64,
    /// 3λ₃/Σλ: in all directions.
    pub spherical: f64,
}

impl Shape {
    /// From the eigenvalues of a covariance, rising, m², of which noise of a variance (m²) is taken off.
    pub fn of([l3, l2, l1]: [f64; 3], noise: f64) -> Self {
        let [l1, l2, l3] = [l1, l2, l3].map(|l| (l - noise).max(0.0));
        let sum = l1 + l2 + l3;
        if sum <= 1e-18 {
            return Self::default();
        }
        Self { linear: (l1 - l2) / sum, planar: 2.0 * (l2 - l3) / sum, spherical: 3.0 * l3 / sum }
    }
}

/// All that is known of a patch, in full accuracy.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detail {
    /// Mean of the neighbourhood, m.
    pub mean: Point3<f64>,
    /// The anchor of [`Patch`], m.
    pub anchor: Point3<f64>,
    /// Unit normal at the anchor.
    pub normal: Vector3<f64>,
    /// Curvature, 1/m, as in [`Patch`]: at most 8 in size, 0 where it does not stand out from noise.
    pub curvature: f64,
    /// Standard deviation of the cloud's single point along its sight, m.
    pub sigma_m: f64,
    /// Root mean square of the neighbours' distances from the fit beyond what noise explains, m.
    pub roughness_m: f64,
    /// Eigenvalues of the neighbourhood's covariance, rising, m².
    pub eigenvalues: [f64; 3],
    /// How the neighbourhood is spread out, noise taken off.
    pub shape: Shape,
    /// Points of the neighbourhood.
    pub members: u32,
}

impl Detail {
    /// Of a point nobody has looked at.
    pub(crate) const NONE: Self = Self {
        mean: Point3::new(0.0, 0.0, 0.0),
        anchor: Point3::new(0.0, 0.0, 0.0),
        normal: Vector3::new(0.0, 0.0, 1.0),
        curvature: 0.0,
        sigma_m: 0.0,
        roughness_m: 0.0,
        eigenvalues: [0.0; 3],
        shape: Shape { linear: 0.0, planar: 0.0, spherical: 0.0 },
        members: 0,
    };

    pub(crate) fn new(point: &Point3<f32>, local: &Local, sigma_m: f32) -> Self {
        let point = point.cast::<f64>();
        let variance = f64::from(sigma_m) * f64::from(sigma_m);
        // The point itself is the origin of the local fit: v = −(its foot's offset).
        let (n, a) = (local.normal, local.curvature);
        let v = -local.foot;
        let f = n.dot(&v) + 0.5 * a * v.norm_squared();
        let anchor = -n * f;
        let gradient = n + (anchor - local.foot) * a;
        Self {
            mean: point + local.mean,
            anchor: point + anchor,
            normal: gradient.try_normalize(1e-9).unwrap_or(n),
            curvature: a,
            sigma_m: f64::from(sigma_m),
            roughness_m: (local.residual - variance).max(0.0).sqrt(),
            eigenvalues: local.eigenvalues,
            shape: Shape::of(local.eigenvalues, variance),
            members: local.members,
        }
    }

    /// Variance of the patch along its normal, m²: noise left after averaging, and roughness.
    pub fn variance(&self) -> f64 {
        let averaged = self.sigma_m * self.sigma_m / f64::from(self.members).clamp(1.0, INDEPENDENT);
        averaged + self.roughness_m * self.roughness_m
    }

    /// The same in 32 bytes.
    pub fn patch(&self) -> Patch {
        Patch {
            p: self.anchor.coords.cast::<f32>().into(),
            a: self.curvature as f32,
            n: self.normal.cast::<f32>().into(),
            sigma: self.variance().sqrt() as f32,
        }
    }

    /// Turns the normal over: what was in front is behind, what was convex concave.
    pub(crate) fn turn(&mut self) {
        self.normal = -self.normal;
        self.curvature = -self.curvature;
    }
}

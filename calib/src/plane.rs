//! Planes: `n·p = d`, the normal away from the sensor.

use nalgebra::{Matrix3, Matrix4, Point3, SymmetricEigen, Vector3, Vector4};

use crate::view::Ranged;

/// A residual is divided by the cosine between ray and normal, no smaller than this: a grazing ray says nothing of a plane.
const LEAST_COSINE: f64 = 0.2;

/// A plane `n·p = d`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// n, length 1.
    pub normal: Vector3<f64>,
    /// d, m; not below 0: the normal points away from the origin.
    pub distance_m: f64,
}

impl Plane {
    /// The plane with this normal through a point; the normal's sign is chosen.
    pub fn through(point: &Point3<f64>, normal: Vector3<f64>) -> Self {
        let distance_m = normal.dot(&point.coords);
        if distance_m < 0.0 { Self { normal: -normal, distance_m: -distance_m } } else { Self { normal, distance_m } }
    }

    /// The plane with the least squared distances of points; `None`: fewer than three, or on a line.
    pub fn fit(points: impl Iterator<Item = Point3<f64>> + Clone) -> Option<Self> {
        let count = points.clone().count();
        if count < 3 {
            return None;
        }
        let mean = points.clone().fold(Vector3::zeros(), |sum, p| sum + p.coords) / count as f64;
        let scatter = points.fold(Matrix3::zeros(), |sum, p| {
            let way = p.coords - mean;
            sum + way * way.transpose()
        });
        let eigen = SymmetricEigen::new(scatter);
        let (least, _) = eigen.eigenvalues.argmin();
        let mut sizes: [f64; 3] = eigen.eigenvalues.into();
        sizes.sort_by(f64::total_cmp);
        let [_, second, largest] = sizes;
        let spread = largest > 0.0 && second > 1e-9 * largest;
        spread.then(|| Self::through(&Point3::from(mean), eigen.eigenvectors.column(least).into()))
    }

    /// How far a point is behind it, m.
    pub fn beyond_m(&self, point: &Point3<f64>) -> f64 {
        self.normal.dot(&point.coords) - self.distance_m
    }

    /// `(n, d)`: its product with `(p, −1)` is the distance.
    pub fn vector(&self) -> Vector4<f64> {
        Vector4::new(self.normal.x, self.normal.y, self.normal.z, self.distance_m)
    }

    /// How many standard deviations a measured range is beyond the plane along its own ray. The ray's direction is known,
    /// so its residual is the range's, whatever the plane's tilt.
    pub fn residual(&self, ranged: &Ranged) -> f64 {
        self.beyond_m(&ranged.point) * self.weight_root(ranged)
    }

    /// 1/(σ |cos|): what a distance is multiplied by to be a residual.
    pub fn weight_root(&self, ranged: &Ranged) -> f64 {
        1.0 / (ranged.sigma_m * self.normal.dot(&ranged.ray()).abs().max(LEAST_COSINE))
    }

    /// A measured point with its error turned onto the normal: where its ray truly meets the plane, and as far beyond it as
    /// the point is. Range noise moves a point along its ray, so across an oblique plane too, and in step with its distance
    /// from it: planes fitted to the points as they are tilt toward the sensor, by some tenths of a degree at 20 mm of noise.
    pub fn set_upright(&self, point: &Point3<f64>) -> Point3<f64> {
        let cosine = self.normal.dot(&point.coords) / point.coords.norm().max(f64::MIN_POSITIVE);
        if cosine.abs() < LEAST_COSINE {
            return *point;
        }
        let beyond = self.beyond_m(point);
        point * (self.distance_m / (self.distance_m + beyond)) + self.normal * beyond
    }

    /// The plane of least squared range errors near a start; the start where points fix none.
    pub fn refined(start: Self, points: &[Ranged]) -> Self {
        const ROUNDS: usize = 5;
        let mut plane = start;
        for _ in 0..ROUNDS {
            let Some(next) = Self::fit(points.iter().map(|ranged| plane.set_upright(&ranged.point))) else { break };
            plane = next;
        }
        plane
    }

    /// Two directions across the normal, which with it are right-angled.
    pub fn across(&self) -> [Vector3<f64>; 2] {
        across(&self.normal)
    }
}

/// Two directions that with `normal` (length 1) are right-angled.
pub fn across(normal: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let (least, _) = normal.abs().argmin();
    let helper = Vector3::ith(least, 1.0);
    let first = normal.cross(&helper).normalize();
    [first, normal.cross(&first)]
}

/// `Σ w a aᵀ` with `a = (p, −1)`: everything that squared distances to any plane need of points.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Moments {
    /// The sum.
    pub matrix: Matrix4<f64>,
    /// How many points.
    pub count: usize,
}

impl Moments {
    /// Adds a point.
    pub fn add(&mut self, point: &Point3<f64>, weight: f64) {
        let a = Vector4::new(point.x, point.y, point.z, -1.0);
        self.matrix += a * a.transpose() * weight;
        self.count += 1;
    }

    /// Root mean square and mean distance of unweighted points beyond a plane, m.
    pub fn distances_m(&self, plane: &Plane) -> (f64, f64) {
        let q = plane.vector();
        let product = self.matrix * q;
        let count = self.count.max(1) as f64;
        ((q.dot(&product) / count).max(0.0).sqrt(), -product.w / count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_through_points_points_away_from_the_origin() {
        let points = [[0.0, 0.0, 2.0], [1.0, 0.0, 2.0], [0.0, 1.0, 2.0], [1.0, 1.0, 2.0]].map(Point3::from);
        let plane = Plane::fit(points.iter().copied()).expect("a plane");
        assert!((plane.normal - Vector3::z()).norm() < 1e-12 && (plane.distance_m - 2.0).abs() < 1e-12);
        // A metre behind it; seen at 45° the ray goes on by √2.
        let beyond = Ranged { point: Point3::new(3.0, 0.0, 3.0), sigma_m: 0.1 };
        assert!((plane.beyond_m(&beyond.point) - 1.0).abs() < 1e-12);
        assert!((plane.residual(&beyond) - 2f64.sqrt() / 0.1).abs() < 1e-9);
        assert_eq!(Plane::fit([[0.0; 3], [1.0; 3], [2.0; 3]].map(Point3::from).into_iter()), None);
    }

    #[test]
    fn a_point_set_upright_is_on_its_ray_where_the_plane_is_and_as_far_beyond_it() {
        // The plane z = 2, a ray at 45°, measured a metre too far along z: its foot is (2, 0, 2).
        let plane = Plane { normal: Vector3::z(), distance_m: 2.0 };
        let upright = plane.set_upright(&Point3::new(3.0, 0.0, 3.0));
        assert!((upright - Point3::new(2.0, 0.0, 3.0)).norm() < 1e-12, "{upright}");
    }

    #[test]
    fn range_noise_does_not_tilt_a_refined_plane() {
        // A plane at 45°, x = z - 2, 0.8 m long, each ray measured 20 mm too near and too far.
        let normal = Vector3::new(-1.0, 0.0, 1.0).normalize();
        let truth = Plane { normal, distance_m: 2.0 / 2f64.sqrt() };
        let mut points = Vec::new();
        for n in 0..=20 {
            for y in [-0.3, 0.3] {
                let x = 0.02 * f64::from(n) - 0.2;
                let foot = Vector3::new(x, y, x + 2.0);
                for error in [-0.02, 0.02] {
                    let point = Point3::from(foot * (1.0 + error / foot.norm()));
                    points.push(Ranged { point, sigma_m: 0.02 });
                }
            }
        }
        let plain = Plane::fit(points.iter().map(|ranged| ranged.point)).expect("a plane");
        let refined = Plane::refined(plain, &points);
        let off = |plane: &Plane| plane.normal.angle(&truth.normal).to_degrees();
        assert!(off(&plain) > 0.1 && off(&refined) < 0.01, "{} {}", off(&plain), off(&refined));
    }

    #[test]
    fn moments_give_the_distances_to_any_plane() {
        let mut moments = Moments::default();
        for z in [1.9, 2.2] {
            moments.add(&Point3::new(0.3, -0.4, z), 1.0);
        }
        let (rms, mean) = moments.distances_m(&Plane { normal: Vector3::z(), distance_m: 2.0 });
        // −0.1 and 0.2: mean 0.05, mean square 0.025.
        assert!((mean - 0.05).abs() < 1e-12 && (rms - 0.025f64.sqrt()).abs() < 1e-12);
    }
}

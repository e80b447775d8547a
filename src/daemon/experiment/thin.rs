//! Clouds of as many points as are asked for.

use nalgebra::{Point3, Vector3};
use tumbled_sim::noise::Noise;

/// Edges of voxels that are tried, m.
const EDGES_M: (f64, f64) = (0.001, 0.3);
/// Halvings of their ratio: the edge is then known to 0.04 %.
const HALVINGS: usize = 14;

/// At most `n` points: the means of the points in cubes, of the widest ones that leave so many, and of these some left
/// out at random. Fewer where the cloud has fewer cubes of a millimetre.
pub fn voxelised(points: &[Point3<f32>], n: usize, noise: &mut Noise) -> Vec<Point3<f32>> {
    let (mut fine, mut wide) = EDGES_M;
    for _ in 0..HALVINGS {
        let middle = (fine * wide).sqrt();
        if sorted_cubes(points, middle).chunk_by(|a, b| a.0 == b.0).count() >= n {
            fine = middle
        } else {
            wide = middle
        }
    }
    picked(&voxels(points, fine), n, noise)
}

/// The mean of the points in each cube of an edge, m; cubes in the order of their places.
pub fn voxels(points: &[Point3<f32>], edge_m: f64) -> Vec<Point3<f32>> {
    let mean = |cube: &[([i32; 3], u32)]| {
        let sum: Vector3<f64> =
            cube.iter().filter_map(|(_, n)| points.get(*n as usize)).map(|point| point.coords.cast::<f64>()).sum();
        Point3::from(sum / cube.len() as f64).cast::<f32>()
    };
    sorted_cubes(points, edge_m).chunk_by(|a, b| a.0 == b.0).map(mean).collect()
}

/// Each point's cube and its place in the cloud, in order.
fn sorted_cubes(points: &[Point3<f32>], edge_m: f64) -> Vec<([i32; 3], u32)> {
    let place = |coordinate: f32| (f64::from(coordinate) / edge_m).floor() as i32;
    let cube = |(point, n): (&Point3<f32>, u32)| ([place(point.x), place(point.y), place(point.z)], n);
    let mut cubes: Vec<_> = points.iter().zip(0..).map(cube).collect();
    cubes.sort_unstable();
    cubes
}

/// `n` of the points at random, in their order; all if there are no more.
pub fn picked(points: &[Point3<f32>], n: usize, noise: &mut Noise) -> Vec<Point3<f32>> {
    let mut places: Vec<usize> = (0..points.len()).collect();
    for k in 0..n.min(points.len()) {
        let left = places.len() - k;
        places.swap(k, k + (noise.bits() % left as u64) as usize);
    }
    places.truncate(n);
    places.sort_unstable();
    places.into_iter().filter_map(|place| points.get(place)).copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 60 × 60 points of a square metre.
    fn square() -> Vec<Point3<f32>> {
        (0..3600).map(|n| Point3::new((n % 60) as f32 / 60.0, (n / 60) as f32 / 60.0, 2.0)).collect()
    }

    #[test]
    fn a_cloud_has_as_many_points_as_asked_for_spread_over_all_of_it() {
        let thinned = voxelised(&square(), 900, &mut Noise::new(1, "thin", 0));
        assert_eq!(thinned.len(), 900);
        // Each quarter has a quarter of them, give or take what chance leaves out (less than one in five).
        let quarter = thinned.iter().filter(|point| point.x < 0.5 && point.y < 0.5).count();
        assert!((180..=270).contains(&quarter), "{quarter}");
        assert!(voxelised(&square(), 5000, &mut Noise::new(1, "thin", 0)).len() == 3600);
    }

    #[test]
    fn a_voxel_is_the_mean_of_its_points() {
        let points = [[0.01, 0.01, 0.01], [0.03, 0.01, 0.01], [0.15, 0.0, 0.0]].map(Point3::from);
        let means = voxels(&points, 0.1);
        assert_eq!(means.len(), 2);
        assert!((means[0] - Point3::new(0.02, 0.01, 0.01)).norm() < 1e-7 && means[1] == points[2]);
    }

    #[test]
    fn picked_points_are_different_ones_in_their_order() {
        let points = square();
        let some = picked(&points, 100, &mut Noise::new(3, "pick", 0));
        let places: Vec<usize> =
            some.iter().map(|point| points.iter().position(|other| other == point).expect("one of them")).collect();
        assert!(places.len() == 100 && places.is_sorted_by(|a, b| a < b));
    }
}

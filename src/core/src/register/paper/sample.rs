//! Farthest point sampling from the centroid.

use nalgebra::Point3;

/// Indices of `count` points (or of all, if there are fewer), each the farthest from `start` and those before it: `start`,
/// the centroid, counts as taken, as the text has it. Of equals the one with the lowest index. O(n·count).
pub(super) fn farthest_points(points: &[Point3<f32>], count: usize, start: &Point3<f64>) -> Vec<u32> {
    let start: Point3<f32> = start.cast();
    // Chosen points get −1, and are never the farthest again.
    let mut squared: Vec<f32> = points.iter().map(|point| (point - start).norm_squared()).collect();
    let mut chosen = Vec::with_capacity(count.min(points.len()));
    for _ in 0..count.min(points.len()) {
        let (mut farthest, mut distance) = (0, f32::NEG_INFINITY);
        for (index, &squared) in squared.iter().enumerate() {
            if squared > distance {
                (farthest, distance) = (index, squared);
            }
        }
        let Some(next) = points.get(farthest) else { break };
        chosen.push(farthest as u32);
        for (squared, point) in squared.iter_mut().zip(points) {
            *squared = squared.min((point - next).norm_squared());
        }
        if let Some(own) = squared.get_mut(farthest) {
            *own = -1.0;
        }
    }
    chosen
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_is_the_farthest_from_the_start_and_those_before() {
        // On a line at 0, 1, 2, 3, 10 from 0: 10; then 3, which is 3 from the start and 7 from 10; then 1 and 2, each 1 from
        // what is taken, and 0, where the start is.
        let points = [0.0, 1.0, 2.0, 3.0, 10.0].map(|x| Point3::new(x, 0.0, 0.0));
        assert_eq!(farthest_points(&points, 9, &Point3::origin()), [4, 3, 1, 2, 0]);
        assert_eq!(farthest_points(&points, 2, &Point3::origin()), [4, 3]);
    }

    #[test]
    fn of_equals_the_lowest_index_and_equal_points_all_come() {
        // From (5, 5) the opposite corner, then the near one (8 from it), then both others (4 from either).
        let square = [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].map(|(x, y)| Point3::new(x, y, 0.0));
        assert_eq!(farthest_points(&square, 4, &Point3::new(5.0, 5.0, 0.0)), [3, 0, 1, 2]);
        assert_eq!(farthest_points(&[Point3::origin(); 3], 3, &Point3::origin()), [0, 1, 2]);
    }
}

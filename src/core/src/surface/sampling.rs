//! Points spread evenly over a cloud.

use nalgebra::Point3;

/// Points whose distances are compared in one go.
const CHUNK: usize = 32;

/// Farthest point sampling: first the point farthest from the centroid, then each time the one farthest from all taken
/// so far; of equal distances the lowest index. So the first n of a longer sampling are the sampling of n.
///
/// At most `n` indices, fewer only where there are fewer points. O(n N). The points are finite.
pub fn farthest_points(points: &[Point3<f32>], n: usize) -> Vec<u32> {
    let column = |axis: fn(&Point3<f32>) -> f32| points.iter().map(axis).collect::<Vec<f32>>();
    let (x, y, z) = (column(|p| p.x), column(|p| p.y), column(|p| p.z));
    let sum = points.iter().map(|point| point.coords.cast::<f64>()).sum::<nalgebra::Vector3<f64>>();
    let mut from = Point3::from((sum / points.len().max(1) as f64).cast::<f32>());
    // From the centroid first: its distances choose the first point and count no longer.
    let chunks = points.chunks(CHUNK).map(Chunk::of).collect();
    let mut far = Farthest { x: &x, y: &y, z: &z, squared: vec![f32::INFINITY; points.len()], chunks };
    let mut taken = Vec::with_capacity(n.min(points.len()));
    let mut next = far.update(&from);
    far.squared.fill(f32::INFINITY);
    far.chunks.iter_mut().for_each(|chunk| chunk.most = f32::INFINITY);
    while taken.len() < n.min(points.len()) {
        let Some(&point) = points.get(next) else { break };
        taken.push(next as u32);
        from = point;
        // Taken: nearer than anything, even than points in the same place.
        if let Some(squared) = far.squared.get_mut(next) {
            *squared = -1.0;
        }
        next = far.update(&from);
    }
    taken
}

/// Where the points of a chunk are, and the greatest squared distance among them.
struct Chunk {
    low: Point3<f32>,
    high: Point3<f32>,
    most: f32,
}

impl Chunk {
    fn of(points: &[Point3<f32>]) -> Self {
        let (mut low, mut high) = (Point3::from([f32::INFINITY; 3]), Point3::from([f32::NEG_INFINITY; 3]));
        for point in points {
            (low, high) = (low.inf(point), high.sup(point));
        }
        Self { low, high, most: f32::INFINITY }
    }

    /// Whether a point is so far away that it lowers no distance; a little less for what rounding adds.
    fn is_beyond(&self, from: &Point3<f32>) -> bool {
        let gap = (self.low - from).sup(&(from - self.high)).sup(&nalgebra::Vector3::zeros());
        gap.norm_squared() * (1.0 - 1e-5) > self.most
    }
}

/// Squared distance of every point from the nearest taken.
struct Farthest<'a> {
    x: &'a [f32],
    y: &'a [f32],
    z: &'a [f32],
    squared: Vec<f32>,
    chunks: Vec<Chunk>,
}

impl Farthest<'_> {
    /// Takes a point into account and answers which one is farthest now.
    fn update(&mut self, from: &Point3<f32>) -> usize {
        let mut farthest = (f32::NEG_INFINITY, usize::MAX);
        let columns = self.x.chunks(CHUNK).zip(self.y.chunks(CHUNK)).zip(self.z.chunks(CHUNK));
        let squared = self.squared.chunks_mut(CHUNK).zip(&mut self.chunks);
        for (((squared, chunk), ((x, y), z)), number) in squared.zip(columns).zip(0usize..) {
            if !chunk.is_beyond(from) {
                chunk.most = lower(squared, x, y, z, from);
            }
            if chunk.most > farthest.0 {
                farthest = (chunk.most, number);
            }
        }
        // Of equals the first: an earlier chunk's before a later one's, and the chunk's first.
        let (most, number) = farthest;
        let within = self.squared.chunks(CHUNK).nth(number).and_then(|chunk| chunk.iter().position(|&s| s == most));
        within.map_or(usize::MAX, |within| number * CHUNK + within)
    }
}

/// Lowers squared distances to those from a point where that is nearer; the greatest of them. Four lanes, so that the
/// compiler may keep them in one register: the maximum does not depend on the order.
fn lower(squared: &mut [f32], x: &[f32], y: &[f32], z: &[f32], from: &Point3<f32>) -> f32 {
    for (((squared, x), y), z) in squared.iter_mut().zip(x).zip(y).zip(z) {
        let (dx, dy, dz) = (x - from.x, y - from.y, z - from.z);
        let found = dx * dx + dy * dy + dz * dz;
        *squared = if found < *squared { found } else { *squared };
    }
    let mut most = [f32::NEG_INFINITY; 4];
    let (fours, rest) = squared.as_chunks::<4>();
    for four in fours {
        for (most, &value) in most.iter_mut().zip(four) {
            *most = if value > *most { value } else { *most };
        }
    }
    rest.iter().chain(&most).copied().fold(f32::NEG_INFINITY, f32::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The definition, point by point.
    fn plain(points: &[Point3<f32>], n: usize) -> Vec<u32> {
        let sum = points.iter().map(|p| p.coords.cast::<f64>()).sum::<nalgebra::Vector3<f64>>();
        let middle = Point3::from((sum / points.len().max(1) as f64).cast::<f32>());
        let squared = |a: &Point3<f32>, b: &Point3<f32>| {
            let (dx, dy, dz) = (a.x - b.x, a.y - b.y, a.z - b.z);
            dx * dx + dy * dy + dz * dz
        };
        let mut taken: Vec<u32> = Vec::new();
        while taken.len() < n.min(points.len()) {
            let far = |i: usize| {
                let near =
                    taken.iter().map(|&t| squared(&points[i], &points[t as usize])).fold(f32::INFINITY, f32::min);
                if taken.is_empty() { squared(&points[i], &middle) } else { near }
            };
            let free = (0..points.len()).filter(|i| !taken.contains(&(*i as u32)));
            let best = free.fold(None, |best: Option<(f32, usize)>, i| match best {
                Some((most, _)) if far(i) <= most => best,
                _ => Some((far(i), i)),
            });
            taken.push(best.unwrap().1 as u32);
        }
        taken
    }

    /// How far a point may be from the nearest taken.
    fn covering_radius(points: &[Point3<f32>], taken: &[u32]) -> f32 {
        let near = |p: &Point3<f32>| {
            taken.iter().map(|&t| (p - points[t as usize]).norm_squared()).fold(f32::INFINITY, f32::min)
        };
        points.iter().map(near).fold(0.0, f32::max)
    }

    fn points() -> impl Strategy<Value = Vec<Point3<f32>>> {
        let coordinate = || prop_oneof![(-2i8..3).prop_map(f32::from), -2.0..2.0f32];
        let point = (coordinate(), coordinate(), coordinate()).prop_map(|(x, y, z)| Point3::new(x, y, z));
        proptest::collection::vec(point, 0..150)
    }

    proptest! {
        #[test]
        fn the_sampling_is_the_definition(points in points(), n in 0usize..40) {
            prop_assert_eq!(farthest_points(&points, n), plain(&points, n));
        }

        #[test]
        fn the_covering_radius_falls_with_every_point(points in points()) {
            let taken = farthest_points(&points, 30);
            for n in 1..taken.len() {
                prop_assert!(covering_radius(&points, &taken[..n + 1]) <= covering_radius(&points, &taken[..n]));
            }
        }
    }
}

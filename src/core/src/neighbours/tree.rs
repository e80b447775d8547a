//! A k-d tree over points that do not change.

use super::Neighbours;
use nalgebra::Point3;

/// Points of a leaf: two registers of four lanes a coordinate.
const LEAF: usize = 8;
/// The deepest tree: 2³¹ leaves hold more points than a `u32` counts.
const DEEPEST: usize = 32;

/// Points of one leaf, column by column. Places without a point hold infinity, which is near nothing.
#[derive(Clone, Copy, Debug)]
struct Leaf {
    x: [f32; LEAF],
    y: [f32; LEAF],
    z: [f32; LEAF],
    index: [u32; LEAF],
}

impl Leaf {
    const EMPTY: Self =
        Self { x: [f32::INFINITY; LEAF], y: [f32::INFINITY; LEAF], z: [f32::INFINITY; LEAF], index: [u32::MAX; LEAF] };

    /// Squared distances of all its places.
    fn squared(&self, [qx, qy, qz]: [f32; 3]) -> [f32; LEAF] {
        let mut squared = [0.0; LEAF];
        for (((to, x), y), z) in squared.iter_mut().zip(&self.x).zip(&self.y).zip(&self.z) {
            let (dx, dy, dz) = (x - qx, y - qy, z - qz);
            *to = dx * dx + dy * dy + dz * dz;
        }
        squared
    }
}

/// Where a branch divides its points.
#[derive(Clone, Copy, Debug, Default)]
struct Branch {
    axis: u32,
    at: f32,
}

/// A node still to be visited, and how far its box is at least: per axis, and squared in all.
#[derive(Clone, Copy)]
struct Pending {
    node: usize,
    level: u32,
    squared: f32,
    offset: [f32; 3],
}

/// A balanced k-d tree: branches in the order of a heap, all leaves on one level, so that no node holds an address.
///
/// Building costs O(n log n), a query of the nearest about O(log n); no query allocates. Points that are not finite are
/// left out. Indices are those of the slice it was built from.
#[derive(Clone, Debug)]
pub struct KdTree {
    branches: Vec<Branch>,
    leaves: Vec<Leaf>,
    depth: u32,
    len: usize,
}

impl KdTree {
    /// Of at most `u32::MAX` points; more are left out.
    pub fn build(points: &[Point3<f32>]) -> Self {
        let finite = |point: &Point3<f32>| point.iter().all(|c| c.is_finite());
        let numbered = points.iter().zip(0..u32::MAX).filter(|(point, _)| finite(point));
        let mut order: Vec<([f32; 3], u32)> = numbered.map(|(point, index)| (point.coords.into(), index)).collect();
        let leaves = order.len().div_ceil(LEAF).max(1).next_power_of_two();
        let mut tree = Self {
            branches: vec![Branch::default(); leaves],
            leaves: vec![Leaf::EMPTY; leaves],
            depth: leaves.trailing_zeros(),
            len: order.len(),
        };
        tree.divide(1, 0, &mut order);
        tree
    }

    /// Finite points in the tree.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether it holds none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    fn divide(&mut self, node: usize, level: u32, points: &mut [([f32; 3], u32)]) {
        if level == self.depth {
            // Halves differ by one at most: with 2^depth ≥ n/8 leaves none has more than 8.
            points.sort_unstable_by_key(|(_, index)| *index);
            if let Some(leaf) = self.leaves.get_mut(node - (1 << level)) {
                let places = leaf.x.iter_mut().zip(&mut leaf.y).zip(&mut leaf.z).zip(&mut leaf.index);
                for ((((x, y), z), index), (from, number)) in places.zip(points.iter()) {
                    ([*x, *y, *z], *index) = (*from, *number);
                }
            }
            return;
        }
        let axis = widest(points);
        let along = |(place, _): &([f32; 3], u32)| component(place, axis);
        let half = points.len().div_ceil(2);
        let mut at = 0.0;
        if half < points.len() {
            // By place, then by number: the same tree for the same points.
            let order = |a: &([f32; 3], u32), b: &([f32; 3], u32)| along(a).total_cmp(&along(b)).then(a.1.cmp(&b.1));
            at = along(points.select_nth_unstable_by(half, order).1);
        }
        if let Some(branch) = self.branches.get_mut(node) {
            *branch = Branch { axis, at };
        }
        let (low, high) = points.split_at_mut(half);
        self.divide(2 * node, level + 1, low);
        self.divide(2 * node + 1, level + 1, high);
    }

    /// The nearest point and its squared distance, of those at most `max_sq` (m²) away.
    pub fn nearest(&self, query: &Point3<f32>, max_sq: f32) -> Option<(u32, f32)> {
        let mut best = (u32::MAX, max_sq);
        self.visit(query, max_sq, |leaf, squared| {
            for (&squared, &index) in squared.iter().zip(&leaf.index) {
                if squared < best.1 || (squared == best.1 && index < best.0) {
                    best = (index, squared);
                }
            }
            best.1
        });
        (best.0 != u32::MAX).then_some(best)
    }

    /// The `k` nearest points into `out`, which is emptied before.
    pub fn knn(&self, query: &Point3<f32>, k: usize, out: &mut Neighbours) {
        out.ask(k);
        self.visit(query, out.reach(), |leaf, squared| {
            let mut reach = out.reach();
            for (&squared, &index) in squared.iter().zip(&leaf.index) {
                // Places without a point are at infinity.
                if squared <= reach && squared < f32::INFINITY {
                    out.offer(squared, index);
                    reach = out.reach();
                }
            }
            reach
        });
    }

    /// Calls `found` with each point at most `max_sq` (m²) away and its squared distance, in no particular order (the
    /// same for the same points).
    pub fn within(&self, query: &Point3<f32>, max_sq: f32, mut found: impl FnMut(u32, f32)) {
        self.visit(query, max_sq, |leaf, squared| {
            for (&squared, &index) in squared.iter().zip(&leaf.index) {
                if squared <= max_sq && index != u32::MAX {
                    found(index, squared);
                }
            }
            max_sq
        });
    }

    /// Shows the leaves that may hold a point within reach, near ones first. `look` answers how far (squared) it still
    /// wants to reach.
    fn visit(&self, query: &Point3<f32>, mut reach: f32, mut look: impl FnMut(&Leaf, [f32; LEAF]) -> f32) {
        let query: [f32; 3] = query.coords.into();
        let mut stack = [Pending { node: 1, level: 0, squared: 0.0, offset: [0.0; 3] }; DEEPEST];
        let mut waiting = 1usize;
        while let Some(pending) = waiting.checked_sub(1).and_then(|top| stack.get(top)).copied() {
            waiting -= 1;
            // Also what lies exactly at the reach: it may have a lower index.
            if pending.squared > reach {
                continue;
            }
            let Pending { mut node, level, squared, offset } = pending;
            for level in level..self.depth {
                let Some(branch) = self.branches.get(node) else { return };
                let gap = component(&query, branch.axis) - branch.at;
                let near = 2 * node + usize::from(gap >= 0.0);
                let before = component(&offset, branch.axis);
                let far = squared - before * before + gap * gap;
                // The bound is a sum of rounded squares: a little less is safe.
                if far * (1.0 - 1e-6) <= reach
                    && let Some(place) = stack.get_mut(waiting)
                {
                    let offset = replaced(offset, branch.axis, gap);
                    *place = Pending { node: near ^ 1, level: level + 1, squared: far * (1.0 - 1e-6), offset };
                    waiting += 1;
                }
                node = near;
            }
            if let Some(leaf) = self.leaves.get(node - (1 << self.depth)) {
                reach = look(leaf, leaf.squared(query));
            }
        }
    }
}

fn component(vector: &[f32; 3], axis: u32) -> f32 {
    let [x, y, z] = *vector;
    match axis {
        0 => x,
        1 => y,
        _ => z,
    }
}

fn replaced([x, y, z]: [f32; 3], axis: u32, by: f32) -> [f32; 3] {
    match axis {
        0 => [by, y, z],
        1 => [x, by, z],
        _ => [x, y, by],
    }
}

/// The axis along which the points reach farthest; of equals the first.
fn widest(points: &[([f32; 3], u32)]) -> u32 {
    let mut low = [f32::INFINITY; 3];
    let mut high = [f32::NEG_INFINITY; 3];
    for (point, _) in points {
        for ((low, high), c) in low.iter_mut().zip(&mut high).zip(point) {
            *low = low.min(*c);
            *high = high.max(*c);
        }
    }
    let [x, y, z] = [high[0] - low[0], high[1] - low[1], high[2] - low[2]];
    if x >= y && x >= z {
        0
    } else if y >= z {
        1
    } else {
        2
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Coordinates on a coarse lattice too: many equal distances, many points in one place.
    fn coordinate() -> impl Strategy<Value = f32> {
        prop_oneof![(-3i8..4).prop_map(f32::from), -3.0..3.0f32]
    }

    fn point() -> impl Strategy<Value = Point3<f32>> {
        (coordinate(), coordinate(), coordinate()).prop_map(|(x, y, z)| Point3::new(x, y, z))
    }

    /// All points by distance, then by index.
    fn sorted(points: &[Point3<f32>], query: &Point3<f32>) -> Vec<(u32, f32)> {
        let squared = |p: &Point3<f32>| {
            let (dx, dy, dz) = (p.x - query.x, p.y - query.y, p.z - query.z);
            dx * dx + dy * dy + dz * dz
        };
        let mut all: Vec<_> = points.iter().enumerate().map(|(i, p)| (i as u32, squared(p))).collect();
        all.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
        all
    }

    proptest! {
        #[test]
        fn the_tree_finds_what_a_full_search_finds(
            points in proptest::collection::vec(point(), 0..300), query in point(), k in 0usize..40, reach in 0.0..9.0f32,
        ) {
            let tree = KdTree::build(&points);
            let all = sorted(&points, &query);
            prop_assert_eq!(tree.nearest(&query, f32::INFINITY), all.first().copied());
            let near: Vec<_> = all.iter().copied().filter(|(_, squared)| *squared <= reach).collect();
            prop_assert_eq!(tree.nearest(&query, reach), near.first().copied());
            let mut found = Neighbours::default();
            tree.knn(&query, k, &mut found);
            prop_assert_eq!(found.iter().collect::<Vec<_>>(), all.iter().copied().take(k).collect::<Vec<_>>());
            let mut ball = Vec::new();
            tree.within(&query, reach, |index, squared| ball.push((index, squared)));
            ball.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
            prop_assert_eq!(ball, near);
        }
    }

    #[test]
    fn points_that_are_not_finite_are_left_out_and_the_others_keep_their_numbers() {
        let points = [
            Point3::new(f32::NAN, 0.0, 0.0),
            Point3::new(1.0, 0.0, 0.0),
            Point3::new(0.0, f32::INFINITY, 0.0),
            Point3::new(5.0, 0.0, 0.0),
        ];
        let tree = KdTree::build(&points);
        assert_eq!(tree.len(), 2);
        // (5 − 4)² = 1 < (1 − 4)².
        assert_eq!(tree.nearest(&Point3::new(4.0, 0.0, 0.0), f32::INFINITY), Some((3, 1.0)));
    }

    #[test]
    fn a_query_that_is_no_place_finds_nothing_or_anything_but_ends() {
        let tree = KdTree::build(&[Point3::origin(); 100]);
        assert_eq!(tree.nearest(&Point3::new(f32::NAN, 0.0, 0.0), f32::INFINITY), None);
    }
}

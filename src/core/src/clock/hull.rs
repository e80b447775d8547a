//! The lower convex hull of a sliding window of (device time, delay) pairs.
//!
//! Delay is one-sided: a pair may lie above the device's true clock, never below. The hull's edge under the middle of
//! the window is the line that has every pair on or above it and is supported on both sides of the middle; its slope is
//! the skew, its height the clock. Late pairs, however many and however late, do not touch it. (Zhang, Liu, Xia: Clock
//! synchronization algorithms for network measurements, INFOCOM 2002.)
//!
//! Everything is integer arithmetic: the turn test is exact in 128 bits.

use super::line::Line;
use std::collections::VecDeque;

/// Pairs kept at most: 30 s of a VLP-32C's decimated single return are 4,500, 60 s of a Kinect 1,800. What comes faster
/// is thinned.
const CAPACITY: usize = 8_192;

/// One pair: device time since the epoch's start and arrival minus that, both ns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Pair {
    pub(super) x: i64,
    pub(super) y: i64,
}

/// A window of pairs and the lower hull over them. Allocates once.
#[derive(Clone, Debug)]
pub(super) struct LowerHull {
    pairs: VecDeque<Pair>,
    chain: Vec<Pair>,
    heights: Vec<i64>,
}

impl LowerHull {
    pub(super) fn new() -> Self {
        Self {
            pairs: VecDeque::with_capacity(CAPACITY),
            chain: Vec::with_capacity(CAPACITY),
            heights: Vec::with_capacity(CAPACITY),
        }
    }

    pub(super) fn clear(&mut self) {
        self.pairs.clear();
        self.chain.clear();
    }

    /// Pairs in the window.
    pub(super) fn len(&self) -> usize {
        self.pairs.len()
    }

    /// Device time from the oldest to the newest pair, ns.
    pub(super) fn span(&self) -> i64 {
        match (self.pairs.front(), self.pairs.back()) {
            (Some(oldest), Some(newest)) => newest.x - oldest.x,
            _ => 0,
        }
    }

    /// Adds a pair; one that is not later than the newest is left out, because the chain grows to the right only.
    pub(super) fn push(&mut self, pair: Pair) {
        if self.pairs.back().is_some_and(|newest| pair.x <= newest.x) {
            return;
        }
        if self.pairs.len() == CAPACITY {
            self.thin();
        }
        self.pairs.push_back(pair);
        extend(&mut self.chain, pair);
    }

    /// Forgets the pairs before `x` and builds the hull over the others.
    pub(super) fn drop_before(&mut self, x: i64) {
        while self.pairs.front().is_some_and(|oldest| oldest.x < x) {
            self.pairs.pop_front();
        }
        self.rebuild();
    }

    /// The edge under the middle of the window; `None` with fewer than two pairs.
    pub(super) fn middle_edge(&self) -> Option<Line> {
        let (oldest, newest) = (self.chain.first()?, self.chain.last()?);
        let middle = oldest.x + (newest.x - oldest.x) / 2;
        let right = self.chain.partition_point(|corner| corner.x <= middle);
        let (l, r) = (self.chain.get(right.checked_sub(1)?)?, self.chain.get(right)?);
        // Pairs are strictly later one after the other, so r.x > l.x.
        Some(Line { x: l.x, y: l.y, slope: (r.y - l.y) as f64 / (r.x - l.x) as f64 })
    }

    /// The lowest line of the given slope that touches a pair; `None` without pairs.
    pub(super) fn support(&self, slope: f64) -> Option<Line> {
        let level = |pair: &&Pair| Line { x: pair.x, y: pair.y, slope }.at(0);
        self.pairs.iter().min_by_key(level).map(|pair| Line { x: pair.x, y: pair.y, slope })
    }

    /// The height above `line` below which `share` of the pairs lie, ns; 0 without pairs.
    pub(super) fn height_quantile(&mut self, line: &Line, share: f64) -> i64 {
        self.heights.clear();
        self.heights.extend(self.pairs.iter().map(|pair| pair.y.saturating_sub(line.at(pair.x)).saturating_abs()));
        let rank = (self.heights.len() as f64 * share) as usize;
        if rank >= self.heights.len() {
            return 0;
        }
        *self.heights.select_nth_unstable(rank).1
    }

    /// Keeps the lower of every two neighbours: corners of the hull are rarely lost, and never to a higher pair's gain.
    fn thin(&mut self) {
        let mut kept = 0;
        for index in (0..self.pairs.len()).step_by(2) {
            let (Some(&first), second) = (self.pairs.get(index), self.pairs.get(index + 1)) else { break };
            let lower = second.filter(|second| second.y < first.y).copied().unwrap_or(first);
            if let Some(slot) = self.pairs.get_mut(kept) {
                *slot = lower;
            }
            kept += 1;
        }
        self.pairs.truncate(kept);
        self.rebuild();
    }

    fn rebuild(&mut self) {
        self.chain.clear();
        for &pair in &self.pairs {
            extend(&mut self.chain, pair);
        }
    }
}

/// Monotone chain: corners that the new pair leaves above the hull go.
fn extend(chain: &mut Vec<Pair>, pair: Pair) {
    while let [.., a, b] = chain.as_slice()
        && turn(*a, *b, pair) <= 0
    {
        chain.pop();
    }
    chain.push(pair);
}

/// Positive when a → b → p turns to the left, i.e. b lies below the straight way from a to p.
fn turn(a: Pair, b: Pair, p: Pair) -> i128 {
    let d = |to: i64, from: i64| i128::from(to) - i128::from(from);
    // Exact for pairs up to 146 years apart; beyond, the product of two 65-bit differences would need saturation.
    let left = d(b.x, a.x).saturating_mul(d(p.y, a.y));
    left.saturating_sub(d(b.y, a.y).saturating_mul(d(p.x, a.x)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn hull(pairs: &[(i64, i64)]) -> LowerHull {
        let mut hull = LowerHull::new();
        for &(x, y) in pairs {
            hull.push(Pair { x, y });
        }
        hull
    }

    #[test]
    fn the_middle_edge_is_under_the_middle() {
        // Corners (0,10) (4,0) (10,6); the middle 5 lies between the last two: slope 6/6 = 1. (6,9) lies above.
        let line = hull(&[(0, 10), (4, 0), (6, 9), (10, 6)]).middle_edge();
        assert_eq!(line, Some(Line { x: 4, y: 0, slope: 1.0 }));
        assert_eq!(hull(&[(3, 3)]).middle_edge(), None);
    }

    #[test]
    fn dropped_pairs_no_longer_support_the_line() {
        let mut hull = hull(&[(0, 0), (4, 10), (8, 10), (12, 10)]);
        hull.drop_before(1);
        assert_eq!(hull.middle_edge(), Some(Line { x: 4, y: 10, slope: 0.0 }));
    }

    #[test]
    fn an_overfull_window_keeps_its_lowest_pairs() {
        // Every hundredth pair lies on the clock, the others 5 µs above: thinned or not, the line is the clock.
        let mut hull = LowerHull::new();
        for x in 0..100_000 {
            hull.push(Pair { x: x * 1_000, y: if x % 100 == 0 { 0 } else { 5_000 } });
        }
        assert!(hull.len() <= CAPACITY);
        assert_eq!(hull.middle_edge().map(|line| (line.y, line.slope)), Some((0, 0.0)));
    }

    #[test]
    fn the_lowest_twentieth_of_ramped_heights() {
        // Heights 0, 1, … 99: rank 5 of 100 is 5.
        let mut hull = hull(&(0..100).map(|i| (i, i)).collect::<Vec<_>>());
        assert_eq!(hull.height_quantile(&Line { x: 0, y: 0, slope: 0.0 }, 0.05), 5);
    }

    proptest! {
        #[test]
        fn every_pair_lies_on_or_above_the_middle_edge(
            steps in prop::collection::vec((1i64..1_000, -500i64..500), 2..200), cut in 0i64..50_000
        ) {
            let mut hull = LowerHull::new();
            let mut x = 0;
            for &(dx, y) in &steps {
                x += dx;
                hull.push(Pair { x, y });
            }
            hull.drop_before(cut.min(x - steps.last().map_or(0, |last| last.0)));
            if let Some(line) = hull.middle_edge() {
                for pair in &hull.pairs {
                    let above = pair.y as f64 - (line.y as f64 + line.slope * (pair.x - line.x) as f64);
                    prop_assert!(above > -1e-6, "{pair:?} lies {above} under the line");
                }
            }
        }

        #[test]
        fn arbitrary_pairs_are_bounded(pairs in prop::collection::vec((any::<i64>(), any::<i64>()), 0..300)) {
            let mut hull = LowerHull::new();
            for (x, y) in pairs {
                hull.push(Pair { x: x >> 2, y: y >> 2 });
            }
            prop_assert!(hull.chain.len() <= hull.pairs.len());
            prop_assert_eq!(hull.middle_edge().is_some(), hull.len() >= 2);
        }
    }
}

//! A body's triangles in a tree of boxes, so that a ray looks at a few of them.
//!
//! Built once per mesh and never changed: it lives in the body's frame, and rays are moved into that. The tree decides
//! only how soon an answer is found: it is always the one that trying every triangle in turn would give.

use super::facet::Facet;
use crate::shape::Mesh;
use nalgebra::{Point3, Vector3};

/// Leaves never hold more.
const LEAF: usize = 4;
/// Below this depth a node is cut in the middle of its list, whatever the boxes: depth stays within 24 + log₂(count).
const DEPTH_BY_AREA: u32 = 24;
/// Places a walk may have to come back to: one per level, for 2³² triangles.
const PENDING: usize = 24 + 32;
/// Boxes are larger than what they hold by this part of their coordinates, so that rounding in the box test never
/// loses a triangle that the exact test would hit.
const MARGIN: f64 = 1e-9;

/// A line in the body's frame, ready for boxes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    pub(super) origin: Point3<f64>,
    pub(super) direction: Vector3<f64>,
    inverse: Vector3<f64>,
}

impl Line {
    pub(super) fn new(origin: Point3<f64>, direction: Vector3<f64>) -> Self {
        // A direction along a box's side is replaced by one that is as good as along it: no 0 × ∞ below.
        let inverse = direction.map(|d| 1.0 / if d.abs() < 1e-200 { 1e-200_f64.copysign(d) } else { d });
        Self { origin, direction, inverse }
    }
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    low: Point3<f64>,
    high: Point3<f64>,
}

impl Bounds {
    const NOTHING: Self = Self {
        low: Point3::new(f64::INFINITY, f64::INFINITY, f64::INFINITY),
        high: Point3::new(f64::NEG_INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY),
    };

    fn of(facet: &Facet) -> Self {
        facet.corners().iter().fold(Self::NOTHING, |bounds, corner| bounds.with(Self { low: *corner, high: *corner }))
    }

    fn with(self, other: Self) -> Self {
        Self { low: self.low.inf(&other.low), high: self.high.sup(&other.high) }
    }

    fn widened(self) -> Self {
        let reach = self.low.coords.amax().max(self.high.coords.amax());
        let margin = Vector3::repeat(reach * MARGIN + 1e-12);
        Self { low: self.low - margin, high: self.high + margin }
    }

    /// Half the surface.
    fn area(self) -> f64 {
        let size = self.high - self.low;
        size.x * size.y + size.y * size.z + size.z * size.x
    }

    fn centre(self) -> Point3<f64> {
        nalgebra::center(&self.low, &self.high)
    }

    /// Where a line enters, between two ranges; `None`: it does not.
    fn entry(&self, line: &Line, nearest: f64, farthest: f64) -> Option<f64> {
        let span = |low: f64, high: f64, origin: f64, inverse: f64| {
            let (a, b) = ((low - origin) * inverse, (high - origin) * inverse);
            if a < b { (a, b) } else { (b, a) }
        };
        let (x0, x1) = span(self.low.x, self.high.x, line.origin.x, line.inverse.x);
        let (y0, y1) = span(self.low.y, self.high.y, line.origin.y, line.inverse.y);
        let (z0, z1) = span(self.low.z, self.high.z, line.origin.z, line.inverse.z);
        let enters = greater(greater(x0, y0), greater(z0, nearest));
        let leaves = lesser(lesser(x1, y1), lesser(z1, farthest));
        (enters <= leaves).then_some(enters)
    }
}

// No value here is ever NaN; `f64::max` and `min` would pay for that case in the innermost loop.
fn greater(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

fn lesser(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// A box and what is in it.
#[derive(Clone, Copy, Debug)]
struct Node {
    bounds: Bounds,
    /// An inner node's second child (its first follows it); a leaf's first facet.
    first: u32,
    /// Facets of a leaf; 0: an inner node.
    count: u32,
}

/// A mesh's surface, ready for rays.
#[derive(Clone, Debug)]
pub(super) struct Bvh {
    nodes: Vec<Node>,
    facets: Vec<Facet>,
    /// A sphere that holds the surface, body frame.
    pub(super) centre: Point3<f64>,
    pub(super) radius: f64,
}

/// A facet while the tree is built.
struct Item {
    facet: Facet,
    bounds: Bounds,
    centre: Point3<f64>,
}

impl Bvh {
    pub(super) fn new(mesh: &Mesh) -> Self {
        let mut items: Vec<Item> = Facet::all(mesh)
            .map(|facet| {
                let bounds = Bounds::of(&facet);
                Item { facet, bounds, centre: bounds.centre() }
            })
            .collect();
        let whole = bounds_of(&items);
        let centre = if items.is_empty() { Point3::origin() } else { whole.centre() };
        let corners = items.iter().flat_map(|item| item.facet.corners());
        let radius = corners.map(|corner| (corner - centre).norm()).fold(0.0, f64::max) * (1.0 + MARGIN);
        let mut bvh = Self { nodes: Vec::new(), facets: Vec::with_capacity(items.len()), centre, radius };
        if !items.is_empty() {
            bvh.grow(&mut items, 0);
        }
        bvh
    }

    /// Adds the node of these items, and all below it.
    fn grow(&mut self, items: &mut [Item], depth: u32) {
        let place = self.nodes.len();
        let bounds = bounds_of(items);
        self.nodes.push(Node { bounds: bounds.widened(), first: self.facets.len() as u32, count: items.len() as u32 });
        if items.len() <= LEAF {
            self.facets.extend(items.iter().map(|item| item.facet));
            return;
        }
        let half = items.len() / 2;
        let (axis, left) = if depth < DEPTH_BY_AREA { cheapest_cut(items) } else { (0, half) };
        sort(items, axis);
        let (left, right) = items.split_at_mut(left);
        self.grow(left, depth + 1);
        let second = self.nodes.len() as u32;
        self.grow(right, depth + 1);
        if let Some(node) = self.nodes.get_mut(place) {
            (node.first, node.count) = (second, 0);
        }
    }

    /// The first facet on a line between two ranges, and how far it is; of two at the same range the one that comes
    /// first in the mesh.
    pub(super) fn first(&self, line: &Line, nearest: f64, farthest: f64) -> Option<(f64, &Facet)> {
        let mut best: Option<(f64, &Facet)> = None;
        self.walk(line, nearest, farthest, |range, facet| {
            if best.is_none_or(|(known, other)| range < known || (range == known && facet.place < other.place)) {
                best = Some((range, facet));
            }
            range
        });
        best
    }

    /// Whether anything is on a line between two ranges.
    pub(super) fn any(&self, line: &Line, nearest: f64, farthest: f64) -> bool {
        let mut found = false;
        self.walk(line, nearest, farthest, |_, _| {
            found = true;
            f64::NEG_INFINITY
        });
        found
    }

    /// Shows every facet that the line meets farther than `nearest` and no farther than `farthest`, nearer boxes
    /// first; what is told of one is the new farthest range.
    fn walk<'a>(&'a self, line: &Line, nearest: f64, mut farthest: f64, mut meet: impl FnMut(f64, &'a Facet) -> f64) {
        let mut pending = [(0.0, 0_u32); PENDING];
        let mut waiting = 0;
        let mut next = self.nodes.first().and_then(|root| root.bounds.entry(line, nearest, farthest)).map(|_| 0);
        while let Some(place) = next {
            next = None;
            let Some(node) = self.nodes.get(place as usize) else { return };
            if node.count > 0 {
                let facets = self.facets.iter().skip(node.first as usize).take(node.count as usize);
                for facet in facets {
                    if let Some(range) = facet.range(line)
                        && range > nearest
                        && range <= farthest
                    {
                        farthest = meet(range, facet);
                    }
                }
            } else {
                let entry = |child: u32| self.nodes.get(child as usize)?.bounds.entry(line, nearest, farthest);
                let (left, right) = (place + 1, node.first);
                next = match (entry(left), entry(right)) {
                    (Some(a), Some(b)) => {
                        let (near, far) = if b < a { (right, (a, left)) } else { (left, (b, right)) };
                        if let Some(slot) = pending.get_mut(waiting) {
                            *slot = far;
                            waiting += 1;
                        }
                        Some(near)
                    }
                    (Some(_), None) => Some(left),
                    (None, Some(_)) => Some(right),
                    (None, None) => None,
                };
            }
            while next.is_none() && waiting > 0 {
                waiting -= 1;
                next = pending.get(waiting).filter(|(entry, _)| *entry <= farthest).map(|(_, place)| *place);
            }
        }
    }
}

fn bounds_of(items: &[Item]) -> Bounds {
    items.iter().fold(Bounds::NOTHING, |bounds, item| bounds.with(item.bounds))
}

/// By the boxes' centres along an axis, then by the mesh's order: the same tree on every machine.
fn sort(items: &mut [Item], axis: usize) {
    let along = |item: &Item| item.centre.coords.get(axis).copied().unwrap_or_default();
    items.sort_unstable_by(|a, b| along(a).total_cmp(&along(b)).then(a.facet.place.cmp(&b.facet.place)));
}

/// The axis and the number of items on its lower side for which a ray has least to try: the sum of area × count over
/// the two sides (the surface area heuristic of Goldsmith and Salmon 1987, every cut tried).
fn cheapest_cut(items: &mut [Item]) -> (usize, usize) {
    let mut best = (f64::INFINITY, 0, items.len() / 2);
    let mut above = Vec::with_capacity(items.len());
    for axis in 0..3 {
        sort(items, axis);
        above.clear();
        let mut bounds = Bounds::NOTHING;
        for (count, item) in items.iter().rev().enumerate() {
            bounds = bounds.with(item.bounds);
            above.push(bounds.area() * (count + 1) as f64);
        }
        let mut bounds = Bounds::NOTHING;
        // `above` is by count from the top: with k items below there are n − k above.
        for (below, (item, rest)) in items.iter().zip(above.iter().rev().skip(1)).enumerate() {
            bounds = bounds.with(item.bounds);
            let cost = bounds.area() * (below + 1) as f64 + rest;
            if cost < best.0 {
                best = (cost, axis, below + 1);
            }
        }
    }
    (best.1, best.2)
}

#[cfg(test)]
#[path = "bvh_tests.rs"]
mod tests;

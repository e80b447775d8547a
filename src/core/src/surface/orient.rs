//! Which side of a surface is its front.

use super::patch::Detail;
use crate::neighbours::{KdTree, Neighbours};
use nalgebra::Point3;
use std::collections::BinaryHeap;

/// Neighbours a facing is handed on to.
const HANDED_TO: usize = 10;

/// Turns every normal to the side of the viewpoint.
pub(crate) fn towards(viewpoint: &Point3<f32>, details: &mut [Detail]) {
    let viewpoint = viewpoint.cast::<f64>();
    for detail in details {
        if detail.normal.dot(&(viewpoint - detail.anchor)) < 0.0 {
            detail.turn();
        }
    }
}

/// An edge over which a facing may be handed on: the more alike the normals, the sooner; then the lowest index.
#[derive(PartialEq, Eq, PartialOrd, Ord)]
struct Edge {
    /// |cos| between the normals, in millionths.
    likeness: u32,
    to: core::cmp::Reverse<u32>,
    from: u32,
}

/// Turns normals so that neighbours agree, from the point farthest from the centroid outwards: there the body is convex,
/// the front is the side away from the centroid. Pieces that hang together by no neighbour start anew. O(n log n).
pub(crate) fn consistently(points: &[Point3<f32>], details: &mut [Detail]) {
    let tree = KdTree::build(points);
    let mut near = Neighbours::with_capacity(HANDED_TO);
    let mut done = vec![false; points.len()];
    let mut edges = BinaryHeap::new();
    for start in outermost_first(points) {
        if done.get(start as usize).copied().unwrap_or(true) {
            continue;
        }
        face_outwards(points, details, start);
        let mut current = start;
        loop {
            hand_on(points, details, &tree, &mut near, &mut done, &mut edges, current);
            let Some(edge) = next(&mut edges, &done) else { break };
            let Some(from) = details.get(edge.from as usize).map(|detail| detail.normal) else { break };
            let Some(detail) = details.get_mut(edge.to.0 as usize) else { break };
            if detail.normal.dot(&from) < 0.0 {
                detail.turn();
            }
            current = edge.to.0;
        }
    }
}

fn next(edges: &mut BinaryHeap<Edge>, done: &[bool]) -> Option<Edge> {
    loop {
        let edge = edges.pop()?;
        if !done.get(edge.to.0 as usize).copied().unwrap_or(true) {
            return Some(edge);
        }
    }
}

fn hand_on(
    points: &[Point3<f32>],
    details: &[Detail],
    tree: &KdTree,
    near: &mut Neighbours,
    done: &mut [bool],
    edges: &mut BinaryHeap<Edge>,
    from: u32,
) {
    let (Some(point), Some(detail)) = (points.get(from as usize), details.get(from as usize)) else { return };
    if let Some(done) = done.get_mut(from as usize) {
        *done = true;
    }
    tree.knn(point, HANDED_TO, near);
    for (to, _) in near.iter() {
        let Some(other) = details.get(to as usize) else { continue };
        if !done.get(to as usize).copied().unwrap_or(true) {
            let likeness = (detail.normal.dot(&other.normal).abs() * 1e6) as u32;
            edges.push(Edge { likeness, to: core::cmp::Reverse(to), from });
        }
    }
}

fn centroid(points: &[Point3<f32>]) -> nalgebra::Vector3<f64> {
    points.iter().map(|point| point.coords.cast::<f64>()).sum::<nalgebra::Vector3<f64>>() / points.len().max(1) as f64
}

/// The points' numbers, the farthest from the centroid first.
fn outermost_first(points: &[Point3<f32>]) -> Vec<u32> {
    let middle = centroid(points);
    let mut order: Vec<(u64, u32)> = points
        .iter()
        .zip(0..)
        // The bits of a distance ≥ 0 rise with it: inverted they fall.
        .map(|(point, index)| (!(point.coords.cast::<f64>() - middle).norm_squared().to_bits(), index))
        .collect();
    order.sort_unstable();
    order.into_iter().map(|(_, index)| index).collect()
}

fn face_outwards(points: &[Point3<f32>], details: &mut [Detail], index: u32) {
    let middle = centroid(points);
    if let Some(detail) = details.get_mut(index as usize)
        && detail.normal.dot(&(detail.anchor.coords - middle)) < 0.0
    {
        detail.turn();
    }
}

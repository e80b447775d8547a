//! What of a target's true surface and edges a rig can have seen.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point3, Vector3};
use tumbled_core::recon::score::{TrueEdge, TrueSurface};
use tumbled_model::RigNs;
use tumbled_sim::scene::Scene;
use tumbled_sim::shape::{Mesh, normal};

/// Times at which it is asked what is seen.
const LOOKS: i64 = 24;
/// A surface seen at a smaller cosine is not seen.
const GRAZING: f64 = 0.2;
/// Ahead of a surface a place is looked at so far, m: it does not hide itself.
const AHEAD_M: f64 = 0.004;
/// One sample of the surface for so much of it, m².
const SAMPLE_M2: f64 = 2.5e-4;
/// Facets that meet at less than this have no edge: cos 20°.
const EDGE_COSINE: f64 = 0.939_692_6;
/// True edges shorter than this, m, are pieces of something round, or too small to ask for.
const SHORTEST_M: f64 = 0.05;
/// Where no facet that ends at an edge is wider than this, m, the facets stand for something round: the mast, a nozzle,
/// which have no edges there. The narrowest plate of a target is 3 cm wide.
const ROUND_M: f64 = 0.02;

/// The truth that models are held against, mesh's frame.
#[derive(Clone, Debug)]
pub struct SeenTruth {
    /// The surface.
    pub surface: TrueSurface,
    /// Places of the surface that were seen.
    pub area: Vec<Point3<f64>>,
    /// All edges, those where parts cut each other among them.
    pub edges: Vec<TrueEdge>,
    /// Places of edges of 5 cm and more that were seen, with the edges' directions; without those between the facets of round parts.
    pub seen_edges: Vec<(Point3<f64>, Vector3<f64>)>,
}

impl SeenTruth {
    /// Of a scene's whole duration, by the sensors where they truly stand.
    pub fn of(scene: &Scene) -> Self {
        let mesh = &*scene.surface;
        let corners = || mesh.triangles.iter().filter_map(|triangle| mesh.corners(triangle));
        let looks = Looks::of(scene);
        let area = samples(corners()).into_iter().filter(|(place, out)| looks.see(place, &[*out]));
        let area = area.map(|(place, _)| place).collect();
        let edges = edges(mesh);
        let long = edges.iter().filter(|(edge, _)| edge.length_m() >= SHORTEST_M && widest_m(mesh, edge) > ROUND_M);
        let seen_edges = long.flat_map(|(edge, normals)| {
            let direction = (edge.ends[1] - edge.ends[0]).normalize();
            let seen: Vec<_> = edge.places().filter(|place| looks.see(place, normals)).collect();
            seen.into_iter().map(move |place| (place, direction))
        });
        let seen_edges = seen_edges.collect();
        let surface = TrueSurface::new(corners());
        let mut all: Vec<TrueEdge> = edges.into_iter().map(|(edge, _)| edge).collect();
        all.extend(surface.cuts());
        Self { surface, area, edges: all, seen_edges }
    }
}

/// The sensors' places at some times.
struct Looks<'a> {
    scene: &'a Scene,
    at: Vec<(RigNs, Isometry3<f64>, Vec<Point3<f64>>)>,
}

impl<'a> Looks<'a> {
    fn of(scene: &'a Scene) -> Self {
        let kinects = scene.config.kinect.iter().map(|kinect| kinect.t_rig_kinect.isometry());
        let lidars = scene.config.lidar.iter().map(|lidar| lidar.t_rig_lidar.isometry());
        let sensors: Vec<Point3<f64>> =
            kinects.chain(lidars).map(|mount| Point3::from(mount.translation.vector)).collect();
        let times = (0..LOOKS).map(|n| RigNs(scene.duration().0 / LOOKS * n));
        let at = times.filter_map(|t| Some((t, scene.world.target(t)?.t_rig_body, sensors.clone())));
        Self { at: at.collect(), scene }
    }

    /// Whether any sensor sees a place that faces one of these ways, at any of the times.
    fn see(&self, place: &Point3<f64>, normals: &[Vector3<f64>]) -> bool {
        let out: Vector3<f64> = normals.iter().sum();
        let ahead = place + out.try_normalize(1e-9).unwrap_or_default() * AHEAD_M;
        self.at.iter().any(|(t, t_rig_body, sensors)| {
            let target = t_rig_body * ahead;
            let snapshot = self.scene.world.at(*t);
            sensors.iter().any(|sensor| {
                let sight = (sensor - target).normalize();
                let faces = normals.iter().any(|normal| (t_rig_body * normal).dot(&sight) > GRAZING);
                faces && !snapshot.occluded(sensor, &target, AHEAD_M / 4.0)
            })
        })
    }
}

/// Places spread evenly over triangles, with outward normals.
fn samples(triangles: impl Iterator<Item = [Point3<f64>; 3]>) -> Vec<(Point3<f64>, Vector3<f64>)> {
    let (mut places, mut left) = (Vec::new(), 0.0);
    let mut turn = 0.0_f64;
    for [a, b, c] in triangles {
        let out = normal([a, b, c]);
        left += 0.5 * (b - a).cross(&(c - a)).norm() / SAMPLE_M2;
        while left >= 1.0 {
            left -= 1.0;
            // Two irrational steps spread places evenly (Roberts' sequence).
            turn += 1.0;
            let (u, v) = ((turn * 0.754_877_666).fract(), (turn * 0.569_840_291).fract());
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            places.push((a + (b - a) * u + (c - a) * v, out));
        }
    }
    places
}

/// Edges at which facets meet at 20° or more, pieces of one joined, with the facets' normals.
fn edges(mesh: &Mesh) -> Vec<(TrueEdge, Vec<Vector3<f64>>)> {
    let mut sides: BTreeMap<(u32, u32), Vec<Vector3<f64>>> = BTreeMap::new();
    for triangle in &mesh.triangles {
        let Some(corners) = mesh.corners(triangle) else { continue };
        let [a, b, c] = triangle.corners;
        for (from, to) in [(a, b), (b, c), (c, a)] {
            sides.entry((from.min(to), from.max(to))).or_default().push(normal(corners));
        }
    }
    let mut edges: Vec<(TrueEdge, Vec<Vector3<f64>>)> = Vec::new();
    for ((from, to), normals) in sides {
        let [Some(a), Some(b)] = [from, to].map(|at| mesh.vertices.get(at as usize).copied()) else { continue };
        let is_flat = matches!(normals.as_slice(), [first, second] if first.dot(second) > EDGE_COSINE);
        if is_flat {
            continue;
        }
        edges.push((TrueEdge { ends: [a, b] }, normals));
    }
    while let Some((kept, dropped, joined)) = piece(&edges) {
        if let Some((edge, _)) = edges.get_mut(kept) {
            *edge = joined;
        }
        edges.remove(dropped);
    }
    edges
}

/// How far the widest facet with a side on an edge reaches away from it, m.
fn widest_m(mesh: &Mesh, edge: &TrueEdge) -> f64 {
    let along = (edge.ends[1] - edge.ends[0]).normalize();
    let off = |corner: &Point3<f64>| (corner - edge.ends[0]).cross(&along).norm();
    let corners = mesh.triangles.iter().filter_map(|triangle| mesh.corners(triangle));
    let with_a_side_on_it = corners.filter(|corners| corners.iter().filter(|corner| off(corner) < 1e-6).count() == 2);
    with_a_side_on_it.flatten().map(|corner| off(&corner)).fold(0.0, f64::max)
}

/// Two edges that go on in one another.
fn piece(edges: &[(TrueEdge, Vec<Vector3<f64>>)]) -> Option<(usize, usize, TrueEdge)> {
    for ((a, _), at) in edges.iter().zip(0..) {
        for ((b, _), other) in edges.iter().zip(0..).skip(at + 1) {
            let (u, v) = (a.ends[1] - a.ends[0], b.ends[1] - b.ends[0]);
            if u.cross(&v).norm() > 1e-6 * u.norm() * v.norm() {
                continue;
            }
            for (x, y) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                if (a.ends[x] - b.ends[y]).norm() < 1e-9 {
                    return Some((at, other, TrueEdge { ends: [a.ends[1 - x], b.ends[1 - y]] }));
                }
            }
        }
    }
    None
}

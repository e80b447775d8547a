//! Annealed Gauss–Newton from one start: probes onto the surface, by look-ups. Method.md §3.3, step 3.
//!
//! The residuals of a probe are its distance to the plane of the patch that it looks up, and, weakly, its offset from the
//! patch's point: the weak part keeps a slide along a panel from being free. Probes are taken four at a time.

use super::pose::Pose;
use crate::surface::Surface;
use crate::surface::four::dot;
use nalgebra::{Matrix3, Point3, Vector3};
use wide::f32x4;

/// Probes in a block.
pub(super) const BLOCK: usize = 4;

/// A sparse cloud's points, blocks of four, about their centroid: the first ones are spread the widest.
#[derive(Clone, Debug)]
pub(super) struct Probes {
    /// The centroid of the whole cloud, its own frame.
    pub(super) centroid: Point3<f64>,
    /// Where the sensor stood, about the centroid; `None`: nobody knows.
    pub(super) viewpoint: Option<Vector3<f32>>,
    blocks: Vec<[f32x4; 3]>,
}

impl Probes {
    /// From points in the order they are to be used. A last block that is not full is filled with the first ones again.
    pub(super) fn new(points: &[Point3<f32>], centroid: Point3<f64>, viewpoint: Option<Point3<f32>>) -> Self {
        let about = centroid.cast::<f32>();
        let padded = points.iter().cycle().take(points.len().next_multiple_of(BLOCK));
        let offsets: Vec<Vector3<f32>> = padded.map(|point| point - about).collect();
        let columns = |[a, b, c, d]: &[Vector3<f32>; BLOCK]| {
            [f32x4::new([a.x, b.x, c.x, d.x]), f32x4::new([a.y, b.y, c.y, d.y]), f32x4::new([a.z, b.z, c.z, d.z])]
        };
        let blocks = offsets.as_chunks::<BLOCK>().0.iter().map(columns).collect();
        Self { centroid, viewpoint: viewpoint.map(|viewpoint| viewpoint - about), blocks }
    }

    /// The blocks of the first `count` probes.
    fn blocks(&self, count: usize) -> &[[f32x4; 3]] {
        self.blocks.get(..count.div_ceil(BLOCK)).unwrap_or(&self.blocks)
    }
}

/// How a descent goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Schedule {
    /// Probes used, in whole blocks; as many as there are if there are fewer.
    pub(super) probes: usize,
    /// Steps.
    pub(super) steps: u32,
    /// The kernel's scale at the first step, m.
    pub(super) from_m: f32,
    /// At the last step, m.
    pub(super) to_m: f32,
    /// Probes farther than this from their patch's point, along the surface, have left its rim: they say nothing, m.
    pub(super) rim_m: f32,
}

/// The point part's weight beside the plane part's: strong while the kernel is wide, weak later.
const POINT_PART: (f32, f32) = (0.6, 0.15);
/// Steps of the strong one.
const STRONG: u32 = 3;
/// Added to the normal matrix's diagonal: an empty or flat system gives a small step, not none.
const DAMPING: f64 = 1e-6;
/// The longest step in rotation, rad.
const LONGEST_TURN: f64 = 0.4;

/// Descends from a pose. Probes that meet a patch's back, as their sensor would see it, say nothing.
pub(super) fn descend(surface: &Surface, probes: &Probes, start: &Pose, schedule: &Schedule) -> Pose {
    let mut pose = *start;
    let blocks = probes.blocks(schedule.probes);
    let narrowing = libm::powf(schedule.to_m / schedule.from_m, 1.0 / (schedule.steps.max(2) - 1) as f32);
    let mut kernel = schedule.from_m;
    for step in 0..schedule.steps {
        let point_part = if step < STRONG { POINT_PART.0 } else { POINT_PART.1 };
        let viewpoint = probes.viewpoint.map(|from| pose.rotation * from + pose.center);
        let system = Placed::new(&pose, viewpoint.as_ref(), schedule.rim_m, kernel, point_part).gather(surface, blocks);
        let Some((turn, step)) = system.solve() else { return pose };
        pose = pose.stepped(&turn, &step);
        kernel *= narrowing;
    }
    pose
}

/// What every block of a step is asked with, in all four lanes.
struct Placed {
    rows: [[f32x4; 3]; 3],
    center: [f32x4; 3],
    viewpoint: Option<[f32x4; 3]>,
    square_rim: f32x4,
    inverse_square_kernel: f32x4,
    point_part: f32x4,
}

impl Placed {
    fn new(pose: &Pose, viewpoint: Option<&Vector3<f32>>, rim_m: f32, kernel_m: f32, point_part: f32) -> Self {
        let r = &pose.rotation;
        let rows = [[r.m11, r.m12, r.m13], [r.m21, r.m22, r.m23], [r.m31, r.m32, r.m33]];
        let all = |vector: &Vector3<f32>| [vector.x, vector.y, vector.z].map(f32x4::splat);
        Self {
            rows: rows.map(|row| row.map(f32x4::splat)),
            center: all(&pose.center),
            viewpoint: viewpoint.map(all),
            square_rim: f32x4::splat(rim_m * rim_m),
            inverse_square_kernel: f32x4::splat(1.0 / (kernel_m * kernel_m)),
            point_part: f32x4::splat(point_part),
        }
    }

    /// The normal equations of all blocks.
    fn gather(&self, surface: &Surface, blocks: &[[f32x4; 3]]) -> System {
        let mut sums = [f32x4::ZERO; ENTRIES];
        for block in blocks {
            self.add(surface, block, &mut sums);
        }
        System::of(&sums)
    }

    /// Adds four probes: upper triangle of the matrix row by row, then the vector.
    #[inline(always)]
    fn add(&self, surface: &Surface, block: &[f32x4; 3], sums: &mut [f32x4; ENTRIES]) {
        // From the centroid's place to the probes.
        let arm = self.rows.map(|row| dot(&row, block));
        let ([x, y, z], [cx, cy, cz]) = (arm, self.center);
        let at = [x + cx, y + cy, z + cz];
        let met = surface.look_at_four(&at);
        let offset = met.offset(&at);
        let square = dot(&offset, &offset);
        let height = dot(&offset, &met.n);
        let mut counts = met.is_met & (square - height * height).simd_le(self.square_rim);
        if let Some(viewpoint) = &self.viewpoint {
            counts &= dot(&met.offset(viewpoint), &met.n).simd_ge(f32x4::ZERO);
        }
        let falloff = f32x4::ONE / (f32x4::ONE + square * self.inverse_square_kernel);
        let w = counts & (falloff * falloff);
        let p = w * self.point_part;
        let [c0, c1, c2] = cross(&arm, &met.n);
        let [n0, n1, n2] = met.n;
        let [w0, w1, w2] = [w * c0, w * c1, w * c2];
        let [m0, m1, m2] = [w * n0, w * n1, w * n2];
        let [px, py, pz] = [p * x, p * y, p * z];
        let [e0, e1, e2] = offset;
        let wh = w * height;
        // The point part's Jacobian is (−[arm]×, I).
        let terms = [
            w0 * c0 + (py * y + pz * z),
            w0 * c1 - px * y,
            w0 * c2 - px * z,
            w0 * n0,
            w0 * n1 - pz,
            w0 * n2 + py,
            w1 * c1 + (px * x + pz * z),
            w1 * c2 - py * z,
            w1 * n0 + pz,
            w1 * n1,
            w1 * n2 - px,
            w2 * c2 + (px * x + py * y),
            w2 * n0 - py,
            w2 * n1 + px,
            w2 * n2,
            m0 * n0 + p,
            m0 * n1,
            m0 * n2,
            m1 * n1 + p,
            m1 * n2,
            m2 * n2 + p,
            wh * c0 + (py * e2 - pz * e1),
            wh * c1 + (pz * e0 - px * e2),
            wh * c2 + (px * e1 - py * e0),
            wh * n0 + p * e0,
            wh * n1 + p * e1,
            wh * n2 + p * e2,
        ];
        for (sum, term) in sums.iter_mut().zip(terms) {
            *sum += term;
        }
    }
}

#[inline(always)]
fn cross(a: &[f32x4; 3], b: &[f32x4; 3]) -> [f32x4; 3] {
    let ([ax, ay, az], [bx, by, bz]) = (*a, *b);
    [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]
}

/// Entries of the normal equations: 21 of the matrix, 6 of the vector.
const ENTRIES: usize = 27;

/// The normal equations, in blocks of rotation and translation.
struct System {
    turns: Matrix3<f64>,
    mixed: Matrix3<f64>,
    moves: Matrix3<f64>,
    turn: Vector3<f64>,
    step: Vector3<f64>,
}

impl System {
    fn of(sums: &[f32x4; ENTRIES]) -> Self {
        let total = |sum: f32x4| {
            let [a, b, c, d] = sum.to_array();
            f64::from((a + b) + (c + d))
        };
        let [a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p, q, r, s, t, u, t0, t1, t2, s0, s1, s2] = sums.map(total);
        Self {
            turns: Matrix3::new(a, b, c, b, g, h, c, h, l),
            mixed: Matrix3::new(d, e, f, i, j, k, m, n, o),
            moves: Matrix3::new(p, q, r, q, s, t, r, t, u),
            turn: Vector3::new(t0, t1, t2),
            step: Vector3::new(s0, s1, s2),
        }
    }

    /// The turn, rad, and the step, m; `None`: the system has no solution.
    fn solve(&self) -> Option<(Vector3<f64>, Vector3<f64>)> {
        let damping = Matrix3::from_diagonal_element(DAMPING);
        // The translations eliminated: what is left is the rotation's.
        let inverse = (self.moves + damping).try_inverse()?;
        let through = self.mixed * inverse;
        let left = self.turns + damping - through * self.mixed.transpose();
        let turn = left.try_inverse()? * (through * self.step - self.turn);
        let step = -(inverse * (self.step + self.mixed.tr_mul(&turn)));
        let shortened = LONGEST_TURN / turn.norm().max(LONGEST_TURN);
        let is_finite = turn.iter().chain(&step).all(|value| value.is_finite());
        is_finite.then(|| (turn * shortened, step * shortened))
    }
}

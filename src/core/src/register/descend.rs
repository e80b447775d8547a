//! Annealed Gauss–Newton from one start: probes onto the surface, by look-ups. Method.md §3.3, step 3.
//!
//! The residuals of a probe are its distance to the plane of the patch that it looks up, and, weakly, its offset from the
//! patch's point: the weak part keeps a slide along a panel from being free. Probes are taken eight at a time.

use super::pose::Pose;
use crate::surface::{Patch, Surface};
use nalgebra::{Matrix6, Point3, Vector3, Vector6};
use wide::f32x8;

/// Probes in a block.
pub(super) const BLOCK: usize = 8;

/// A sparse cloud's points, blocks of eight, about their centroid: the first ones are spread the widest.
#[derive(Clone, Debug)]
pub(super) struct Probes {
    /// The centroid of the whole cloud, its own frame.
    pub(super) centroid: Point3<f64>,
    /// Where the sensor stood, about the centroid; `None`: nobody knows.
    pub(super) viewpoint: Option<Vector3<f32>>,
    blocks: Vec<[f32x8; 3]>,
}

impl Probes {
    /// From points in the order they are to be used. A last block that is not full is filled with the first ones again.
    pub(super) fn new(points: &[Point3<f32>], centroid: Point3<f64>, viewpoint: Option<Point3<f32>>) -> Self {
        let about = centroid.cast::<f32>();
        let padded = points.iter().cycle().take(points.len().next_multiple_of(BLOCK));
        let columns = |axis: usize| padded.clone().map(move |point| point.coords.get(axis).copied().unwrap_or(0.0));
        let lanes = |axis: usize, about: f32| -> Vec<f32x8> {
            let column: Vec<f32> = columns(axis).map(|value| value - about).collect();
            column.as_chunks::<BLOCK>().0.iter().map(|lane| f32x8::from(*lane)).collect()
        };
        let (x, y, z) = (lanes(0, about.x), lanes(1, about.y), lanes(2, about.z));
        let blocks = x.into_iter().zip(y).zip(z).map(|((x, y), z)| [x, y, z]).collect();
        Self { centroid, viewpoint: viewpoint.map(|viewpoint| viewpoint - about), blocks }
    }

    /// The blocks of the first `count` probes.
    pub(super) fn blocks(&self, count: usize) -> &[[f32x8; 3]] {
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
const POINT_PART: [f32; 4] = [0.6, 0.6, 0.6, 0.15];
/// Added to the normal matrix's diagonal: an empty or flat system gives a small step, not none.
const DAMPING: f64 = 1e-6;
/// The longest step in rotation, rad.
const LONGEST_TURN: f64 = 0.4;

/// Descends from a pose. Probes that meet a patch's back, as their sensor would see it, say nothing.
pub(super) fn descend(surface: &Surface, probes: &Probes, start: &Pose, schedule: &Schedule) -> Pose {
    let mut pose = *start;
    let blocks = probes.blocks(schedule.probes);
    let ratio = schedule.to_m / schedule.from_m;
    for step in 0..schedule.steps {
        let share = step as f32 / (schedule.steps.max(2) - 1) as f32;
        let kernel = schedule.from_m * libm::powf(ratio, share);
        let point_part = POINT_PART.get(step as usize).copied().unwrap_or(0.15);
        let viewpoint = probes.viewpoint.map(|from| pose.rotation * from + pose.center);
        let mut sums = Sums::default();
        for block in blocks {
            sums.add(&Met::look(surface, &pose, block, viewpoint.as_ref(), schedule.rim_m), kernel, point_part);
        }
        let Some(delta) = sums.solve() else { return pose };
        pose = pose.moved(&delta.fixed_rows::<3>(0).into(), &delta.fixed_rows::<3>(3).into());
    }
    pose
}

/// Eight probes and the patches they met.
struct Met {
    /// From the centroid's place to the probe, m.
    arm: [f32x8; 3],
    /// From the patch's point to the probe, m.
    offset: [f32x8; 3],
    normal: [f32x8; 3],
    /// 1: a patch was met; 0: none.
    met: f32x8,
}

impl Met {
    #[inline]
    fn look(surface: &Surface, pose: &Pose, block: &[f32x8; 3], viewpoint: Option<&Vector3<f32>>, rim_m: f32) -> Self {
        let [dx, dy, dz] = *block;
        let r = &pose.rotation;
        let row = |a: f32, b: f32, c: f32| f32x8::splat(a) * dx + f32x8::splat(b) * dy + f32x8::splat(c) * dz;
        let arm = [row(r.m11, r.m12, r.m13), row(r.m21, r.m22, r.m23), row(r.m31, r.m32, r.m33)];
        let [ax, ay, az] = arm;
        let at = [
            (ax + f32x8::splat(pose.center.x)).to_array(),
            (ay + f32x8::splat(pose.center.y)).to_array(),
            (az + f32x8::splat(pose.center.z)).to_array(),
        ];
        let mut offset = [[0.0f32; BLOCK]; 3];
        let mut normal = [[0.0f32; BLOCK]; 3];
        let mut met = [0.0f32; BLOCK];
        let [at_x, at_y, at_z] = &at;
        let [ox, oy, oz] = &mut offset;
        let [nx, ny, nz] = &mut normal;
        let places = at_x.iter().zip(at_y).zip(at_z);
        let offsets = ox.iter_mut().zip(oy).zip(oz);
        let normals = nx.iter_mut().zip(ny).zip(nz);
        for ((((x, y), z), ((ox, oy), oz)), (((nx, ny), nz), met)) in
            places.zip(offsets).zip(normals.zip(met.iter_mut()))
        {
            let Some(Patch { p: [px, py, pz], n: [qx, qy, qz], .. }) = surface.look(&[*x, *y, *z]) else {
                continue;
            };
            if let Some(from) = viewpoint
                && qx * (from.x - px) + qy * (from.y - py) + qz * (from.z - pz) < 0.0
            {
                continue;
            }
            (*ox, *oy, *oz) = (x - px, y - py, z - pz);
            (*nx, *ny, *nz) = (*qx, *qy, *qz);
            *met = 1.0;
        }
        let (offset, normal) = (offset.map(f32x8::from), normal.map(f32x8::from));
        let height = dot(&offset, &normal);
        let within = (dot(&offset, &offset) - height * height).simd_le(f32x8::splat(rim_m * rim_m));
        let met = within.select(f32x8::from(met), f32x8::ZERO);
        Self { arm, offset, normal, met }
    }
}

#[inline]
fn dot(a: &[f32x8; 3], b: &[f32x8; 3]) -> f32x8 {
    let ([ax, ay, az], [bx, by, bz]) = (*a, *b);
    ax * bx + ay * by + az * bz
}

#[inline]
fn cross(a: &[f32x8; 3], b: &[f32x8; 3]) -> [f32x8; 3] {
    let ([ax, ay, az], [bx, by, bz]) = (*a, *b);
    [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx]
}

/// The normal equations, eight partial sums of each entry.
#[derive(Default)]
struct Sums {
    /// Upper triangle, row by row.
    matrix: [f32x8; 21],
    vector: [f32x8; 6],
}

impl Sums {
    #[inline]
    fn add(&mut self, met: &Met, kernel: f32, point_part: f32) {
        let square = dot(&met.offset, &met.offset);
        let falloff = f32x8::ONE / (f32x8::ONE + square * f32x8::splat(1.0 / (kernel * kernel)));
        let w = met.met * falloff * falloff;
        let p = w * f32x8::splat(point_part);
        let height = dot(&met.offset, &met.normal);
        let [c0, c1, c2] = cross(&met.arm, &met.normal);
        let [n0, n1, n2] = met.normal;
        let [x, y, z] = met.arm;
        let [w0, w1, w2] = [w * c0, w * c1, w * c2];
        let [m0, m1, m2] = [w * n0, w * n1, w * n2];
        let [px, py, pz] = [p * x, p * y, p * z];
        // The point part's Jacobian is (−[arm]×, I).
        let terms = [
            w0 * c0 + py * y + pz * z,
            w0 * c1 - px * y,
            w0 * c2 - px * z,
            w0 * n0,
            w0 * n1 - pz,
            w0 * n2 + py,
            w1 * c1 + px * x + pz * z,
            w1 * c2 - py * z,
            w1 * n0 + pz,
            w1 * n1,
            w1 * n2 - px,
            w2 * c2 + px * x + py * y,
            w2 * n0 - py,
            w2 * n1 + px,
            w2 * n2,
            m0 * n0 + p,
            m0 * n1,
            m0 * n2,
            m1 * n1 + p,
            m1 * n2,
            m2 * n2 + p,
        ];
        for (sum, term) in self.matrix.iter_mut().zip(terms) {
            *sum += term;
        }
        let [e0, e1, e2] = met.offset;
        let [t0, t1, t2] = cross(&met.arm, &met.offset);
        let terms = [
            w0 * height + p * t0,
            w1 * height + p * t1,
            w2 * height + p * t2,
            m0 * height + p * e0,
            m1 * height + p * e1,
            m2 * height + p * e2,
        ];
        for (sum, term) in self.vector.iter_mut().zip(terms) {
            *sum += term;
        }
    }

    /// The step (turn, move); `None`: the system has no solution.
    fn solve(&self) -> Option<Vector6<f64>> {
        let mut matrix = Matrix6::zeros();
        let mut terms = self.matrix.iter();
        for row in 0..6 {
            for column in row..6 {
                let value = f64::from(terms.next()?.reduce_add());
                *matrix.get_mut((row, column))? = value;
                *matrix.get_mut((column, row))? = value;
            }
        }
        for place in 0..6 {
            *matrix.get_mut((place, place))? += DAMPING;
        }
        let vector = Vector6::from_iterator(self.vector.iter().map(|sum| -f64::from(sum.reduce_add())));
        let step = matrix.cholesky()?.solve(&vector);
        let turn = step.fixed_rows::<3>(0).norm();
        step.iter().all(|value| value.is_finite()).then(|| step * (LONGEST_TURN / turn.max(LONGEST_TURN)))
    }
}

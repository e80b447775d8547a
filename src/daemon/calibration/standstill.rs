//! The poses of a recording: stretches in which the Kinect sees nothing move, and what both sensors saw in them.
//!
//! ```text
//!   frames ─ compared with the one 0.3 s before ─ still? ─▶ held back 0.45 s ─▶ mean by pixel ┐
//!   packets ────────────────────────────────────────────▶ held back alike ──▶ points ────────┴▶ View
//! ```
//! A target that begins to move is noticed late: what was seen just before is therefore not used. Arrival times are exact
//! enough: nothing moves.

use std::collections::VecDeque;

use nalgebra::{Isometry3, Point3};
use tumbled_calib::{CameraView, LidarPoint, View};
use tumbled_kinect::{HEIGHT, Points, WIDTH};
use tumbled_model::{RigNs, Span};

/// A frame is compared with the last one at least this much older.
const APART: Span = Span(300_000_000);
/// What a target does before its motion is noticed is left out.
const HELD_BACK: Span = Span(450_000_000);
/// After a motion the target swings out.
const SETTLES: Span = Span(150_000_000);
/// A pose is at least so long; more than `LONGEST` of it is not used.
const SHORTEST: Span = Span(500_000_000);
const LONGEST: Span = Span(2_000_000_000);
/// Pixels compared: every so-manieth in both directions.
const COMPARED: usize = 8;
/// A pixel has moved if its depth changed by more than this many standard deviations of a single one, and by this, m.
const MOVED: (f32, f32) = (5.0, 0.03);
/// Something moves if so many of the compared pixels have.
const MOVING: usize = 20;
/// Of a pose's frames so many must have a depth at a pixel.
const PRESENT: f32 = 0.5;
/// Every so-manieth pixel in both directions is kept: neighbours share their noise.
const KEPT: usize = 2;
/// Poses kept: beyond it a recording is told to be cut.
pub const MOST_POSES: usize = 60;
/// LiDAR points kept of a pose.
const MOST_POINTS: usize = 400_000;
/// The camera's picture, wide enough for any mounting error: tangents.
const IN_SIGHT: (f64, f64) = (0.75, 0.60);
/// Farther away nothing is calibrated with, m.
const FARTHEST_M: f64 = 4.5;

/// A pose, and when it was.
#[derive(Clone, Debug)]
pub struct Still {
    /// Its first instant.
    pub from: RigNs,
    /// Its last one.
    pub until: RigNs,
    /// Frames it is the mean of.
    pub frames: usize,
    /// What was seen.
    pub view: View,
}

/// A frame that waits.
struct Frame {
    t: RigNs,
    /// Pixel and point of those kept.
    points: Vec<(u32, [f32; 3])>,
    coarse: Vec<f32>,
}

/// Sums by pixel.
struct Mean {
    from: RigNs,
    until: RigNs,
    frames: usize,
    sums: Vec<([f64; 3], u32)>,
    lidar: Vec<LidarPoint>,
}

/// Collects poses from frames and packets in the order they arrive.
pub struct Standstill {
    t_camera_lidar: Isometry3<f64>,
    frames: VecDeque<Frame>,
    returns: VecDeque<(RigNs, LidarPoint)>,
    still_since: Option<RigNs>,
    open: Option<Mean>,
    found: Vec<Still>,
    /// Poses beyond [`MOST_POSES`].
    pub left_out: usize,
}

impl Standstill {
    /// With the present place of the camera in the LiDAR's frame: of the LiDAR's points those are kept that it may see.
    pub fn new(t_lidar_camera: &Isometry3<f64>) -> Self {
        Self {
            t_camera_lidar: t_lidar_camera.inverse(),
            frames: VecDeque::new(),
            returns: VecDeque::new(),
            still_since: None,
            open: None,
            found: Vec::new(),
            left_out: 0,
        }
    }

    /// Takes the LiDAR's points of a packet.
    pub fn returns(&mut self, t: RigNs, points: &tumbled_velodyne::Points) {
        // Bounded also where no frame ever comes.
        while self.returns.front().is_some_and(|(before, _)| t - *before > Span(2 * HELD_BACK.0)) {
            self.returns.pop_front();
        }
        for point in points.iter_range(0..points.len()) {
            let seen = self.t_camera_lidar * Point3::from(point.xyz.map(f64::from));
            let (x, y) = (seen.x / seen.z, seen.y / seen.z);
            if seen.z > 0.2 && seen.z < FARTHEST_M && x.abs() < IN_SIGHT.0 && y.abs() < IN_SIGHT.1 {
                self.returns.push_back((t, LidarPoint { xyz: point.xyz, ring: point.ring }));
            }
        }
    }

    /// Takes a frame's points.
    pub fn frame(&mut self, t: RigNs, points: &Points) {
        let frame = frame(t, points);
        let moving = self.moved(&frame);
        if moving {
            self.close();
            self.still_since = None;
            while self.frames.front().is_some_and(|before| t - before.t > Span(2 * APART.0)) {
                self.frames.pop_front();
            }
        } else {
            let since = *self.still_since.get_or_insert(t);
            // What is older than the time held back was still, and stayed so.
            while let Some(old) = self.frames.pop_front_if(|old| t - old.t > HELD_BACK) {
                if old.t >= since + SETTLES {
                    self.absorb(old);
                }
            }
        }
        self.frames.push_back(frame);
    }

    /// Whether something has moved since [`APART`] before a frame; where too few frames are known, yes.
    fn moved(&self, frame: &Frame) -> bool {
        let mut older = self.frames.iter().rev().filter(|before| frame.t - before.t >= APART).map(|b| &b.coarse[..]);
        let mut newer = self.frames.iter().rev().map(|before| &before.coarse[..]);
        let (Some(a), Some(b), Some(c)) = (older.next(), older.next(), older.next()) else { return true };
        let (Some(d), Some(e)) = (newer.next(), newer.next()) else { return true };
        changed([a, b, c], [d, e, &frame.coarse]) >= MOVING
    }

    /// The poses; the last one ends with the recording.
    pub fn finish(mut self) -> (Vec<Still>, usize) {
        self.close();
        (self.found, self.left_out)
    }

    fn absorb(&mut self, frame: Frame) {
        let mean = self.open.get_or_insert_with(|| Mean {
            from: frame.t,
            until: frame.t,
            frames: 0,
            sums: vec![([0.0; 3], 0); (WIDTH / KEPT) * (HEIGHT / KEPT)],
            lidar: Vec::new(),
        });
        let used = frame.t - mean.from <= LONGEST;
        while let Some((t, point)) = self.returns.pop_front_if(|(t, _)| *t <= frame.t) {
            if used && t >= mean.from && mean.lidar.len() < MOST_POINTS {
                mean.lidar.push(point);
            }
        }
        if !used {
            return;
        }
        mean.until = frame.t;
        mean.frames += 1;
        for (pixel, point) in frame.points {
            let (column, row) = (pixel as usize % WIDTH / KEPT, pixel as usize / WIDTH / KEPT);
            if let Some((sum, count)) = mean.sums.get_mut(row * (WIDTH / KEPT) + column) {
                for (sum, value) in sum.iter_mut().zip(point) {
                    *sum += f64::from(value);
                }
                *count += 1;
            }
        }
    }

    fn close(&mut self) {
        let Some(mean) = self.open.take() else { return };
        if mean.until - mean.from < SHORTEST {
            return;
        }
        if self.found.len() >= MOST_POSES {
            self.left_out += 1;
            return;
        }
        let least = (mean.frames as f32 * PRESENT).ceil() as u32;
        let point = |(sum, count): ([f64; 3], u32)| {
            if count >= least.max(1) { sum.map(|sum| (sum / f64::from(count)) as f32) } else { [f32::NAN; 3] }
        };
        let points = mean.sums.into_iter().map(point).collect();
        let camera = CameraView { width: WIDTH / KEPT, height: HEIGHT / KEPT, points };
        let view = View { camera, lidar: mean.lidar };
        self.found.push(Still { from: mean.from, until: mean.until, frames: mean.frames, view });
    }
}

fn frame(t: RigNs, points: &Points) -> Frame {
    let columns = points.x().iter().zip(points.y()).zip(points.z());
    let mut coarse = vec![0.0; (WIDTH / COMPARED) * (HEIGHT / COMPARED)];
    let mut kept = Vec::with_capacity(points.len() / (KEPT * KEPT) + 1);
    for (pixel, ((x, y), z)) in points.pixel().iter().zip(columns) {
        let (column, row) = (*pixel as usize % WIDTH, *pixel as usize / WIDTH);
        if column % KEPT == 0 && row % KEPT == 0 {
            kept.push((*pixel, [*x, *y, *z]));
        }
        if column % COMPARED == 0
            && row % COMPARED == 0
            && let Some(depth) = coarse.get_mut(row / COMPARED * (WIDTH / COMPARED) + column / COMPARED)
        {
            *depth = *z;
        }
    }
    Frame { t, points: kept, coarse }
}

/// How many pixels have moved from three frames to three later ones: all depths of the one lie apart from all of the other.
/// An edge that strays over a pixel in some frames is no motion. Those without a depth in one of them flicker, and do not
/// count.
fn changed(before: [&[f32]; 3], now: [&[f32]; 3]) -> usize {
    let depths = |of: [&[f32]; 3], pixel: usize| {
        let three = of.map(|frame| frame.get(pixel).copied().unwrap_or_default());
        (three.iter().copied().fold(f32::INFINITY, f32::min), three.iter().copied().fold(0.0, f32::max))
    };
    let moved = |pixel: &usize| {
        let ((low, high), (low_now, high_now)) = (depths(before, *pixel), depths(now, *pixel));
        let nearest = low.min(low_now);
        let least = (MOVED.0 * 1.5e-3 * nearest * nearest).max(MOVED.1);
        nearest > 0.0 && f64::from(nearest) < FARTHEST_M && (low_now - high > least || low - high_now > least)
    };
    (0..(WIDTH / COMPARED) * (HEIGHT / COMPARED)).filter(moved).count()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(depth: f32, moved: &[(usize, f32)]) -> Vec<f32> {
        let mut picture = vec![depth; (WIDTH / COMPARED) * (HEIGHT / COMPARED)];
        for (pixel, depth) in moved {
            picture[*pixel] = *depth;
        }
        picture
    }

    #[test]
    fn what_strays_in_one_frame_or_has_no_depth_has_not_moved() {
        let still = picture(2.0, &[]);
        // One pixel moved for good by 5 cm, one for one frame, one lost its depth, one trembles by 2 cm.
        let after = |strayed: f32| picture(2.0, &[(7, 2.05), (8, strayed), (9, 0.0), (10, 2.02)]);
        let (one, other, last) = (after(3.0), after(2.0), after(3.0));
        assert_eq!(changed([&still, &still, &still], [&one, &other, &last]), 1);
        assert_eq!(changed([&still, &still, &still], [&still, &still, &still]), 0);
    }
}

//! Whether poses agree with each other: each left out in turn, odd against even, a fifth held back.

use nalgebra::Isometry3;

use crate::fit::{Fit, PARAMETERS, Unsolved};

/// A pose that moves the result by more than this many standard deviations of the result without it is dropped.
const DROPPED_FROM: f64 = 3.0;
/// Of all poses at most this share is dropped: beyond it nobody knows which are wrong.
pub(crate) const DROPPED_SHARE: f64 = 0.2;
/// Every so-manieth pose is held back.
const HELD_BACK: usize = 5;

/// Poses that can be solved for.
pub trait PoseSet {
    /// Solves with these poses alone, by their places in the set.
    ///
    /// # Errors
    /// [`Unsolved`]: they do not fix the result.
    fn solve(&self, which: &[usize], start: &Isometry3<f64>) -> Result<Fit, Unsolved>;

    /// How far the LiDAR's points of a pose are beyond the surface that the camera alone saw, put into the LiDAR's frame by
    /// a result: sum of squares, sum, count; m.
    fn beyond(&self, pose: usize, fit: &Fit) -> (f64, f64, usize);
}

/// What leaving out a pose did.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeftOut {
    /// Which.
    pub pose: usize,
    /// The largest shift of one parameter, in standard deviations of the result without the pose.
    pub shift_sigma: f64,
    /// How far the rotation turned, degrees.
    pub rotation_deg: f64,
    /// How far the translation moved, mm.
    pub translation_mm: f64,
}

/// Two halves of the poses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Split {
    /// The largest difference of one parameter, in its standard deviations.
    pub sigma: f64,
    /// The rotations' difference, degrees.
    pub rotation_deg: f64,
    /// The translations' difference, mm.
    pub translation_mm: f64,
}

/// The poses held back, against the result of the others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldOut {
    /// How many.
    pub poses: usize,
    /// Root mean square of the LiDAR's points beyond the camera's surface, mm.
    pub rms_mm: f64,
    /// Their mean, mm.
    pub mean_mm: f64,
}

/// The result of the poses that agree, and how well they do.
#[derive(Clone, Debug, PartialEq)]
pub struct Agreement {
    /// The result.
    pub fit: Fit,
    /// The poses it is from.
    pub used: Vec<usize>,
    /// Those that were dropped, with what leaving them out did.
    pub dropped: Vec<LeftOut>,
    /// What leaving out each of those used does; empty where too few are left.
    pub left_out: Vec<LeftOut>,
    /// Odd against even; `None`: a half does not fix the result.
    pub split: Option<Split>,
    /// `None`: the others do not fix the result.
    pub held_out: Option<HeldOut>,
}

impl Agreement {
    /// The same with other numbers for the poses, by their places.
    #[must_use]
    pub(crate) fn renumbered(self, numbers: &[usize]) -> Self {
        let number = |place: usize| numbers.get(place).copied().unwrap_or(place);
        let left =
            |all: Vec<LeftOut>| all.into_iter().map(|left| LeftOut { pose: number(left.pose), ..left }).collect();
        Self {
            used: self.used.iter().map(|place| number(*place)).collect(),
            dropped: left(self.dropped),
            left_out: left(self.left_out),
            ..self
        }
    }
}

/// Solves, drops what moves the result too far, and looks how the rest agrees. `all`: how many poses there were before any was
/// dropped, here or earlier.
///
/// # Errors
/// [`Unsolved`]: the poses do not fix the result.
pub fn agree(
    set: &dyn PoseSet,
    mut used: Vec<usize>,
    all: usize,
    start: &Isometry3<f64>,
) -> Result<Agreement, Unsolved> {
    let may_drop = (DROPPED_SHARE * all as f64) as usize;
    let before = all - used.len();
    let mut dropped: Vec<LeftOut> = Vec::new();
    let (fit, left_out) = loop {
        let fit = set.solve(&used, start)?;
        let left_out: Vec<LeftOut> = used.iter().filter_map(|pose| leave_out(set, &used, *pose, &fit)).collect();
        let worst = left_out.iter().max_by(|a, b| a.shift_sigma.total_cmp(&b.shift_sigma)).copied();
        match worst {
            Some(worst) if worst.shift_sigma > DROPPED_FROM && before + dropped.len() < may_drop => {
                used.retain(|pose| *pose != worst.pose);
                dropped.push(worst);
            }
            _ => break (fit, left_out),
        }
    };
    let split = split(set, &used, &fit);
    let held_out = held_out(set, &used, &fit);
    Ok(Agreement { fit, used, dropped, left_out, split, held_out })
}

fn leave_out(set: &dyn PoseSet, used: &[usize], pose: usize, fit: &Fit) -> Option<LeftOut> {
    let others: Vec<usize> = used.iter().copied().filter(|other| *other != pose).collect();
    let without = set.solve(&others, &fit.t_lidar_camera).ok()?;
    let shift = fit.minus(&without);
    Some(LeftOut {
        pose,
        shift_sigma: Fit::largest_shift(&shift, &without.sigma()),
        rotation_deg: shift.fixed_rows::<3>(0).norm().to_degrees(),
        translation_mm: 1e3 * shift.fixed_rows::<3>(3).norm(),
    })
}

fn split(set: &dyn PoseSet, used: &[usize], fit: &Fit) -> Option<Split> {
    let half = |odd: usize| -> Option<Fit> {
        let which: Vec<usize> = used.iter().copied().skip(odd).step_by(2).collect();
        set.solve(&which, &fit.t_lidar_camera).ok()
    };
    let (even, odd) = (half(0)?, half(1)?);
    let apart = even.minus(&odd);
    let (of_even, of_odd) = (even.sigma(), odd.sigma());
    let both: [f64; PARAMETERS] = core::array::from_fn(|n| {
        let [a, b] = [&of_even, &of_odd].map(|sigma| sigma.get(n).copied().unwrap_or_default());
        (a * a + b * b).sqrt()
    });
    Some(Split {
        sigma: Fit::largest_shift(&apart, &both),
        rotation_deg: apart.fixed_rows::<3>(0).norm().to_degrees(),
        translation_mm: 1e3 * apart.fixed_rows::<3>(3).norm(),
    })
}

fn held_out(set: &dyn PoseSet, used: &[usize], fit: &Fit) -> Option<HeldOut> {
    let is_held = |place: usize| place % HELD_BACK == HELD_BACK / 2;
    let of = |held: bool| -> Vec<usize> {
        used.iter().enumerate().filter(|(place, _)| is_held(*place) == held).map(|(_, pose)| *pose).collect()
    };
    let (held, others) = (of(true), of(false));
    let without = set.solve(&others, &fit.t_lidar_camera).ok()?;
    let (squares, sum, count) = held
        .iter()
        .map(|pose| set.beyond(*pose, &without))
        .fold((0.0, 0.0, 0), |(squares, sum, count), (more_squares, more, points)| {
            (squares + more_squares, sum + more, count + points)
        });
    if count == 0 {
        return None;
    }
    let count = count as f64;
    Some(HeldOut { poses: held.len(), rms_mm: 1e3 * (squares / count).sqrt(), mean_mm: 1e3 * sum / count })
}

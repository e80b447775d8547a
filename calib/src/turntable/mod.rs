//! A turntable's axis in the rig, from poses of what stands on it and the encoder's angles.
//!
//! The model: `R_i = Exp(a g (θ_i − θ_0)) R_0`, `p_i = c + Exp(a g (θ_i − θ_0)) (p_0 − c)`. Unknown are the axis a and a
//! point c on it, the pose at the first angle, and the gain g. The poses are somebody's estimates: what is wrong with all of
//! them alike (where the sensors are) is in the axis too, and no scatter tells it.

mod solve;

use nalgebra::{Isometry3, SMatrix, Unit, UnitQuaternion, Vector3};
use tumbled_model::se3::log_rotation;

use crate::gate::Gate;

/// The least turning that an axis' point is had from, rad: 300°. Of 60° the centre is 8 times as far off.
pub const LEAST_SPAN_RAD: f64 = 300.0 / 180.0 * core::f64::consts::PI;
/// The fewest angles.
pub const LEAST_ANGLES: usize = 12;
/// How far the gain may be from 1: beyond, the stage's units per turn are wrong.
pub const GAIN_OFF: f64 = 0.002;
/// Poses of a filter that turns with the target are independent about every 30° of turning.
pub const INDEPENDENT_RAD: f64 = 30.0 / 180.0 * core::f64::consts::PI;

/// A pose of what stands on the stage, and where the encoder was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TurnedPose {
    /// The encoder's angle, rad, not wrapped.
    pub angle_rad: f64,
    /// Target coordinates to rig coordinates.
    pub t_rig_target: Isometry3<f64>,
}

/// A turntable's axis.
#[derive(Clone, Debug, PartialEq)]
pub struct TurntableFit {
    /// The axis, rig axes: of its two senses the one that is more up, or, lying, more along x, then y.
    pub axis: Unit<Vector3<f64>>,
    /// Its point nearest to the rig's origin, rig frame, m.
    pub point_m: Vector3<f64>,
    /// The angle that the fit counts from, rad.
    pub angle0_rad: f64,
    /// 1 where the target turns counter-clockwise about the axis as the encoder's angle grows, else -1.
    pub sign: f64,
    /// Angle turned over the encoder's.
    pub gain: f64,
    /// One standard deviation of the gain.
    pub gain_sigma: f64,
    /// The pose at `angle0_rad`.
    pub t_rig_target0: Isometry3<f64>,
    /// Covariance of the axis' tilts about [`across`]'s two directions, rad², and of the point's offsets along them, m²;
    /// by the poses' scatter, as many of them as are independent.
    pub covariance: SMatrix<f64, 4, 4>,
    /// Poses used.
    pub poses: usize,
    /// Of them independent: they are [`INDEPENDENT_RAD`] of turning apart, or each by itself as asked.
    pub independent: usize,
    /// From the smallest to the largest angle, rad.
    pub span_rad: f64,
    /// Scatter of the poses' rotation about the fit, one axis, rad, and of their place, m.
    pub scatter: (f64, f64),
    /// By pose: rotation vector, rad, and offset, m, of the pose from the fit, rig axes.
    pub residuals: Vec<(Vector3<f64>, Vector3<f64>)>,
}

/// Why there is no axis.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NoAxis {
    /// Too little turning.
    #[error(
        "the stage turned by {found_deg:.0}° in all and {least_deg:.0}° are the least: of less the axis' point is not had. \
         Record at least one whole turn"
    )]
    Span {
        /// Turned, degrees.
        found_deg: f64,
        /// The least, degrees.
        least_deg: f64,
    },
    /// Too few poses.
    #[error(
        "{found} angles of the stage with a pose, and {least} are the least: was the target tracked while it turned?"
    )]
    Few {
        /// Angles there are.
        found: usize,
        /// The least.
        least: usize,
    },
    /// The poses do not turn with the encoder.
    #[error(
        "the poses turn by {poses_deg:.0}° about one axis while the encoder turns by {encoder_deg:.0}°: the target does not \
         stand on this stage, or its estimate stays behind"
    )]
    Apart {
        /// Of the poses, degrees.
        poses_deg: f64,
        /// Of the encoder, degrees.
        encoder_deg: f64,
    },
    /// The numbers do not settle.
    #[error("no axis fits the poses: they jump, or the target was lost and found in another frame")]
    Unsettled,
}

/// The two directions across an axis that covariances are of: the rig's x axis without its part along the axis (y's where
/// the axis lies nearer to x than 45°), and what completes a right-handed set with the axis last.
pub fn across(axis: &Unit<Vector3<f64>>) -> [Vector3<f64>; 2] {
    let seed = if axis.x.abs() > core::f64::consts::FRAC_1_SQRT_2 { Vector3::y() } else { Vector3::x() };
    let first = (seed - axis.scale(axis.dot(&seed))).normalize();
    [first, axis.cross(&first)]
}

/// The axis by the poses' steps alone, signed as the encoder counts, not normalised: its length is the angle turned, rad,
/// to and fro taken together. Steps of 180° and more are left out.
pub fn stepwise_axis(poses: &[TurnedPose]) -> Vector3<f64> {
    let steps = poses.iter().zip(poses.iter().skip(1));
    let step = |(before, after): (&TurnedPose, &TurnedPose)| {
        let turned = after.angle_rad - before.angle_rad;
        if turned.abs() >= core::f64::consts::PI {
            return Vector3::zeros();
        }
        let rotation = after.t_rig_target.rotation * before.t_rig_target.rotation.inverse();
        log_rotation(&rotation) * turned.signum()
    };
    steps.map(step).sum()
}

/// Finds the axis. `correlated`: neighbouring poses are a filter's, and independent only every [`INDEPENDENT_RAD`].
///
/// # Errors
/// [`NoAxis`], in words.
pub fn turntable(poses: &[TurnedPose], correlated: bool) -> Result<TurntableFit, NoAxis> {
    let angles = || poses.iter().map(|pose| pose.angle_rad);
    let (from, to) = (angles().fold(f64::INFINITY, f64::min), angles().fold(f64::NEG_INFINITY, f64::max));
    let travel: f64 = poses.iter().zip(poses.iter().skip(1)).map(|(a, b)| (b.angle_rad - a.angle_rad).abs()).sum();
    let span_rad = (to - from).max(0.0);
    let independent = if correlated { poses.len().min((travel / INDEPENDENT_RAD) as usize) } else { poses.len() };
    if poses.len() < LEAST_ANGLES {
        return Err(NoAxis::Few { found: poses.len(), least: LEAST_ANGLES });
    }
    if span_rad < LEAST_SPAN_RAD {
        return Err(NoAxis::Span { found_deg: span_rad.to_degrees(), least_deg: LEAST_SPAN_RAD.to_degrees() });
    }
    if independent < LEAST_ANGLES - 2 {
        return Err(NoAxis::Few { found: independent, least: LEAST_ANGLES - 2 });
    }
    let stepwise = stepwise_axis(poses);
    let ratio = stepwise.norm() / travel;
    let Some(axis) = Unit::try_new(stepwise, 1e-9).filter(|_| (0.8..=1.25).contains(&ratio)) else {
        let (poses_deg, encoder_deg) = (stepwise.norm().to_degrees(), travel.to_degrees());
        return Err(NoAxis::Apart { poses_deg, encoder_deg });
    };
    let solved = solve::solve(poses, axis, ratio).ok_or(NoAxis::Unsettled)?;
    Ok(solved.finish(poses, independent, span_rad))
}

impl TurntableFit {
    /// One standard deviation of the axis, rad: the larger of the two tilts.
    pub fn axis_sigma_rad(&self) -> f64 {
        self.largest_sigma(0)
    }

    /// One standard deviation of the axis' point, m: the larger of the two offsets.
    pub fn point_sigma_m(&self) -> f64 {
        self.largest_sigma(2)
    }

    fn largest_sigma(&self, from: usize) -> f64 {
        let block = self.covariance.view((from, from), (2, 2)).into_owned();
        block.symmetric_eigenvalues().max().max(0.0).sqrt()
    }

    /// How far what stands on the stage is turned at an angle of the encoder, as a rotation of the rig's frame.
    pub fn turned(&self, angle_rad: f64) -> UnitQuaternion<f64> {
        UnitQuaternion::from_axis_angle(&self.axis, self.sign * self.gain * (angle_rad - self.angle0_rad))
    }

    /// The pose of the target that stood in `t_rig_target0`, at an angle of the encoder.
    pub fn pose(&self, angle_rad: f64) -> Isometry3<f64> {
        let turned = self.turned(angle_rad);
        let place = self.point_m + turned * (self.t_rig_target0.translation.vector - self.point_m);
        Isometry3::from_parts(place.into(), turned * self.t_rig_target0.rotation)
    }

    /// What the result has to reach.
    pub fn gates(&self) -> Vec<Gate> {
        let gain_bound = GAIN_OFF.max(3.0 * self.gain_sigma);
        vec![
            Gate::at_least(
                "turned",
                self.span_rad.to_degrees(),
                "deg",
                (Some(350.0), Some(LEAST_SPAN_RAD.to_degrees())),
                "record a whole turn of the stage, better two",
            ),
            Gate::at_least(
                "independent angles",
                self.independent as f64,
                "",
                (Some(LEAST_ANGLES as f64), None),
                "record more turns",
            ),
            Gate::at_most(
                "sigma of the axis",
                self.axis_sigma_rad().to_degrees(),
                "deg",
                (Some(0.1), Some(0.5)),
                "record more turns, slowly, with more of the target's sides in view",
            ),
            Gate::at_most(
                "sigma of the axis' point",
                1e3 * self.point_sigma_m(),
                "mm",
                (Some(2.0), Some(10.0)),
                "record more turns, slowly, with more of the target's sides in view",
            ),
            Gate::at_most(
                "gain less 1",
                (self.gain - 1.0).abs(),
                "",
                (None, Some(gain_bound)),
                "the stage's units per turn are wrong: set [turntable] counts_per_turn, a gear counts in",
            ),
            Gate::at_most(
                "scatter of the attitude",
                self.scatter.0.to_degrees(),
                "deg",
                (Some(1.0), Some(5.0)),
                "the estimate does not follow the stage well: look at `evaluate --truth turntable`",
            ),
        ]
    }
}

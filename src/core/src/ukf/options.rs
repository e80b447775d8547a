//! What the filter has to be told: the target's motion, the sensors' priors, the way calibration is treated.

use super::clohessy_wiltshire::ClohessyWiltshire;
use crate::register::SensorKind;
use core::f64::consts::PI;
use nalgebra::{Isometry3, Matrix6, Vector6};
use tumbled_model::RigNs;

const DEGREE: f64 = PI / 180.0;

/// Which filter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FilterMethod {
    /// Cubature points in square-root form, a linear update on body twists, calibration in the state.
    #[default]
    Cubature,
    /// The published algorithm: scaled points of the error twistor through motion and observation, 12 states, poses
    /// taken at their own covariance. For comparison.
    Paper,
}

/// How the target turns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Motion {
    /// About an axis that stays.
    #[default]
    FixedAxis,
    /// Free of torque, its inertia unknown.
    FreeTumble,
}

/// What becomes of the sensors' slow errors: extrinsics, warp, beam tilt, time.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CalibrationTreatment {
    /// They are states, estimated.
    #[default]
    Estimated,
    /// They widen the noise of every pose: slower, and hard to mislead.
    Inflated,
}

/// Settings of the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilterOptions {
    /// Which filter.
    pub method: FilterMethod,
    /// How the target turns.
    pub motion: Motion,
    /// What becomes of the sensors' slow errors. Of no effect for [`FilterMethod::Paper`].
    pub calibration: CalibrationTreatment,
    /// Mean motion n of the orbit, rad/s; 0 is uniform motion, as on a rig. The rig's axes are then x radially out,
    /// y along the track, z along the orbit's normal.
    pub mean_motion_rps: f64,
    /// The orbit's point of reference, rig frame, m.
    pub orbit_center_m: [f64; 3],
    /// White acceleration, m/s^1.5.
    pub q_acceleration: f64,
    /// White angular acceleration, rad/s^1.5.
    pub q_angular: f64,
    /// Angle travelled over which a sensor's slow error is forgotten, rad.
    pub correlation_angle_rad: f64,
    /// Prior of the centre of mass's place about the target frame's origin, one axis, m.
    pub sigma_center_of_mass_m: f64,
    /// Prior of the five numbers of the inertia's logarithm.
    pub sigma_inertia: f64,
}

impl FilterOptions {
    /// For a target on a turntable or stably spinning: 0.001 °/s^1.5.
    pub const fn fixed_axis() -> Self {
        Self {
            method: FilterMethod::Cubature,
            motion: Motion::FixedAxis,
            calibration: CalibrationTreatment::Estimated,
            mean_motion_rps: 0.0,
            orbit_center_m: [0.0; 3],
            q_acceleration: 3e-5,
            q_angular: 0.001 * DEGREE,
            correlation_angle_rad: 30.0 * DEGREE,
            sigma_center_of_mass_m: 0.06,
            sigma_inertia: 0.3,
        }
    }

    /// The orbit's part of a motion of `dt` s.
    pub(super) fn orbit(&self, dt: f64) -> ClohessyWiltshire {
        ClohessyWiltshire::new(self.mean_motion_rps, dt).about(self.orbit_center_m)
    }

    /// For a target that tumbles: 0.01 °/s^1.5, inertia unknown.
    pub const fn free_tumble() -> Self {
        Self { motion: Motion::FreeTumble, q_angular: 0.01 * DEGREE, ..Self::fixed_axis() }
    }

    /// For the published filter: 0.02 °/s^1.5, and 1 cm/s^1.5, for its frame's origin circles about the axis and it has no
    /// state for that.
    pub const fn paper() -> Self {
        Self { method: FilterMethod::Paper, q_acceleration: 0.01, q_angular: 0.02 * DEGREE, ..Self::fixed_axis() }
    }
}

impl Default for FilterOptions {
    fn default() -> Self {
        Self::fixed_axis()
    }
}

/// What the rig's file says of an extrinsic calibration, and what is known of the sensor kind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StatedUncertainty {
    /// Of the extrinsic's rotation, one axis, rad.
    pub rotation_rad: f64,
    /// Of the extrinsic's translation, one axis, m.
    pub translation_m: f64,
    /// Of the stamps' offset, s; read for a Kinect.
    pub time_s: f64,
    /// Of a Kinect's depth scale, relative.
    pub depth_scale: f64,
}

impl Default for StatedUncertainty {
    /// 0.2° and 4 mm over the three axes together, 2 ms, 0.3 %.
    fn default() -> Self {
        Self { rotation_rad: 0.115 * DEGREE, translation_m: 0.0023, time_s: 0.002, depth_scale: 0.003 }
    }
}

/// What is known of one sensor beforehand. Standard deviations, rotation first, rad and m.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SensorPrior {
    /// What it is. Of poses of one time a Kinect's is taken before a LiDAR's.
    pub kind: SensorKind,
    /// Where its constant error is expressed: the sensor's axes in the rig, with the origin at the target's nominal
    /// centre. About the sensor's own origin rotation and translation could not be told apart.
    pub nominal: Isometry3<f64>,
    /// Of its constant error: extrinsic, warp, beam tilt. In the axes of `nominal`.
    pub sigma_e: Vector6<f64>,
    /// Of its slow error, in the body's axes.
    pub sigma_b: Vector6<f64>,
    /// Of its stamps' offset, s. Estimated for a Kinect only.
    pub sigma_time_s: f64,
}

/// How far the biases of a LiDAR's beams tilt what it sees: 0.7° for 24 beams over 0.6 m, rad.
pub(crate) const BEAM_TILT_RAD: f64 = 0.7 * DEGREE;

/// Of a Kinect's slow error, one axis, rad and m, up to a distance, m; beyond it grows with the square of the distance, as the
/// steps of its depth do: where the target's narrow side is one step deep, a pose is off by more than its noise says.
const KINECT_SLOW: (f64, f64) = (0.15 * DEGREE, 0.0015);
const KINECT_SLOW_TO_M: f64 = 2.2;

/// Between the nominal centre and the place where rotation turns the cloud, m.
const CENTER_M: f64 = 0.004;

impl SensorPrior {
    /// A Kinect `distance_m` from the target: to the extrinsic come the depth's warp and its scale.
    pub fn kinect(nominal: Isometry3<f64>, distance_m: f64, stated: &StatedUncertainty) -> Self {
        let warp = [0.25 * DEGREE, 0.25 * DEGREE, 0.05 * DEGREE, 0.001, 0.001, 0.003];
        let scale = [0.0, 0.0, 0.0, 0.0, 0.0, stated.depth_scale * distance_m];
        let sigma_e = extrinsic(distance_m, stated).zip_map(&Vector6::from(warp), length);
        let far = (distance_m / KINECT_SLOW_TO_M).max(1.0);
        Self {
            kind: SensorKind::Kinect,
            nominal,
            sigma_e: sigma_e.zip_map(&Vector6::from(scale), length),
            sigma_b: per_axis(KINECT_SLOW.0, KINECT_SLOW.1) * (far * far),
            sigma_time_s: stated.time_s,
        }
    }

    /// A LiDAR `distance_m` from the target: to the extrinsic comes the tilt of its beams' biases, 0.7° for 24 beams over
    /// 0.6 m. A narrower prior lets the first crossings settle the extrinsic wrongly for good.
    pub fn lidar(nominal: Isometry3<f64>, distance_m: f64, stated: &StatedUncertainty) -> Self {
        Self {
            kind: SensorKind::Lidar,
            nominal,
            sigma_e: extrinsic(distance_m, stated).zip_map(&per_axis(BEAM_TILT_RAD, 0.0), length),
            sigma_b: per_axis(0.45 * DEGREE, 0.005),
            sigma_time_s: 0.0,
        }
    }
}

/// The extrinsic's error at the target: its rotation moves the target sideways too.
fn extrinsic(distance_m: f64, stated: &StatedUncertainty) -> Vector6<f64> {
    let aside = length(stated.translation_m, stated.rotation_rad * distance_m);
    per_axis(stated.rotation_rad, length(aside, CENTER_M))
}

fn per_axis(rotation: f64, translation: f64) -> Vector6<f64> {
    Vector6::new(rotation, rotation, rotation, translation, translation, translation)
}

fn length(a: f64, b: f64) -> f64 {
    libm::sqrt(a * a + b * b)
}

/// One sensor's pose of the target at one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseMeasurement {
    /// Its time.
    pub t: RigNs,
    /// Which of the priors is its sensor's.
    pub sensor: usize,
    /// Target to rig, as the sensor's points with the file's extrinsic fit the target's model.
    pub pose: Isometry3<f64>,
    /// Information of its body twist `ξ` in `T Exp(ξ)`, rotation first, from the residuals' noise alone.
    pub information: Matrix6<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn priors_hold_what_the_file_says_and_what_the_sensor_adds() {
        let stated = StatedUncertainty::default();
        let kinect = SensorPrior::kinect(Isometry3::identity(), 2.0, &stated);
        // sqrt(0.115² + 0.25²) = 0.2752°; along the sight sqrt(2.3² + (2000·0.115°)² + 4² + 3² + 6²) mm, 0.115° = 2.007 mrad.
        assert!((kinect.sigma_e[0] / DEGREE - 0.2752).abs() < 1e-4);
        assert!((kinect.sigma_e[5] - 9.06e-3).abs() < 2e-5, "{}", kinect.sigma_e[5]);
        // The slow error stays up to 2.2 m; at 3.3 m it is 2.25 times as much.
        assert!((kinect.sigma_b[0] / DEGREE - 0.15).abs() < 1e-12);
        let far = SensorPrior::kinect(Isometry3::identity(), 3.3, &stated);
        assert!((far.sigma_b[0] / DEGREE - 0.3375).abs() < 1e-12 && (far.sigma_b[3] - 3.375e-3).abs() < 1e-12);
        let lidar = SensorPrior::lidar(Isometry3::identity(), 2.0, &stated);
        // sqrt(0.115² + 0.7²) = 0.7094°.
        assert!((lidar.sigma_e[1] / DEGREE - 0.7094).abs() < 1e-4);
        assert!(lidar.sigma_time_s == 0.0 && kinect.sigma_time_s == 0.002);
    }
}

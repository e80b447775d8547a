//! What a simulated Kinect does wrong, and how much of it.

use crate::kinect::law::DepthLaw;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The simulated device. The defaults are a Kinect v1 as measured; numbers without a source are choices, and said to be.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct KinectParameters {
    /// Its depth law.
    pub law: DepthLaw,
    /// From infrared camera to infrared projector along +x, m. The projector lies on the camera's right: in recorded
    /// frames ten of eleven shadows lie left of the near surface.
    pub baseline_m: f64,
    /// From the first row's exposure to the last's, s: row v is seen at t + readout · (v/480 − 1/2). 0 to 0.033.
    pub readout_s: f64,
    /// Measured depth over true depth.
    pub depth_scale: f64,
    /// Disparity noise as a share of the measured one; 0 = none.
    pub noise_share: f64,
    /// The most a smooth surface over the image, drawn by the seed, adds to the depth when the device is warm, m.
    pub warp_m: f64,
    /// How much of it is there at the session's start.
    pub warp_cold_share: f64,
    /// Time constant of the rest, s.
    pub warp_warm_up_s: f64,
    /// Nearer there is no data, m.
    pub nearest_m: f64,
    /// Farther there is no data, m.
    pub farthest_m: f64,
    /// Angle between ray and normal from which pixels are lost, degrees.
    pub incidence_from_deg: f64,
    /// Angle from which all are lost, degrees.
    pub incidence_to_deg: f64,
    /// Where a dark surface is lost at normal incidence, m; at an angle its square root of the cosine of that. A choice.
    pub dark_farthest_m: f64,
    /// Angle from which metal foil is mostly lost, degrees; the border is ragged by 5° either way. A choice.
    pub foil_incidence_deg: f64,
    /// Share of foil pixels that return beyond it. A choice.
    pub foil_survival: f64,
    /// How far an edge strays from its place, standard deviation in px; cut off at 4 px. 0 = straight edges.
    pub edge_px: f64,
    /// Of the pixels an edge strays over, how many lie between fore- and background. A choice.
    pub flying_share: f64,
}

impl Default for KinectParameters {
    fn default() -> Self {
        Self {
            law: DepthLaw::default(),
            baseline_m: 0.075,
            readout_s: 0.0,
            depth_scale: 1.0,
            noise_share: 1.0,
            warp_m: 0.005,
            warp_cold_share: 0.6,
            warp_warm_up_s: 600.0,
            // The smallest depth in recorded frames is 468 mm; noise was measured up to 7 m.
            nearest_m: 0.45,
            farthest_m: 7.0,
            incidence_from_deg: 70.0,
            incidence_to_deg: 80.0,
            dark_farthest_m: 2.5,
            foil_incidence_deg: 45.0,
            foil_survival: 0.05,
            edge_px: 1.5,
            flying_share: 0.15,
        }
    }
}

/// A parameter no device has.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("{name} = {found}, expected {least} to {greatest}")]
pub struct ParameterError {
    /// Which one.
    pub name: &'static str,
    /// What was given.
    pub found: f64,
    /// The least that is taken.
    pub least: f64,
    /// The greatest that is taken.
    pub greatest: f64,
}

impl KinectParameters {
    /// Whether these can be simulated.
    ///
    /// # Errors
    /// [`ParameterError`]: the first parameter that cannot.
    pub fn check(&self) -> Result<(), ParameterError> {
        let parameters = [
            ("law.step_per_m", self.law.step_per_m, 1e-4, 1e-1),
            ("law.pole", self.law.pole, 500.0, 2_047.0),
            ("baseline_m", self.baseline_m, 0.0, 0.2),
            ("readout_s", self.readout_s, 0.0, 0.033),
            ("depth_scale", self.depth_scale, 0.5, 2.0),
            ("noise_share", self.noise_share, 0.0, 10.0),
            ("warp_m", self.warp_m, 0.0, 0.1),
            ("warp_cold_share", self.warp_cold_share, 0.0, 1.0),
            ("warp_warm_up_s", self.warp_warm_up_s, 1.0, 1e6),
            ("nearest_m", self.nearest_m, 0.25, 100.0),
            ("farthest_m", self.farthest_m, self.nearest_m, 100.0),
            ("incidence_from_deg", self.incidence_from_deg, 0.0, 90.0),
            ("incidence_to_deg", self.incidence_to_deg, self.incidence_from_deg, 90.0),
            ("dark_farthest_m", self.dark_farthest_m, 0.0, 100.0),
            ("foil_incidence_deg", self.foil_incidence_deg, 0.0, 90.0),
            ("foil_survival", self.foil_survival, 0.0, 1.0),
            ("edge_px", self.edge_px, 0.0, 4.0),
            ("flying_share", self.flying_share, 0.0, 1.0),
        ];
        let wrong = parameters.into_iter().find(|(_, found, least, greatest)| !(*least..=*greatest).contains(found));
        match wrong {
            Some((name, found, least, greatest)) => Err(ParameterError { name, found, least, greatest }),
            None => Ok(()),
        }
    }

    /// The device without its faults: the law, its rounding and its shadows are left.
    pub fn ideal() -> Self {
        Self { noise_share: 0.0, warp_m: 0.0, edge_px: 0.0, flying_share: 0.0, ..Self::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impossible_parameters_are_named() {
        let usual = KinectParameters::default();
        assert_eq!(usual.check(), Ok(()));
        assert_eq!(KinectParameters::ideal().check(), Ok(()));
        let wrong = KinectParameters { incidence_to_deg: 60.0, ..usual }.check().unwrap_err();
        assert_eq!(wrong.to_string(), "incidence_to_deg = 60, expected 70 to 90");
        assert!(KinectParameters { edge_px: f64::NAN, ..usual }.check().is_err());
    }
}

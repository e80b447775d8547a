//! What a simulated Velodyne is told.

use super::position::Gps;
use super::schedule::View;
use super::surface::Surfaces;
use crate::clock::SimClock;
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};
use tumbled_model::{Span, UnixNs};
use tumbled_velodyne::hdl64::{Calibration, Generation};
use tumbled_velodyne::{Model, ReturnMode};

/// A sensor's settings.
#[derive(Clone, Debug)]
pub struct LidarConfig {
    /// Its name: streams of random numbers go by it.
    pub id: String,
    /// Which sensor.
    pub head: Head,
    /// Which returns it reports.
    pub mode: ReturnMode,
    /// Turns a minute of its own clock, 1..=1200 (real ones: 300, 600, 1200).
    pub rpm: u32,
    /// Where the head points at the session's start, degrees clockwise from above.
    pub start_azimuth_deg: f64,
    /// What it looks at.
    pub view: View,
    /// Whether beams leave at the heights that their elevations tell; `None`: as the decoder takes it for the model.
    pub vertical_offsets: Option<bool>,
    /// Its frame into the rig's: x forward at azimuth 0, y left, z up.
    pub t_rig_lidar: Isometry3<f64>,
    /// Its clock.
    pub clock: SimClock,
    /// What it has of GPS.
    pub gps: Gps,
    /// From one position packet to the next, by its own clock; real ones send 40 to 280 a second.
    pub position_every: Span,
    /// UTC at the session's start, for sentences.
    pub unix_at_zero: UnixNs,
    /// How well it measures.
    pub parameters: LidarParameters,
}

/// Which sensor.
#[derive(Clone, Debug)]
pub enum Head {
    /// A model whose geometry is built in.
    BuiltIn(Model),
    /// An HDL-64E S2 or S3 with its factory calibration.
    Hdl64e {
        /// S2 or S3.
        generation: Generation,
        /// Its lasers; [`super::made_calibration`] has some.
        calibration: Box<Calibration>,
    },
}

/// How well a sensor measures.
///
/// Ranges: data sheets say ±30 mm (VLP-32C, typical) of one beam; the split into white noise and a beam's own bias is
/// that of the accuracy scenes. Footprint: 3 mrad. Encoder: block azimuths of real captures scatter by ±0.02°, taken as
/// three standard deviations. Pulse: returns closer than about a metre are not told apart (dual return, VLP manuals).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct LidarParameters {
    /// Standard deviation of a single range, m.
    pub range_sigma_m: f64,
    /// Standard deviation of the beams' biases, m; each beam's is fixed for a seed.
    pub beam_bias_sigma_m: f64,
    /// Whole width of a beam, mrad; 0: a line.
    pub footprint_mrad: f64,
    /// Returns closer together than this become one, m.
    pub pulse_m: f64,
    /// Standard deviation of a block's azimuth reading, degrees.
    pub encoder_sigma_deg: f64,
    /// Standard deviation of the reflectivity, counts of 255.
    pub intensity_sigma: f64,
    /// The materials.
    pub surfaces: Surfaces,
}

impl Default for LidarParameters {
    fn default() -> Self {
        Self {
            range_sigma_m: 0.015,
            beam_bias_sigma_m: 0.010,
            footprint_mrad: 3.0,
            pulse_m: 0.9,
            encoder_sigma_deg: 0.007,
            intensity_sigma: 2.0,
            surfaces: Surfaces::default(),
        }
    }
}

/// Settings no sensor has.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LidarError {
    /// A model without built-in geometry.
    #[error("an HDL-64E has no built-in geometry: give it a generation and a calibration")]
    NoCalibration,
    /// A generation that is not simulated in this mode.
    #[error("HDL-64E {generation:?} in {mode} return is not simulated: S2 has single return, S3 single and dual")]
    Generation {
        /// The generation asked for.
        generation: Generation,
        /// The mode asked for.
        mode: ReturnMode,
    },
    /// A speed outside 1..=1200.
    #[error("{0} rpm: 1 to 1200 expected")]
    Speed(u32),
    /// A sector that ends before it begins, or is no part of a turn.
    #[error("view from {from_deg}° to {to_deg}°: at least 1° and less than 360° clockwise expected")]
    View {
        /// Its beginning.
        from_deg: f64,
        /// Its end.
        to_deg: f64,
    },
    /// A number that is not finite or is negative where it cannot be.
    #[error("{name} is {found}: a finite number of at least 0 expected")]
    Number {
        /// Which setting.
        name: &'static str,
        /// What it is.
        found: f64,
    },
}

impl LidarConfig {
    /// The model.
    pub fn model(&self) -> Model {
        match &self.head {
            Head::BuiltIn(model) => *model,
            Head::Hdl64e { .. } => Model::Hdl64e,
        }
    }

    /// Looks for settings no sensor has.
    pub(super) fn check(&self) -> Result<(), LidarError> {
        if !(1..=1_200).contains(&self.rpm) {
            return Err(LidarError::Speed(self.rpm));
        }
        if let View::Sector { from_deg, to_deg } = self.view {
            let width = to_deg - from_deg;
            // A narrower one may lie between two firings of a turn, and a real sensor cannot be set to it.
            let a_part = (1.0..360.0).contains(&width) && from_deg.is_finite();
            if !a_part {
                return Err(LidarError::View { from_deg, to_deg });
            }
        }
        let parameters = &self.parameters;
        for (name, found) in [
            ("range_sigma_m", parameters.range_sigma_m),
            ("beam_bias_sigma_m", parameters.beam_bias_sigma_m),
            ("footprint_mrad", parameters.footprint_mrad),
            ("pulse_m", parameters.pulse_m),
            ("encoder_sigma_deg", parameters.encoder_sigma_deg),
            ("intensity_sigma", parameters.intensity_sigma),
        ] {
            if !found.is_finite() || found < 0.0 {
                return Err(LidarError::Number { name, found });
            }
        }
        if !self.start_azimuth_deg.is_finite() {
            return Err(LidarError::Number { name: "start_azimuth_deg", found: self.start_azimuth_deg });
        }
        Ok(())
    }
}

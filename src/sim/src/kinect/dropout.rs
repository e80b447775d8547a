//! Which surfaces give no data.

use crate::kinect::parameters::KinectParameters;
use crate::noise::Noise;
use crate::shape::Material;

/// Limits in the form the loop over the pixels needs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Dropout {
    nearest: f64,
    farthest: f64,
    /// Squared cosine of the incidence from which pixels are lost.
    grazing: f64,
    from_deg: f64,
    to_deg: f64,
    dark_farthest_m: f64,
    foil_deg: f64,
    foil_survival: f64,
}

/// Half the width of the border beyond which foil is lost, degrees.
const FOIL_BORDER_DEG: f64 = 5.0;
/// The same for dark surfaces, as a share of their range.
const DARK_BORDER: f64 = 0.05;

impl Dropout {
    pub(super) fn new(parameters: &KinectParameters) -> Self {
        let cos = libm::cos(parameters.incidence_from_deg.to_radians());
        Self {
            nearest: parameters.nearest_m,
            farthest: parameters.farthest_m,
            grazing: cos * cos,
            from_deg: parameters.incidence_from_deg,
            to_deg: parameters.incidence_to_deg,
            dark_farthest_m: parameters.dark_farthest_m,
            foil_deg: parameters.foil_incidence_deg,
            foil_survival: parameters.foil_survival,
        }
    }

    /// Whether a pixel returns nothing. `cos_squared`: of the incidence; `border`: a smooth number of standard deviation 1
    /// that makes borders ragged, asked for only near one; `chance`: the row's dice.
    pub(super) fn loses(
        &self,
        metres: f64,
        cos_squared: f64,
        material: Material,
        border: impl Fn() -> f64,
        chance: &mut Noise,
    ) -> bool {
        if !(self.nearest..=self.farthest).contains(&metres) {
            return true;
        }
        if cos_squared < self.grazing {
            // Half the pixels are lost in the middle, all at the end.
            let half = (self.to_deg - self.from_deg) / 2.0;
            let limit = self.from_deg + half * (1.0 + (border() / 2.0).clamp(-1.0, 1.0));
            if incidence_deg(cos_squared) >= limit {
                return true;
            }
        }
        match material {
            Material::Matt => false,
            // The light that comes back goes with the cosine over the square of the distance.
            Material::Dark => {
                let limit = self.dark_farthest_m * cos_squared.sqrt().sqrt();
                metres > limit * (1.0 + DARK_BORDER * (border() / 2.0).clamp(-1.0, 1.0))
            }
            Material::Foil => {
                let limit = self.foil_deg + FOIL_BORDER_DEG * (border() / 2.0).clamp(-1.0, 1.0);
                incidence_deg(cos_squared) > limit && !chance.chance(self.foil_survival)
            }
        }
    }
}

fn incidence_deg(cos_squared: f64) -> f64 {
    libm::acos(cos_squared.clamp(0.0, 1.0).sqrt()).to_degrees()
}

//! What a laser pulse gets back from a surface.

use crate::shape::Material;
use serde::{Deserialize, Serialize};

/// How the materials answer 905 nm pulses.
///
/// No measurement of this rig's materials exists; the numbers are chosen so that the three behave as they are known to:
/// matt paint always answers, black paint and velvet weakly, foil like a mirror. They are parameters for that reason.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Surfaces {
    /// Light and diffuse.
    pub matt: Surface,
    /// Black.
    pub dark: Surface,
    /// Metal foil.
    pub foil: Surface,
}

/// One material.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Surface {
    /// Diffuse reflectivity, 0..1.
    pub reflectivity: f64,
    /// Mirror-like reflectivity on top of it within the lobe below; beyond 1 is retroreflection's scale, 2.55 the end.
    pub gloss: f64,
    /// Half-width of the mirror's lobe about the normal, degrees.
    pub lobe_deg: f64,
    /// Incidence up to which every pulse returns, degrees.
    pub sure_deg: f64,
    /// Incidence from which none does, degrees; in between ever fewer.
    pub blind_deg: f64,
    /// Distance at which one of e pulses returns, m: what comes back grows too weak. Others do by exp(−(r/fade)⁴).
    pub fade_m: f64,
}

impl Default for Surfaces {
    fn default() -> Self {
        let matt =
            Surface { reflectivity: 0.6, gloss: 0.0, lobe_deg: 0.0, sure_deg: 80.0, blind_deg: 88.0, fade_m: 150.0 };
        Self {
            matt,
            dark: Surface { reflectivity: 0.04, sure_deg: 45.0, blind_deg: 75.0, fade_m: 5.0, ..matt },
            foil: Surface { reflectivity: 0.1, gloss: 2.4, lobe_deg: 8.0, sure_deg: 15.0, blind_deg: 50.0, ..matt },
        }
    }
}

/// What comes back from one spot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Answer {
    /// How much, as a share of what a white diffuse surface gives back at normal incidence.
    pub(super) brightness: f64,
    /// How likely it is to be detected when it fills the beam, 0..1.
    pub(super) detection: f64,
}

impl Surfaces {
    /// The answer at a distance and a cosine of incidence.
    pub(super) fn answer(&self, material: Material, range_m: f64, cos_incidence: f64) -> Answer {
        let surface = match material {
            Material::Matt => &self.matt,
            Material::Dark => &self.dark,
            Material::Foil => &self.foil,
        };
        let cos = cos_incidence.clamp(0.0, 1.0);
        let incidence_deg = libm::acos(cos).to_degrees();
        let lobe = if surface.lobe_deg > 0.0 { incidence_deg / surface.lobe_deg } else { f64::INFINITY };
        let brightness = surface.reflectivity * cos + surface.gloss * libm::exp(-lobe * lobe);
        let grazing = (surface.blind_deg - incidence_deg) / (surface.blind_deg - surface.sure_deg).max(1e-9);
        let far = range_m / surface.fade_m;
        let far2 = far * far;
        Answer { brightness, detection: grazing.clamp(0.0, 1.0) * libm::exp(-far2 * far2) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn detection(material: Material, range_m: f64, deg: f64) -> f64 {
        Surfaces::default().answer(material, range_m, libm::cos(deg.to_radians())).detection
    }

    #[test]
    fn matt_answers_at_every_usual_incidence_and_dark_and_foil_do_not() {
        assert!(detection(Material::Matt, 3.0, 79.0) > 0.99);
        assert_eq!(detection(Material::Matt, 3.0, 89.0), 0.0);
        // exp(−(3/5)⁴) = 0.8784; at 60° half of that: halfway from 45° to 75°.
        assert!((detection(Material::Dark, 3.0, 0.0) - 0.878_4).abs() < 1e-4);
        assert!((detection(Material::Dark, 3.0, 60.0) - 0.439_2).abs() < 1e-4);
        assert_eq!(detection(Material::Foil, 3.0, 55.0), 0.0);
    }

    #[test]
    fn foil_glares_along_its_normal_alone() {
        let brightness =
            |deg: f64| Surfaces::default().answer(Material::Foil, 3.0, libm::cos(f64::to_radians(deg))).brightness;
        assert!(brightness(0.0) > 2.0 && brightness(30.0) < 0.1);
    }
}

//! What the filter estimates, and where each part stands in the covariance.
//!
//! ```text
//!   θ 3 · ρ 3 · δv 3 · δω 3 │ c 3 │ inertia 5 │ e₀ 6 · e₁ 6 … │ t_d of each Kinect │ b₀ 6 · b₁ 6 …
//! ```
//! θ and ρ are the body twist ξ of the pose's error, `T = T̂ Exp(ξ)`; v is the centre of mass's velocity in rig axes, ω is
//! in body axes. e is a sensor's constant error, b its slow one, t_d how late a Kinect's stamps are.

use super::dynamics::{Deviation, Kinematics};
use super::options::{CalibrationTreatment, FilterMethod, FilterOptions, Motion, SensorPrior};
use super::root::Root;
use crate::register::SensorKind;
use nalgebra::Vector6;
use tumbled_model::RigNs;

/// First of the velocity's states.
pub(super) const VELOCITY: usize = 6;
/// First of the angular velocity's.
pub(super) const RATE: usize = 9;
/// First of the centre of mass's.
pub(super) const CENTER: usize = 12;
/// First of the inertia's.
pub(super) const INERTIA: usize = 15;

/// Where the sensors' states stand, and how many there are.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Layout {
    /// States of the target: 12, 15 or 20.
    pub(super) core: usize,
    /// All states.
    pub(super) width: usize,
    sensors: Vec<Slots>,
}

/// First states of one sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Slots {
    /// Of e.
    pub(super) constant: usize,
    /// Of b.
    pub(super) slow: usize,
    /// Of t_d.
    pub(super) time: Option<usize>,
}

impl Layout {
    fn new(options: &FilterOptions, priors: &[SensorPrior]) -> Self {
        let core = match (options.method, options.motion) {
            (FilterMethod::Paper, _) => CENTER,
            (FilterMethod::Cubature, Motion::FixedAxis) => INERTIA,
            (FilterMethod::Cubature, Motion::FreeTumble) => INERTIA + 5,
        };
        let is_calibrated =
            options.method == FilterMethod::Cubature && options.calibration == CalibrationTreatment::Estimated;
        if !is_calibrated {
            return Self { core, width: core, sensors: Vec::new() };
        }
        let kinects = priors.iter().filter(|prior| prior.kind == SensorKind::Kinect).count();
        let (mut constant, mut time) = (core, core + 6 * priors.len());
        let mut slow = time + kinects;
        let sensors = priors
            .iter()
            .map(|prior| {
                let is_kinect = prior.kind == SensorKind::Kinect;
                let slots = Slots { constant, slow, time: is_kinect.then_some(time) };
                (constant, slow, time) = (constant + 6, slow + 6, time + usize::from(is_kinect));
                slots
            })
            .collect();
        Self { core, width: slow, sensors }
    }

    /// Where a sensor's states stand, if it has any.
    pub(super) fn slots(&self, sensor: usize) -> Option<&Slots> {
        self.sensors.get(sensor)
    }

    /// Every sensor's.
    pub(super) fn all(&self) -> &[Slots] {
        &self.sensors
    }
}

/// What does not change while the filter runs.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Setup {
    pub(super) options: FilterOptions,
    pub(super) priors: Vec<SensorPrior>,
    pub(super) layout: Layout,
    /// Which states are known from the start: their prior is 0.
    pub(super) known: Vec<bool>,
}

impl Setup {
    pub(super) fn new(options: FilterOptions, priors: Vec<SensorPrior>) -> Self {
        let layout = Layout::new(&options, &priors);
        let mut setup = Self { options, priors, layout, known: Vec::new() };
        setup.known = setup.sigmas(&Deviation::repeat(1.0)).iter().map(|sigma| *sigma <= 0.0).collect();
        setup
    }

    /// Of the target's states alone: enough to predict, not to update.
    pub(super) fn of_target(&self) -> Self {
        let layout = Layout { core: self.layout.core, width: self.layout.core, sensors: Vec::new() };
        Self { options: self.options, priors: Vec::new(), layout, known: Vec::new() }
    }

    /// Every state's prior, from the target's.
    pub(super) fn sigmas(&self, core: &Deviation) -> Vec<f64> {
        let mut core = *core;
        if self.options.sigma_center_of_mass_m <= 0.0 {
            core.fixed_rows_mut::<3>(CENTER).fill(0.0);
        }
        if self.options.sigma_inertia <= 0.0 {
            core.fixed_rows_mut::<5>(INERTIA).fill(0.0);
        }
        let mut sigmas: Vec<f64> = core.iter().copied().take(self.layout.core).collect();
        let placed = || self.priors.iter().zip(self.layout.all());
        sigmas.extend(placed().flat_map(|(prior, _)| prior.sigma_e.iter()));
        sigmas.extend(placed().filter(|(_, slots)| slots.time.is_some()).map(|(prior, _)| prior.sigma_time_s));
        sigmas.extend(placed().flat_map(|(prior, _)| prior.sigma_b.iter()));
        sigmas
    }
}

/// The state at one time.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct State {
    pub(super) t: RigNs,
    pub(super) target: Kinematics,
    pub(super) sensors: Vec<SensorState>,
    pub(super) root: Root,
    /// Poses refused in a row.
    pub(super) refused: u32,
}

/// What is known of one sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SensorState {
    /// e, in the axes of its prior's `nominal`.
    pub(super) constant: Vector6<f64>,
    /// b, body axes.
    pub(super) slow: Vector6<f64>,
    /// t_d: how late its stamps are, s.
    pub(super) late_s: f64,
    /// When its last accepted pose was.
    pub(super) last: Option<RigNs>,
    /// Running mean of its poses' squared normalised innovations.
    pub(super) mean_nis: f64,
}

impl Default for SensorState {
    fn default() -> Self {
        // Six degrees of freedom: what a pose of the stated noise has on average.
        Self { constant: Vector6::zeros(), slow: Vector6::zeros(), late_s: 0.0, last: None, mean_nis: 6.0 }
    }
}

impl State {
    /// Displaced by a correction of all states.
    pub(super) fn correct(&mut self, layout: &Layout, by: &[f64]) {
        let mut core = Deviation::zeros();
        for (to, from) in core.iter_mut().zip(by.iter().take(layout.core)) {
            *to = *from;
        }
        self.target = self.target.plus(&core).normalized();
        for (sensor, slots) in self.sensors.iter_mut().zip(layout.all()) {
            for (value, change) in sensor.constant.iter_mut().zip(by.iter().skip(slots.constant)) {
                *value += change;
            }
            for (value, change) in sensor.slow.iter_mut().zip(by.iter().skip(slots.slow)) {
                *value += change;
            }
            if let Some(change) = slots.time.and_then(|time| by.get(time)) {
                sensor.late_s += change;
            }
        }
    }

    /// Whether it can be trusted: numbers that are finite, variances above zero, a quaternion of length 1.
    pub(super) fn is_sound(&self, setup: &Setup) -> bool {
        let target = &self.target;
        let numbers = (target.pose.translation.vector.iter())
            .chain(target.velocity.iter())
            .chain(target.rate.iter())
            .chain(target.center.iter())
            .chain(target.inertia.iter());
        let is_unit = (target.pose.rotation.norm() - 1.0).abs() <= 1e-12;
        is_unit && numbers.into_iter().all(|value| value.is_finite()) && self.root.is_sound(&setup.known)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ukf::options::StatedUncertainty;
    use nalgebra::Isometry3;

    #[test]
    fn the_states_stand_one_after_the_other() {
        let stated = StatedUncertainty::default();
        let priors = vec![
            SensorPrior::lidar(Isometry3::identity(), 2.0, &stated),
            SensorPrior::kinect(Isometry3::identity(), 2.0, &stated),
        ];
        let setup = Setup::new(FilterOptions::free_tumble(), priors.clone());
        // 20 of the target, 2 × 6 of e, one time offset, 2 × 6 of b.
        assert_eq!((setup.layout.core, setup.layout.width), (20, 45));
        assert_eq!(setup.layout.slots(0), Some(&Slots { constant: 20, slow: 33, time: None }));
        assert_eq!(setup.layout.slots(1), Some(&Slots { constant: 26, slow: 39, time: Some(32) }));
        let sigmas = setup.sigmas(&Deviation::repeat(1.0));
        assert_eq!((sigmas.len(), sigmas[32]), (45, 0.002));
        let fixed = FilterOptions { calibration: CalibrationTreatment::Inflated, ..FilterOptions::fixed_axis() };
        assert_eq!(Setup::new(fixed, priors.clone()).layout.width, 15);
        let paper = FilterOptions { method: FilterMethod::Paper, ..FilterOptions::free_tumble() };
        assert_eq!(Setup::new(paper, priors).layout.width, 12);
    }
}

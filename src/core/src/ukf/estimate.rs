//! What the filter says of a time: pose, motion and spin with their covariance, and where the uncertainty comes from.

use super::inertia::Inertia;
use super::root::{add_mapped, product, triangle};
use super::spin::{Momentum, Spin};
use super::state::{CENTER, INERTIA, RATE, Setup, State};
use nalgebra::{DMatrix, Isometry3, Matrix3, Matrix6, SMatrix, SVector, Vector3, Vector6};
use tumbled_model::RigNs;
use tumbled_model::se3::{adjoint, skew};

/// The target at one time.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// The time.
    pub t: RigNs,
    /// Target to rig.
    pub t_rig_target: Isometry3<f64>,
    /// Velocity of the target frame's origin, rig axes, m/s.
    pub velocity_mps: Vector3<f64>,
    /// Angular velocity, body axes, rad/s.
    pub angular_velocity_rps: Vector3<f64>,
    /// The centre of mass in the target's frame, m. Along the spin axis it is not observable.
    pub center_of_mass_m: Vector3<f64>,
    /// Covariance: θ 3 and ρ 3 of the body twist in `T Exp(ξ)`, velocity of the origin 3 and angular velocity 3, both in
    /// rig axes.
    pub covariance: SMatrix<f64, 12, 12>,
    /// How it spins; none below three standard deviations.
    pub spin: Option<Spin>,
    /// The direction of the angular momentum; where the inertia is estimated.
    pub momentum: Option<Momentum>,
}

impl Estimate {
    /// Of a state.
    pub(super) fn of(setup: &Setup, state: &State) -> Self {
        let target = &state.target;
        let rotation = target.pose.rotation.to_rotation_matrix().into_inner();
        let (rate, center) = (target.rate, target.center);
        let root = state.root.rows();
        // Rows: the deviations of θ, ρ, the origin's velocity and the rate in rig axes.
        let mut rows = DMatrix::zeros(root.nrows(), 12);
        rows.columns_mut(0, 9).copy_from(&root.columns(0, 9));
        // v_origin = v − R (ω × c).
        add_mapped(&mut rows, 6, root, 0, &(rotation * skew(&rate.cross(&center))));
        add_mapped(&mut rows, 6, root, RATE, &(rotation * skew(&center)));
        if setup.layout.core > CENTER {
            add_mapped(&mut rows, 6, root, CENTER, &-(rotation * skew(&rate)));
        }
        // ω_rig = R ω.
        add_mapped(&mut rows, 9, root, 0, &-(rotation * skew(&rate)));
        add_mapped(&mut rows, 9, root, RATE, &rotation);
        let covariance = product::<12, 12>(&rows, 0, &rows, 0);
        Self {
            t: state.t,
            t_rig_target: target.pose,
            velocity_mps: target.pose.rotation * target.origin_velocity(),
            angular_velocity_rps: rate,
            center_of_mass_m: center,
            covariance,
            spin: Spin::of(&(rotation * rate), &covariance.fixed_view::<3, 3>(9, 9).into_owned()),
            momentum: (setup.layout.core > INERTIA).then(|| momentum(state, &rotation)).flatten(),
        }
    }

    /// Standard deviations of attitude, rad, and place of the origin, m: of the three axes together.
    pub fn sigma(&self) -> (f64, f64) {
        let trace = |first: usize| libm::sqrt(self.covariance.fixed_view::<3, 3>(first, first).trace());
        (trace(0), trace(3))
    }
}

/// `h = R J ω` with its covariance, up to the inertia's scale.
fn momentum(state: &State, rotation: &Matrix3<f64>) -> Option<Momentum> {
    let target = &state.target;
    let inertia = Inertia::new(&target.inertia);
    let in_body = inertia.tensor * target.rate;
    let root = state.root.rows();
    let mut rows = DMatrix::zeros(root.nrows(), 3);
    add_mapped(&mut rows, 0, root, 0, &-(rotation * skew(&in_body)));
    add_mapped(&mut rows, 0, root, RATE, &(rotation * inertia.tensor));
    // The inertia's part by central differences of its five numbers.
    const STEP: f64 = 1e-5;
    for number in 0..5 {
        let by = SVector::<f64, 5>::ith(number, STEP);
        let change = Inertia::new(&(target.inertia + by)).tensor - Inertia::new(&(target.inertia - by)).tensor;
        let slope = rotation * (change * target.rate) / (2.0 * STEP);
        for (axis, factor) in slope.iter().enumerate() {
            rows.column_mut(axis).axpy(*factor, &root.column(INERTIA + number), 1.0);
        }
    }
    Momentum::of(&(rotation * in_body), &product::<3, 3>(&rows, 0, &rows, 0))
}

/// Where a pose's uncertainty comes from: standard deviations of rotation, rad, and translation, m, each of the three axes
/// together. Their squares add up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SigmaBySource {
    /// The sensors' constant errors: extrinsics, depth scale, warp, beam tilt.
    pub calibration: (f64, f64),
    /// How late Kinects' stamps are.
    pub time: (f64, f64),
    /// Their slow errors: what registration to the model leaves.
    pub slow: (f64, f64),
    /// The rest: noise and motion.
    pub noise: (f64, f64),
}

impl SigmaBySource {
    /// Of a state; none where the sensors' errors are not states.
    pub(super) fn of(setup: &Setup, state: &State) -> Option<Self> {
        let layout = &setup.layout;
        let sensors = layout.width - layout.core;
        let first_slow = layout.all().first()?.slow;
        let root = state.root.rows();
        // Columns in another order: what comes first is what the later ones are explained by.
        let mut rows = DMatrix::zeros(root.nrows(), sensors + 6);
        rows.columns_mut(0, sensors).copy_from(&root.columns(layout.core, sensors));
        rows.columns_mut(sensors, 6).copy_from(&root.columns(0, 6));
        let rows = triangle(rows);
        // e of every sensor, then how late they are, then b (`state`).
        let (time, slow) = (6 * layout.all().len(), first_slow - layout.core);
        let part = |from: usize, to: usize| {
            let square = |axis: usize| rows.view((from, sensors + axis), (to - from, 3)).norm();
            (square(0), square(3))
        };
        Some(Self {
            calibration: part(0, time),
            time: part(time, slow),
            slow: part(slow, sensors),
            noise: part(sensors, sensors + 6),
        })
    }
}

/// By how much the extrinsic between two sensors has left the file's, as a twist in the axes of the first, about the
/// target's nominal centre, with its covariance: `Log(Exp(e_a)⁻¹ Exp(e_b))`, both in the axes of `a`.
pub(super) fn extrinsic_drift(
    setup: &Setup,
    state: &State,
    a: usize,
    b: usize,
) -> Option<(Vector6<f64>, Matrix6<f64>)> {
    let (slots_a, slots_b) = (setup.layout.slots(a)?, setup.layout.slots(b)?);
    let (prior_a, prior_b) = (setup.priors.get(a)?, setup.priors.get(b)?);
    let (known_a, known_b) = (state.sensors.get(a)?, state.sensors.get(b)?);
    let map = adjoint(&prior_a.nominal.inv_mul(&prior_b.nominal));
    let root = state.root.rows();
    let mut rows = DMatrix::zeros(root.nrows(), 6);
    rows -= root.columns(slots_a.constant, 6);
    for (into, first) in [(0, 0), (3, 0), (3, 3)] {
        let block = map.fixed_view::<3, 3>(into, first).into_owned();
        add_mapped(&mut rows, into, root, slots_b.constant + first, &block);
    }
    Some((map * known_b.constant - known_a.constant, product::<6, 6>(&rows, 0, &rows, 0)))
}

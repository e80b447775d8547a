//! What a pose costs the filter: prediction and update, states of two sensors.
//!
//! `cargo bench -p tumbled-core --bench filter`

use divan::black_box;
use nalgebra::{Isometry3, Matrix6, Translation3, Vector3};
use tumbled_core::ukf::{CalibrationTreatment, Filter, FilterOptions, PoseMeasurement, SensorPrior, StatedUncertainty};
use tumbled_model::RigNs;
use tumbled_model::se3::exp_rotation;

fn main() {
    divan::main();
}

/// A target at 20 °/s, a metre away: its pose at a frame.
fn pose(frame: i64, sensor: usize) -> PoseMeasurement {
    let t = frame as f64 / 30.0;
    let rotation = exp_rotation(&Vector3::new(0.1 * t, 0.3 * t, -0.15 * t));
    PoseMeasurement {
        t: RigNs(frame * 33_333_333),
        sensor,
        pose: Isometry3::from_parts(Translation3::new(0.0, 0.0, 1.0), rotation),
        information: Matrix6::identity() * 1e6,
    }
}

fn filter(options: FilterOptions) -> Filter {
    let stated = StatedUncertainty::default();
    let nominal = Isometry3::translation(0.0, 0.0, 1.0);
    let priors = vec![SensorPrior::kinect(nominal, 2.0, &stated), SensorPrior::lidar(nominal, 2.0, &stated)];
    let window: Vec<_> = (0..31).map(|frame| pose(frame, 0)).collect();
    Filter::start(options, priors, &window).expect("a start")
}

/// 20 states of the target and 25 of the sensors; 15 and 25; 15 alone; the published 12.
const OPTIONS: [(&str, FilterOptions); 4] = [
    ("tumble", FilterOptions::free_tumble()),
    ("fixed axis", FilterOptions::fixed_axis()),
    (
        "fixed axis, inflated",
        FilterOptions { calibration: CalibrationTreatment::Inflated, ..FilterOptions::fixed_axis() },
    ),
    ("paper", FilterOptions::paper()),
];

/// A pose in its order: prediction and update.
#[divan::bench(args = OPTIONS.map(|(name, _)| name))]
fn predict_and_update(bencher: divan::Bencher<'_, '_>, name: &str) {
    let options = OPTIONS.iter().find(|(known, _)| *known == name).expect("known").1;
    let mut filter = filter(options);
    let mut frame = 31;
    bencher.bench_local(|| {
        frame += 1;
        filter.update(black_box(&pose(frame, (frame % 4 == 0).into())))
    });
}

/// What is said of a time 100 ms ahead.
#[divan::bench(args = OPTIONS.map(|(name, _)| name))]
fn predict(bencher: divan::Bencher<'_, '_>, name: &str) {
    let filter = filter(OPTIONS.iter().find(|(known, _)| *known == name).expect("known").1);
    bencher.bench(|| filter.predict(black_box(RigNs(33_333_333 * 33))));
}

/// Where a sensor's points fit: the mean alone.
#[divan::bench]
fn seen_by(bencher: divan::Bencher<'_, '_>) {
    let filter = filter(FilterOptions::free_tumble());
    bencher.bench(|| filter.seen_by(black_box(RigNs(33_333_333 * 33)), 1));
}

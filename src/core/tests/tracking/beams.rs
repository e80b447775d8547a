//! A LiDAR's beams learn their biases from the model.

use crate::body::{Body, Rings, Turn, camera};
use crate::chance::Chance;
use tumbled_core::track::Tracker;

/// A camera's model tells a LiDAR's beams what they measure too long: of ± 10 mm less than 4 mm is left (r.m.s. over the
/// beams) after a turn. Its own map could not see it.
#[test]
fn biases_of_10_mm_are_learned_from_a_camera_s_model() {
    let (body, turn, mut chance) = (Body::satellite(), Turn::at(20.0), Chance(9));
    let biases: Vec<f64> = (0..32).map(|beam| if beam * 7 % 5 < 2 { 0.010 } else { -0.010 }).collect();
    let rings = Rings::beside(biases.clone(), 0.010);
    let mut tracker = Tracker::begin(&camera(&body, &turn.pose(0.0), 0.002, &mut chance), &turn.pose(0.0));
    for k in 1..=180 {
        let t = f64::from(k) * 0.1;
        // The sensors' extrinsics are exact here, so the camera's pose serves both.
        let frame = camera(&body, &turn.pose(t), 0.002, &mut chance);
        let fit = tracker.fit(&frame, &turn.pose(t));
        tracker.accept(&frame, &fit);
        let crossing = rings.crossing(&body, |dt| turn.pose(t + dt), &turn.motion(), &mut chance);
        let fit = tracker.fit(&crossing, &turn.pose(t));
        assert!(fit.is_trusted(), "crossing {k}: {} of {} points", fit.inliers, fit.used);
        tracker.accept(&crossing, &fit);
    }
    let beams = tracker.beams(1).expect("the LiDAR was accepted");
    // Beams that met the body often enough to be known to 2 mm.
    let left: Vec<f64> = (0..32u8)
        .filter(|beam| beams.sigma_m(*beam) < 0.002)
        .map(|beam| beams.bias_m(beam) - biases[usize::from(beam)])
        .collect();
    let rms = (left.iter().map(|left| left * left).sum::<f64>() / left.len() as f64).sqrt();
    assert!(left.len() >= 16 && rms < 0.004, "{} beams: {rms}", left.len());
    // Nothing was learned of a camera, nor of a beam that does not exist.
    assert!(beams.bias_m(200) == 0.0 && tracker.beams(0).is_some_and(|none| none.bias_m(3) == 0.0));
}

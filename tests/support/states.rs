//! STATE lines as `replay -o -` writes them, and poses out of them.

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use tumbled::stream::StateLine;

use super::Workbench;

/// The states that a replay of these writes; it ends with one of the exit codes.
pub(crate) fn replayed(bench: &Workbench, arguments: &[&str], codes: &[i32]) -> Vec<StateLine> {
    let done = bench.run(&[&["replay", "-o", "-"], arguments].concat());
    assert!(codes.contains(&done.code), "exit code {}: {}", done.code, done.stderr);
    lines(&done.stdout)
}

/// The states of a text.
pub(crate) fn lines(text: &str) -> Vec<StateLine> {
    text.lines().map(|line| serde_json::from_str(line).expect(line)).collect()
}

/// Target coordinates to rig coordinates. `None`: nobody knows.
pub(crate) fn pose(state: &StateLine) -> Option<Isometry3<f64>> {
    let [x, y, z, w] = state.rotation_xyzw?;
    let rotation = UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z));
    Some(Isometry3::from_parts(Translation3::from(state.position_m?), rotation))
}

/// Degrees and millimetres between two poses.
pub(crate) fn apart(a: &Isometry3<f64>, b: &Isometry3<f64>) -> (f64, f64) {
    (a.rotation.angle_to(&b.rotation).to_degrees(), 1e3 * (a.translation.vector - b.translation.vector).norm())
}

//! The report of `calibrate extrinsic` as a page.

use nalgebra::{Isometry3, Vector3};
use tumbled_calib::Extrinsic;
use tumbled_calib::extrinsic::{CLASS_MM, CLASSES};

use super::extrinsic::{ExtrinsicReport, Placed, PoseLine};
use super::frame::{self, Parameter};
use super::{drawing, frame::significant};
use crate::experiment::page::table;
use crate::experiment::plot::escaped;

/// The page.
pub fn page(report: &ExtrinsicReport, found: &Extrinsic) -> String {
    let about = format!(
        "{} shown to the LiDAR `{}` and the Kinect `{}`; t_lidar_kinect takes the Kinect's coordinates to the LiDAR's.",
        report.target, report.lidar, report.kinect
    );
    let parameters = report.result.as_ref().map(parameters).unwrap_or_default();
    let mut rest = String::new();
    for warning in &report.warnings {
        rest.push_str(&format!("<p class=\"bad\">{}</p>", escaped(warning)));
    }
    if let Some(result) = &report.result {
        rest.push_str(&format!("<h2>As written</h2>{}", as_written(result)));
    }
    rest.push_str(&format!("<h2>Poses</h2>{}", table(&POSES, &report.poses.iter().map(pose).collect::<Vec<_>>())));
    rest.push_str(&format!("<div class=\"plots\">{}</div>", plots(report, found)));
    rest.push_str(&format!("<h2>Do the poses agree?</h2>{}", agreement(report)));
    rest.push_str(&format!("<h2>Both sensors' points, before and after</h2>{}", overlays(found)));
    frame::report("Extrinsic calibration", &about, &report.provenance, &parameters, &rest)
}

fn parameters(result: &Placed) -> Vec<Parameter> {
    let mut rows = Vec::new();
    let names = ["roll (about x)", "pitch (about y)", "yaw (about z)"];
    for ((name, value), sigma) in names.iter().zip(result.lidar_kinect_rpy_deg).zip(result.sigma_rotation_deg) {
        rows.push(Parameter {
            name: format!("{name}, Kinect in the LiDAR's frame"),
            value: format!("{value:.4}°"),
            sigma: format!("{}° about the rig's axis", significant(sigma)),
        });
    }
    let translation = result.t_lidar_kinect.translation_m.iter().zip(result.sigma_translation_mm);
    for (axis, (value, sigma)) in ["x", "y", "z"].iter().zip(translation) {
        rows.push(Parameter {
            name: format!("translation {axis}, Kinect in the LiDAR's frame"),
            value: format!("{:.2} mm", 1e3 * value),
            sigma: format!("{} mm", significant(sigma)),
        });
    }
    rows.push(match (result.depth_scale, result.sigma_depth_scale) {
        (Some(scale), Some(sigma)) => Parameter {
            name: "depth scale, true over measured".to_owned(),
            value: format!("{scale:.5}"),
            sigma: format!("{sigma:.5}"),
        },
        _ => Parameter {
            name: "depth scale, true over measured".to_owned(),
            value: "1 (not solved for)".to_owned(),
            sigma: "–".to_owned(),
        },
    });
    rows
}

/// The transform as matrix and as the file has it.
fn as_written(result: &Placed) -> String {
    let t = &result.t_lidar_kinect;
    let [x, y, z, w] = t.rotation_xyzw;
    let rotation =
        nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z)).to_rotation_matrix();
    let rows: Vec<Vec<String>> = rotation
        .matrix()
        .row_iter()
        .zip(t.translation_m)
        .map(|(row, t)| row.iter().map(|number| format!("{number:.6}")).chain([format!("{t:.6} m")]).collect())
        .collect();
    let list = |numbers: &[f64]| numbers.iter().map(|number| format!("{number:.6}")).collect::<Vec<_>>().join(", ");
    format!(
        "<p>t_lidar_kinect as a matrix; as a quaternion x, y, z, w: [{}]. In the file: t_rig_kinect, translation_m = [{}], \
        rotation_xyzw = [{}]. Roll, pitch, yaw: turn by yaw about z, then by pitch about the new y, then by roll about the new \
        x.</p>{}",
        list(&t.rotation_xyzw),
        list(&result.t_rig_kinect.translation_m),
        list(&result.t_rig_kinect.rotation_xyzw),
        table(&["x", "y", "z", "translation"], &rows)
    )
}

const POSES: [&str; 9] =
    ["pose", "time", "depth", "Kinect points, r.m.s.", "LiDAR points, r.m.s.", "offset", "angle", "left out", "used"];

fn pose(pose: &PoseLine) -> Vec<String> {
    let points = |count: usize, rms: Option<f64>| match rms {
        Some(rms) => format!("{count}, {} mm", significant(rms)),
        None => "–".to_owned(),
    };
    let or_none = |value: Option<String>| value.unwrap_or_else(|| "–".to_owned());
    vec![
        pose.number.to_string(),
        format!("{:.1}–{:.1} s", pose.from_s, pose.until_s),
        or_none(pose.middle_m.map(|[_, _, z]| format!("{z:.2} m"))),
        points(pose.kinect_points, pose.kinect_rms_mm),
        points(pose.lidar_points, pose.lidar_rms_mm),
        or_none(pose.offset_mm.map(|offset| format!("{offset:.2} mm"))),
        or_none(pose.angle_deg.map(|angle| format!("{angle:.2}°"))),
        or_none(pose.left_out_sigma.map(|sigma| {
            let (deg, mm) = (pose.left_out_deg.unwrap_or_default(), pose.left_out_mm.unwrap_or_default());
            format!("{sigma:.2} σ: {deg:.3}°, {mm:.2} mm")
        })),
        match &pose.left_aside {
            None => "yes".to_owned(),
            Some(why) => format!("<td class=\"wrap bad\">no: {}</td>", escaped(why)),
        },
    ]
}

fn plots(report: &ExtrinsicReport, found: &Extrinsic) -> String {
    let bars = |of: &dyn Fn(&PoseLine) -> Option<f64>| -> Vec<(usize, f64, bool)> {
        report.poses.iter().filter_map(|pose| Some((pose.number, of(pose)?, pose.left_aside.is_none()))).collect()
    };
    let mut counts = vec![0; CLASSES];
    for pose in found.poses.iter().filter(|pose| pose.left_aside.is_none()) {
        let classes = pose.seen.iter().flat_map(|seen| &seen.histogram);
        counts.iter_mut().zip(classes).for_each(|(sum, count)| *sum += count);
    }
    let normals: Vec<(usize, [f64; 3], bool)> =
        report.poses.iter().filter_map(|pose| Some((pose.number, pose.normal?, pose.left_aside.is_none()))).collect();
    let places: Vec<[f64; 2]> = report.poses.iter().filter_map(|pose| pose.middle_m.map(|[x, _, z]| [x, z])).collect();
    let half = 0.5 * CLASSES as f64 * CLASS_MM;
    [
        drawing::bars("LiDAR points beyond the Kinect's surface, mean by pose", "mm", &bars(&|pose| pose.offset_mm)),
        drawing::bars("LiDAR points about the common surface, r.m.s. by pose", "mm", &bars(&|pose| pose.lidar_rms_mm)),
        drawing::bars(
            "Kinect points about the common surface, r.m.s. by pose",
            "mm",
            &bars(&|pose| pose.kinect_rms_mm),
        ),
        drawing::bars("Shift when the pose is left out", "σ", &bars(&|pose| pose.left_out_sigma)),
        drawing::histogram("LiDAR points about the common surface", "mm", (-half, CLASS_MM), &counts),
        drawing::half_sphere("Where the boards face, about the Kinect's axis", &normals),
        drawing::overlay(
            "Where the target was, seen from above",
            ["target", ""],
            ["right", "away from the Kinect"],
            [&places, &[]],
        ),
    ]
    .concat()
}

fn agreement(report: &ExtrinsicReport) -> String {
    let none = || "not to be had: too few poses".to_owned();
    let worst = report
        .poses
        .iter()
        .filter(|pose| pose.left_aside.is_none())
        .filter_map(|pose| Some((pose.number, pose.left_out_sigma?, pose.left_out_deg?, pose.left_out_mm?)));
    let worst = worst.max_by(|a, b| a.1.total_cmp(&b.1));
    let rows = vec![
        vec![
            "each left out in turn: the largest shift".to_owned(),
            worst.map_or_else(none, |(pose, sigma, deg, mm)| {
                format!("pose {pose}: {sigma:.2} σ, {deg:.3}°, {mm:.2} mm")
            }),
        ],
        vec![
            "odd poses against even ones".to_owned(),
            report.split.map_or_else(none, |split| {
                format!("{:.2} σ, {:.3}°, {:.2} mm", split.sigma, split.rotation_deg, split.translation_mm)
            }),
        ],
        vec![
            "poses held back: the LiDAR's points beyond the Kinect's surface".to_owned(),
            report.held_out.map_or_else(none, |held| {
                format!("{} poses: r.m.s. {:.1} mm, mean {:.2} mm", held.poses, held.rms_mm, held.mean_mm)
            }),
        ],
        vec![
            "disagreement over noise, χ² by degree of freedom".to_owned(),
            report.chi_square_per_freedom.map_or_else(none, |ratio| format!("{ratio:.2}")),
        ],
    ];
    table(&["check", "found"], &rows)
}

/// Points drawn of a pose and sensor.
const DRAWN: usize = 40;

/// Seen from above: the LiDAR's points in the Kinect's frame and the Kinect's in the LiDAR's, with the config's place and with
/// the result.
fn overlays(found: &Extrinsic) -> String {
    let Some(fit) = found.fit() else { return "<p>There is no result to show.</p>".to_owned() };
    let scale = fit.depth_scale.unwrap_or(1.0);
    let seen = || found.poses.iter().filter(|pose| pose.left_aside.is_none()).filter_map(|pose| pose.seen.as_ref());
    let thin = |points: &[Vector3<f64>]| -> Vec<Vector3<f64>> {
        points.iter().step_by(points.len().div_ceil(DRAWN).max(1)).copied().collect()
    };
    let camera: Vec<Vector3<f64>> = seen().flat_map(|seen| thin(&seen.samples.0)).collect();
    let lidar: Vec<Vector3<f64>> = seen().flat_map(|seen| thin(&seen.samples.1)).collect();
    let mut svg = String::from("<div class=\"plots\">");
    for (when, t, scale) in [("config", &found.start, 1.0), ("result", &fit.t_lidar_camera, scale)] {
        svg.push_str(&in_camera(when, t, scale, &camera, &lidar));
        svg.push_str(&in_lidar(when, t, scale, &camera, &lidar));
    }
    svg + "</div>"
}

fn in_camera(when: &str, t: &Isometry3<f64>, scale: f64, camera: &[Vector3<f64>], lidar: &[Vector3<f64>]) -> String {
    let own: Vec<[f64; 2]> = camera.iter().map(|p| [p.x * scale, p.z * scale]).collect();
    let other = |p: &Vector3<f64>| {
        let p = t.inverse_transform_point(&(*p).into());
        [p.x, p.z]
    };
    let other: Vec<[f64; 2]> = lidar.iter().map(other).collect();
    let title = format!("In the Kinect's frame, with the {when}");
    drawing::overlay(&title, ["Kinect", "LiDAR"], ["right", "away from the Kinect"], [&own, &other])
}

fn in_lidar(when: &str, t: &Isometry3<f64>, scale: f64, camera: &[Vector3<f64>], lidar: &[Vector3<f64>]) -> String {
    // Seen from above with forward up: the LiDAR's left is the picture's left.
    let above = |p: Vector3<f64>| [-p.y, p.x];
    let other: Vec<[f64; 2]> = camera.iter().map(|p| above((t * nalgebra::Point3::from(p * scale)).coords)).collect();
    let own: Vec<[f64; 2]> = lidar.iter().map(|p| above(*p)).collect();
    let title = format!("In the LiDAR's frame, with the {when}");
    drawing::overlay(&title, ["Kinect", "LiDAR"], ["right", "forward"], [&other, &own])
}

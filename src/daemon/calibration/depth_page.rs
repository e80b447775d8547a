//! The report of `calibrate kinect` as a page.

use super::depth::{KinectReport, KinectResult};
use super::drawing;
use super::frame::{self, Parameter, significant};
use crate::experiment::page::table;
use crate::experiment::plot::escaped;

/// Names of the lens' numbers, with digits and unit.
const LENS: [(&str, usize, &str); 6] = [
    ("focal length across, fx", 2, " px"),
    ("focal length down, fy", 2, " px"),
    ("principal point, column cx", 2, " px"),
    ("principal point, row cy", 2, " px"),
    ("radial distortion k1", 5, ""),
    ("radial distortion k2", 5, ""),
];
/// The surface's terms.
const TERMS: [&str; 10] = ["1", "x", "x²", "x³", "y", "xy", "x²y", "y²", "xy²", "y³"];
/// The colours of the map are full at this, mm.
const FULL_MM: f64 = 10.0;

/// The page.
pub fn page(report: &KinectReport) -> String {
    let about = format!(
        "{} shown to the LiDAR `{}` and the Kinect `{}`; the Kinect's depth law, surface, lens and place are solved for together against \
         the LiDAR's planes.",
        report.target, report.lidar, report.kinect
    );
    let parameters = report.result.as_ref().map(parameters).unwrap_or_default();
    let mut rest = String::new();
    for warning in &report.warnings {
        rest.push_str(&format!("<p class=\"bad\">{}</p>", escaped(warning)));
    }
    if let Some(result) = &report.result {
        rest.push_str(&maps(result));
        rest.push_str(&drift(result));
    }
    let models: Vec<Vec<String>> = report
        .models
        .iter()
        .map(|model| {
            let taken = if model.taken { "taken" } else { "" };
            vec![model.name.clone(), format!("{:.1}", model.cost), format!("{:.1}", model.criterion), taken.to_owned()]
        })
        .collect();
    rest.push_str(&format!(
        "<h2>What the data bear</h2><p>A richer model is taken where the Bayesian information criterion falls by 6 at least.</p>{}",
        table(&["model, besides the place", "squares in the noise", "criterion", ""], &models)
    ));
    let poses: Vec<Vec<String>> = report
        .poses
        .iter()
        .map(|pose| {
            let used = match &pose.left_aside {
                None => "yes".to_owned(),
                Some(why) => format!("<td class=\"wrap bad\">no: {}</td>", escaped(why)),
            };
            let time = format!("{:.1}–{:.1} s", pose.from_s, pose.until_s);
            vec![pose.number.to_string(), time, pose.frames.to_string(), used]
        })
        .collect();
    rest.push_str(&format!("<h2>Poses</h2>{}", table(&["pose", "time", "frames", "used"], &poses)));
    frame::report("Kinect calibration", &about, &report.provenance, &parameters, &rest)
}

fn parameters(result: &KinectResult) -> Vec<Parameter> {
    let or_config = |sigma: Option<f64>, unit: &str| match sigma {
        Some(sigma) => format!("{}{unit}", significant(sigma)),
        None => "the config's: the data do not bear it".to_owned(),
    };
    let mut rows = vec![Parameter {
        name: "depth scale, true over the law's".to_owned(),
        value: format!("{:.5}", result.place.depth_scale.unwrap_or(1.0)),
        sigma: result.place.sigma_depth_scale.map_or_else(|| "–".to_owned(), |sigma| format!("{sigma:.5}")),
    }];
    if let Some(warp) = &result.depth_warp {
        for ((term, factor), sigma) in TERMS.iter().zip(warp.factors).zip(&result.sigma_depth_warp) {
            if let Some(sigma) = sigma {
                let unit = if warp.power == 0 { " mm" } else { " mm/m²" };
                rows.push(Parameter {
                    name: format!("surface, {term}"),
                    value: format!("{:.3}{unit}", 1e3 * factor),
                    sigma: format!("{}{unit}", significant(1e3 * sigma)),
                });
            }
        }
    }
    for (((name, digits, unit), value), sigma) in LENS.iter().zip(result.lens).zip(result.sigma_lens) {
        let (value, sigma) = (format!("{value:.digits$}{unit}", digits = *digits), or_config(sigma, unit));
        rows.push(Parameter { name: (*name).to_owned(), value, sigma });
    }
    let place = &result.place;
    for ((axis, value), sigma) in
        ["roll", "pitch", "yaw"].iter().zip(place.lidar_kinect_rpy_deg).zip(place.sigma_rotation_deg)
    {
        rows.push(Parameter {
            name: format!("{axis}, Kinect in the LiDAR's frame"),
            value: format!("{value:.4}°"),
            sigma: format!("{}° about the rig's axis", significant(sigma)),
        });
    }
    let translation = place.t_lidar_kinect.translation_m.iter().zip(place.sigma_translation_mm);
    for (axis, (value, sigma)) in ["x", "y", "z"].iter().zip(translation) {
        rows.push(Parameter {
            name: format!("translation {axis}, Kinect in the LiDAR's frame"),
            value: format!("{:.2} mm", 1e3 * value),
            sigma: format!("{} mm", significant(sigma)),
        });
    }
    rows
}

fn maps(result: &KinectResult) -> String {
    let map = &result.held_out;
    let size = [map.columns, map.rows];
    let rms = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.1} mm"));
    format!(
        "<h2>Depths beyond the LiDAR's planes, over the picture</h2><p>Mean by cell, mm, of boards that the solution was made without; \
         cells that fewer than two boards covered are empty. With a scale alone r.m.s. {}, with the model {}.</p><div \
         class=\"plots\">{}{}</div>",
        rms(map.scale_alone_rms_mm),
        rms(map.model_rms_mm),
        drawing::map("With a depth scale alone, mm", size, &map.scale_alone_mm, FULL_MM),
        drawing::map("With the model, mm", size, &map.model_mm, FULL_MM)
    )
}

fn drift(result: &KinectResult) -> String {
    match &result.drift {
        Some(drift) => format!(
            "<h2>Warming up</h2><p>The depths moved by {:.2} ± {:.2} mm a minute over {:.0} s.</p>",
            drift.mm_per_minute, drift.sigma, drift.seconds
        ),
        None => "<h2>Warming up</h2><p>Too few poses to tell how the depths move in time.</p>".to_owned(),
    }
}

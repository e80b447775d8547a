//! Velodyne's `db.xml`: a Boost serialization of the lasers, degrees and centimetres.
//!
//! ```text
//! boost_serialization/DB/ distLSB_  enabled_/item…  minIntensity_/item…  maxIntensity_/item…
//!                         points_/item/px/ id_ rotCorrection_ vertCorrection_ distCorrection_ …
//! ```

use super::calibration::{Calibration, CalibrationError, DISTANCE_UNIT_M, LASERS, LaserCalibration};
use super::field::{Field, Gathered};
use roxmltree::{Document, Node, ParsingOptions};

const METRES_PER_CM: f64 = 0.01;

/// The elements of a laser, their field and the factor to SI. The slope has no unit.
const ELEMENTS: [(&str, Field, f64); 9] = {
    let rad_per_deg = core::f64::consts::PI / 180.0;
    [
        ("rotCorrection_", Field::Rotation, rad_per_deg),
        ("vertCorrection_", Field::Vertical, rad_per_deg),
        ("distCorrection_", Field::Distance, METRES_PER_CM),
        ("distCorrectionX_", Field::DistanceX, METRES_PER_CM),
        ("distCorrectionY_", Field::DistanceY, METRES_PER_CM),
        ("vertOffsetCorrection_", Field::VerticalOffset, METRES_PER_CM),
        ("horizOffsetCorrection_", Field::HorizontalOffset, METRES_PER_CM),
        ("focalDistance_", Field::FocalDistance, METRES_PER_CM),
        ("focalSlope_", Field::FocalSlope, 1.0),
    ]
};

/// Writes the lasers as Velodyne's own tool does, without what nobody reads. Numbers are written so that they are read as
/// they are, give or take the last bit: degrees and centimetres are not radians and metres.
pub(super) fn write(calibration: &Calibration) -> String {
    let lasers = calibration.lasers();
    let mut text = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\" standalone=\"yes\" ?>\n");
    text += "<!DOCTYPE boost_serialization>\n";
    text += "<boost_serialization signature=\"serialization::archive\" version=\"4\">\n<DB class_id=\"0\">\n";
    text += &format!("<distLSB_>{}</distLSB_>\n", calibration.distance_unit_m() / METRES_PER_CM);
    let list = |name: &str, number: &dyn Fn(&LaserCalibration) -> u8| {
        let items: String = lasers.iter().map(|laser| format!("<item>{}</item>", number(laser))).collect();
        format!("<{name}><count>{LASERS}</count>{items}</{name}>\n")
    };
    text += &list("enabled_", &|laser| u8::from(laser.enabled));
    text += &list("minIntensity_", &|laser| laser.min_intensity);
    text += &list("maxIntensity_", &|laser| laser.max_intensity);
    text += &format!("<points_><count>{LASERS}</count>\n");
    for (id, laser) in lasers.iter().enumerate() {
        text += &format!("<item><px><id_>{id}</id_>");
        for (element, field, to_si) in ELEMENTS {
            text += &format!("<{element}>{}</{element}>", field.get(laser) / to_si);
        }
        text += "</px></item>\n";
    }
    text + "</points_>\n</DB>\n</boost_serialization>\n"
}

/// Reads the lasers with ids below 64; Velodyne's files have room for more, unused.
pub(super) fn parse(text: &str) -> Result<Calibration, CalibrationError> {
    // Boost writes a DOCTYPE. Entities it has none, and a file that declares some could grow without bound.
    let allow_dtd = !text.contains("<!ENTITY");
    let document = Document::parse_with_options(text, ParsingOptions { allow_dtd, ..ParsingOptions::default() })?;
    let points = named(&document, "points_").ok_or(CalibrationError::Unrecognised)?;
    let min = list(&document, "minIntensity_", 0.0)?;
    let max = list(&document, "maxIntensity_", 255.0)?;
    let enabled = list(&document, "enabled_", 1.0)?;
    let mut gathered = Gathered::new();
    for px in points.descendants().filter(|node| node.has_tag_name("px")) {
        let id = match child(&document, px, "id_")? {
            Some(id) if id >= LASERS as f64 => continue,
            Some(id) => id,
            None => return Err(CalibrationError::MissingField { line: line(&document, px), field: "laser_id" }),
        };
        let line = line(&document, px);
        let id = Gathered::id(line, id)?;
        let mut laser = LaserCalibration::default();
        for (element, field, to_si) in ELEMENTS {
            match child(&document, px, element)? {
                Some(value) => field.put(&mut laser, id, value * to_si)?,
                None if Field::NEEDED.contains(&field) => {
                    return Err(CalibrationError::MissingField { line, field: field.name() });
                }
                None => {}
            }
        }
        let of = |list: &[f64; LASERS]| list.get(usize::from(id)).copied().unwrap_or_default();
        Field::MinIntensity.put(&mut laser, id, of(&min))?;
        Field::MaxIntensity.put(&mut laser, id, of(&max))?;
        laser.enabled = of(&enabled) != 0.0;
        gathered.insert(line, id, laser)?;
    }
    let unit = match named(&document, "distLSB_") {
        Some(node) => value(&document, node, "distLSB_")? * METRES_PER_CM,
        None => DISTANCE_UNIT_M,
    };
    gathered.finish(unit)
}

fn named<'a, 'input>(document: &'a Document<'input>, name: &str) -> Option<Node<'a, 'input>> {
    document.descendants().find(|node| node.has_tag_name(name))
}

/// A list of one number per laser; places the file does not fill hold `otherwise`.
fn list(document: &Document<'_>, name: &'static str, otherwise: f64) -> Result<[f64; LASERS], CalibrationError> {
    let mut numbers = [otherwise; LASERS];
    if let Some(list) = named(document, name) {
        let items = list.children().filter(|node| node.has_tag_name("item"));
        for (number, item) in numbers.iter_mut().zip(items) {
            *number = value(document, item, name)?;
        }
    }
    Ok(numbers)
}

fn child(document: &Document<'_>, parent: Node<'_, '_>, name: &'static str) -> Result<Option<f64>, CalibrationError> {
    match parent.children().find(|node| node.has_tag_name(name)) {
        Some(node) => value(document, node, name).map(Some),
        None => Ok(None),
    }
}

fn value(document: &Document<'_>, node: Node<'_, '_>, name: &'static str) -> Result<f64, CalibrationError> {
    let text = node.text().unwrap_or_default().trim();
    text.parse().map_err(|_not_a_number| CalibrationError::Number {
        line: line(document, node),
        field: name,
        found: text.to_owned(),
    })
}

fn line(document: &Document<'_>, node: Node<'_, '_>) -> usize {
    document.text_pos_at(node.range().start).row as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fmt::Write;

    fn database(lasers: usize) -> String {
        let mut text = String::from(
            "<?xml version=\"1.0\"?><!DOCTYPE boost_serialization>\n<boost_serialization version=\"4\"><DB class_id=\"0\">\n",
        );
        text += "<distLSB_>0.2</distLSB_>\n<enabled_><count>80</count><item>1</item><item>0</item></enabled_>\n";
        text += "<minIntensity_><count>80</count><item>0</item><item>40</item></minIntensity_>\n";
        text += "<maxIntensity_><count>80</count><item>255</item><item>235</item></maxIntensity_>\n";
        text += "<points_><count>80</count><item_version>1</item_version>\n";
        for id in 0..lasers {
            writeln!(
                text,
                "<item class_id=\"8\"><px class_id=\"9\"><id_>{id}</id_><rotCorrection_>-4.5</rotCorrection_>\
                 <vertCorrection_>-9</vertCorrection_><distCorrection_>123.4</distCorrection_>\
                 <distCorrectionX_>128</distCorrectionX_><distCorrectionY_>125</distCorrectionY_>\
                 <vertOffsetCorrection_>21.5</vertOffsetCorrection_><horizOffsetCorrection_>-2.6</horizOffsetCorrection_>\
                 <focalDistance_>1700</focalDistance_><focalSlope_>1.2</focalSlope_></px></item>"
            )
            .expect("a String takes it");
        }
        text + "</points_></DB></boost_serialization>"
    }

    #[test]
    fn what_is_written_is_read_again() {
        let read = Calibration::parse(&database(64)).expect("a database");
        let again = Calibration::parse(&write(&read)).expect("a database");
        assert_eq!(again.rings(), read.rings());
        for (a, b) in again.lasers().iter().zip(read.lasers()) {
            // A division and a multiplication, each rounded once: 2 · 2⁻⁵³ of at most 17 m.
            let near = Field::ALL.into_iter().all(|field| (field.get(a) - field.get(b)).abs() < 1e-14);
            assert!(near && a.enabled == b.enabled, "{a:?} {b:?}");
        }
    }

    #[test]
    fn degrees_and_centimetres_become_radians_and_metres() {
        // 80 entries, of which the 64 lasers count.
        let calibration = Calibration::parse(&database(80)).expect("a database");
        assert!((calibration.distance_unit_m() - 0.002).abs() < 1e-15);
        let laser = calibration.lasers()[1];
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
        near(laser.rotation_rad, -core::f64::consts::PI / 40.0); // 4.5° = π/40
        near(laser.vertical_rad, -core::f64::consts::PI / 20.0);
        near(laser.distance_m, 1.234);
        near(laser.distance_x_m, 1.28);
        near(laser.distance_y_m, 1.25);
        near(laser.vertical_offset_m, 0.215);
        near(laser.horizontal_offset_m, -0.026);
        near(laser.focal_distance_m, 17.0);
        near(laser.focal_slope, 1.2);
        assert_eq!((laser.min_intensity, laser.max_intensity, laser.enabled), (40, 235, false));
        assert!(calibration.lasers()[0].enabled && calibration.lasers()[2].enabled);
    }

    #[test]
    fn errors_name_the_line_and_what_is_wrong_there() {
        let error = |text: &str| Calibration::parse(text).expect_err("broken").to_string();
        assert!(error(&database(63)).starts_with("laser 63 is missing"));
        let broken = database(64).replacen("<vertCorrection_>-9<", "<vertCorrection_>low<", 1);
        // Six lines of head before the first laser.
        assert_eq!(error(&broken), "line 8: vertCorrection_ is `low`, a number was expected");
        let without = database(64).replacen("<rotCorrection_>-4.5</rotCorrection_>", "", 1);
        assert!(error(&without).starts_with("line 8: no rot_correction"), "{}", error(&without));
        let entity = "<!DOCTYPE a [<!ENTITY b \"1\">]><a>&b;</a>";
        assert!(error(entity).starts_with("db.xml is not well-formed: XML with DTD"), "{}", error(entity));
        assert!(error("<a><b></a>").starts_with("db.xml is not well-formed"));
        assert_eq!(Calibration::parse("<a/>"), Err(CalibrationError::Unrecognised));
    }
}

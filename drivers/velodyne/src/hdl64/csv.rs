//! Calibration as comma-separated values: a header of names in any order, a line per laser, radians and metres.

use super::calibration::{Calibration, CalibrationError, DISTANCE_UNIT_M, LaserCalibration};
use super::field::{Field, Gathered};

/// What a column holds.
#[derive(Clone, Copy, PartialEq)]
enum Column {
    Id,
    Value(Field),
}

/// Reads the table; empty lines and lines that start with `#` are passed over.
pub(super) fn parse(text: &str) -> Result<Calibration, CalibrationError> {
    let mut lines = (1usize..)
        .zip(text.lines())
        .map(|(number, line)| (number, line.trim()))
        .filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
    let (header_line, header) = lines.next().ok_or(CalibrationError::Unrecognised)?;
    let columns = columns(header_line, header)?;
    let mut gathered = Gathered::new();
    for (line, text) in lines {
        let found = text.split(',').count();
        if found != columns.len() {
            return Err(CalibrationError::Columns { line, found, expected: columns.len() });
        }
        // The id first: the other fields' errors name the laser.
        let mut id = None;
        for (column, value) in columns.iter().zip(text.split(',')) {
            if *column == Column::Id {
                id = Some(Gathered::id(line, number(line, "laser_id", value)?)?);
            }
        }
        let id = id.ok_or(CalibrationError::MissingField { line: header_line, field: "laser_id" })?;
        let mut laser = LaserCalibration::default();
        for (column, value) in columns.iter().zip(text.split(',')) {
            if let Column::Value(field) = column {
                field.put(&mut laser, id, number(line, field.name(), value)?)?;
            }
        }
        gathered.insert(line, id, laser)?;
    }
    gathered.finish(DISTANCE_UNIT_M)
}

fn columns(line: usize, header: &str) -> Result<Vec<Column>, CalibrationError> {
    let mut columns = Vec::with_capacity(12);
    for name in header.split(',').map(str::trim) {
        let column = match name {
            "laser_id" => Column::Id,
            name => Field::named(name)
                .map(Column::Value)
                .ok_or_else(|| CalibrationError::UnknownField { line, found: name.to_owned() })?,
        };
        columns.push(column);
    }
    for field in Field::NEEDED {
        if !columns.contains(&Column::Value(field)) {
            return Err(CalibrationError::MissingField { line, field: field.name() });
        }
    }
    Ok(columns)
}

fn number(line: usize, field: &'static str, text: &str) -> Result<f64, CalibrationError> {
    let text = text.trim();
    text.parse().map_err(|_not_a_number| CalibrationError::Number { line, field, found: text.to_owned() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fmt::Write;

    fn table(header: &str, row: impl Fn(usize) -> String) -> String {
        let mut text = format!("{header}\n");
        for id in 0..64 {
            writeln!(text, "{}", row(id)).expect("a String takes it");
        }
        text
    }

    #[test]
    fn columns_are_found_by_name_in_any_order() {
        let text = table("vert_correction, laser_id,dist_correction,rot_correction,max_intensity", |id| {
            format!("-0.1,{},1.25,0.0{},200", 63 - id, id % 10)
        });
        let calibration = Calibration::parse(&text).expect("a full table");
        // Laser 61 is in line id = 2: rotation 0.02.
        let laser = calibration.lasers()[61];
        let found = (laser.rotation_rad, laser.vertical_rad, laser.distance_m, laser.max_intensity, laser.two_point());
        assert_eq!(found, (0.02, -0.1, 1.25, 200, false));
    }

    #[test]
    fn errors_name_the_line_and_what_is_wrong_there() {
        let header = "laser_id,rot_correction,vert_correction,dist_correction";
        let good = |id: usize| format!("{id},0,0,1");
        let error = |text: String| Calibration::parse(&text).expect_err("broken").to_string();
        let number = error(table(header, |id| if id == 3 { "3,0,x,1".into() } else { good(id) }));
        assert_eq!(number, "line 5: vert_correction is `x`, a number was expected");
        let twice = error(table(header, |id| if id == 4 { good(3) } else { good(id) }));
        assert!(twice.starts_with("line 6: laser 3 is there a second time"), "{twice}");
        let short = error(table(header, |id| if id == 9 { "9,0,0".into() } else { good(id) }));
        assert_eq!(short, "line 11 has 3 values, the header names 4");
        let alien = error(table(header, |id| if id == 9 { "64,0,0,1".into() } else { good(id) }));
        assert!(alien.starts_with("line 11: laser id 64"), "{alien}");
        let missing = error(format!("{header}\n0,0,0,1\n"));
        assert!(missing.starts_with("laser 1 is missing"), "{missing}");
        let misspelt = error("laser_id,rot_correction,vert_corection,dist_correction\n".into());
        assert!(
            misspelt.starts_with("line 1: unknown field `vert_corection`; expected one of laser_id, rot_correction")
        );
        let without = error("laser_id,rot_correction,vert_correction\n".into());
        assert!(without.starts_with("line 1: no dist_correction"), "{without}");
    }
}

//! Calibration as ROS `velodyne_pointcloud` and velodyne_decoder write it: YAML, radians and metres.
//!
//! Read from the parser's events, without building a tree: depth costs no stack, and every error has its line.

use super::calibration::{Calibration, CalibrationError, DISTANCE_UNIT_M, LASERS, LaserCalibration};
use super::field::{Field, Gathered};
use saphyr_parser::{Event, Parser, StrInput};

struct Events<'a> {
    parser: Parser<'a, StrInput<'a>>,
    line: usize,
}

impl<'a> Events<'a> {
    fn next(&mut self) -> Result<Event<'a>, CalibrationError> {
        match self.parser.next_event() {
            Some(Ok((event, span))) => {
                self.line = span.start.line();
                Ok(event)
            }
            Some(Err(error)) => {
                Err(CalibrationError::Yaml { line: error.marker().line(), reason: error.info().to_owned() })
            }
            None => Err(self.unexpected("the text ends here")),
        }
    }

    fn unexpected(&self, reason: &str) -> CalibrationError {
        CalibrationError::Yaml { line: self.line, reason: reason.to_owned() }
    }

    /// The value behind a key must be a number.
    fn number(&mut self, field: &'static str) -> Result<f64, CalibrationError> {
        let Event::Scalar(text, ..) = self.next()? else {
            return Err(self.unexpected("a number was expected"));
        };
        text.parse().map_err(|_not_a_number| CalibrationError::Number {
            line: self.line,
            field,
            found: text.into_owned(),
        })
    }

    /// Passes over the value behind a key that is not ours.
    fn skip(&mut self) -> Result<(), CalibrationError> {
        let mut depth = 0usize;
        loop {
            match self.next()? {
                Event::SequenceStart(..) | Event::MappingStart(..) => depth += 1,
                Event::SequenceEnd | Event::MappingEnd => depth = depth.saturating_sub(1),
                Event::StreamEnd => return Err(self.unexpected("the text ends here")),
                _ => {}
            }
            if depth == 0 {
                return Ok(());
            }
        }
    }
}

/// Reads `lasers:` (64 maps), `num_lasers:` and `distance_resolution:`; other keys of the top map are passed over.
pub(super) fn parse(text: &str) -> Result<Calibration, CalibrationError> {
    let mut events = Events { parser: Parser::new_from_str(text), line: 1 };
    loop {
        match events.next()? {
            Event::StreamStart | Event::DocumentStart(_) | Event::Nothing => {}
            Event::MappingStart(..) => break,
            _ => return Err(events.unexpected("a map was expected")),
        }
    }
    let mut gathered = Gathered::new();
    let mut unit = DISTANCE_UNIT_M;
    loop {
        match events.next()? {
            Event::MappingEnd => break,
            Event::Scalar(key, ..) => match key.as_ref() {
                "lasers" => lasers(&mut events, &mut gathered)?,
                "distance_resolution" => unit = events.number("distance_resolution")?,
                "num_lasers" => {
                    let found = events.number("num_lasers")?;
                    if found != LASERS as f64 {
                        return Err(CalibrationError::LaserCount { line: events.line, found });
                    }
                }
                _ => events.skip()?,
            },
            _ => return Err(events.unexpected("a key was expected")),
        }
    }
    gathered.finish(unit)
}

fn lasers(events: &mut Events<'_>, gathered: &mut Gathered) -> Result<(), CalibrationError> {
    let Event::SequenceStart(..) = events.next()? else {
        return Err(events.unexpected("a list of lasers was expected"));
    };
    loop {
        match events.next()? {
            Event::SequenceEnd => return Ok(()),
            Event::MappingStart(..) => laser(events, gathered)?,
            _ => return Err(events.unexpected("the map of a laser was expected")),
        }
    }
}

fn laser(events: &mut Events<'_>, gathered: &mut Gathered) -> Result<(), CalibrationError> {
    let start = events.line;
    let mut id = None;
    let mut two_point = true;
    // Kept until the id is known, so that an implausible number can name its laser.
    let mut values: [Option<f64>; Field::ALL.len()] = [None; Field::ALL.len()];
    loop {
        match events.next()? {
            Event::MappingEnd => break,
            Event::Scalar(key, ..) => match key.as_ref() {
                "laser_id" => id = Some(Gathered::id(events.line, events.number("laser_id")?)?),
                "two_pt_correction_available" => match events.next()? {
                    Event::Scalar(text, ..) if text == "true" || text == "false" => two_point = text == "true",
                    _ => return Err(events.unexpected("true or false was expected")),
                },
                name => {
                    let field = Field::named(name)
                        .ok_or_else(|| CalibrationError::UnknownField { line: events.line, found: name.to_owned() })?;
                    let value = events.number(field.name())?;
                    if let Some(slot) = values.get_mut(field as usize) {
                        *slot = Some(value);
                    }
                }
            },
            _ => return Err(events.unexpected("a key was expected")),
        }
    }
    let id = id.ok_or(CalibrationError::MissingField { line: start, field: "laser_id" })?;
    let mut laser = LaserCalibration::default();
    for (field, value) in Field::ALL.into_iter().zip(values) {
        match value {
            Some(value) => field.put(&mut laser, id, value)?,
            None if Field::NEEDED.contains(&field) => {
                return Err(CalibrationError::MissingField { line: start, field: field.name() });
            }
            None => {}
        }
    }
    if !two_point {
        (laser.distance_x_m, laser.distance_y_m) = (0.0, 0.0);
    }
    gathered.insert(start, id, laser)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fmt::Write;

    fn file(lasers: usize) -> String {
        let mut text = String::from("# of the unit on the mast\nlasers:\n");
        for id in 0..lasers {
            writeln!(
                text,
                "- {{dist_correction: 1.238, dist_correction_x: 1.281, dist_correction_y: 1.251, focal_distance: 17.0, \
                 focal_slope: 1.2, horiz_offset_correction: 0.026, laser_id: {id}, max_intensity: 235, min_intensity: 40, \
                 rot_correction: -0.0794, vert_correction: -0.10978, vert_offset_correction: 0.215}}"
            )
            .expect("a String takes it");
        }
        text + "num_lasers: 64\ndistance_resolution: 0.002\nstatus:\n  Model: S3\n  IP: [1, {a: 2}]\n"
    }

    #[test]
    fn flow_and_block_maps_read_alike() {
        let flow = Calibration::parse(&file(64)).expect("a full file");
        let mut text = String::from("---\nstatus: {IP: [1, 2]}\nlasers:\n");
        for id in 0..64 {
            write!(
                text,
                "  - dist_correction: 1.238\n    dist_correction_x: 1.281\n    dist_correction_y: 1.251\n    \
                 focal_distance: 17.0\n    focal_slope: 1.2\n    horiz_offset_correction: 0.026\n    laser_id: {id}\n    \
                 max_intensity: 235\n    min_intensity: 40\n    rot_correction: -0.0794\n    \
                 vert_correction: -0.10978\n    vert_offset_correction: 0.215\n"
            )
            .expect("a String takes it");
        }
        let block = Calibration::parse(&text).expect("a full file");
        assert!(block == flow);
        let laser = flow.lasers()[63];
        let expected = LaserCalibration {
            rotation_rad: -0.0794,
            vertical_rad: -0.10978,
            distance_m: 1.238,
            distance_x_m: 1.281,
            distance_y_m: 1.251,
            vertical_offset_m: 0.215,
            horizontal_offset_m: 0.026,
            focal_distance_m: 17.0,
            focal_slope: 1.2,
            min_intensity: 40,
            max_intensity: 235,
            enabled: true,
        };
        assert_eq!(laser, expected);
    }

    #[test]
    fn a_laser_marked_one_point_forgets_its_near_distances() {
        let text = file(64).replacen("laser_id: 2,", "laser_id: 2, two_pt_correction_available: false,", 1);
        let calibration = Calibration::parse(&text).expect("a full file");
        assert!(!calibration.lasers()[2].two_point() && calibration.lasers()[3].two_point());
    }

    #[test]
    fn errors_name_the_line_and_what_is_wrong_there() {
        let error = |text: &str| Calibration::parse(text).expect_err("broken").to_string();
        assert!(error(&file(32)).starts_with("laser 32 is missing"));
        let of = |from: &str, to: &str| error(&file(64).replacen(from, to, 1));
        // Two lines of head before laser 0 in line 3.
        assert_eq!(of("17.0", "far"), "line 3: focal_distance is `far`, a number was expected");
        assert!(of("focal_slope", "focal_slop").starts_with("line 3: unknown field `focal_slop`"));
        assert!(of("laser_id: 1,", "laser_id: 0,").starts_with("line 4: laser 0 is there a second time"));
        assert!(of("laser_id: 1,", "laser_id: 1.5,").starts_with("line 4: laser id 1.5"));
        assert!(of("rot_correction: -0.0794, ", "").starts_with("line 3: no rot_correction"));
        assert!(of("num_lasers: 64", "num_lasers: 32").starts_with("line 67: 32 lasers"));
        assert!(of("distance_resolution: 0.002", "distance_resolution: 2").starts_with("distance resolution 2 m"));
        assert!(of("- {dist", "- [dist").starts_with("line 3: the map of a laser was expected"));
        assert!(error("lasers: 5\n").starts_with("line 1: a list of lasers was expected"));
        assert!(error("lasers: [{a: *b}]\n").starts_with("line 1: "), "{}", error("lasers: [{a: *b}]\n"));
    }
}

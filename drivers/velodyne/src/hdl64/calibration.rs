//! The factory calibration of an HDL-64E: what its 64 lasers need to become one instrument.
//!
//! Angles in radians, lengths in metres, whatever the file said. The names in files are those of
//! ROS `velodyne_pointcloud`, which took them from Velodyne's `db.xml`.

use super::field::Field;
use super::{csv, db_xml, yaml};

/// Lasers of an HDL-64E: 0..32 upper bank, 32..64 lower bank.
pub const LASERS: usize = 64;
/// Metres per count of the distance field (HDL-64E manual: 2 mm).
pub const DISTANCE_UNIT_M: f64 = 0.002;

/// Why a text or a status stream is not an HDL-64E calibration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CalibrationError {
    /// None of the three formats.
    #[error(
        "this is no HDL-64E calibration: expected Velodyne's db.xml, a YAML file with `lasers:`, or CSV whose first line \
         names the columns (laser_id,rot_correction,vert_correction,dist_correction,…)"
    )]
    Unrecognised,
    /// Not well-formed XML.
    #[error("db.xml is not well-formed: {0}")]
    Xml(#[from] roxmltree::Error),
    /// Not well-formed YAML, or a shape other than the one of `velodyne_pointcloud`.
    #[error(
        "line {line}: {reason}; expected `lasers:` followed by 64 maps such as `- {{laser_id: 0, rot_correction: …}}`"
    )]
    Yaml {
        /// Line, from 1.
        line: usize,
        /// What the reader ran into.
        reason: String,
    },
    /// A field name that is none.
    #[error("line {line}: unknown field `{found}`; expected one of laser_id, {}", Field::NAMES.join(", "))]
    UnknownField {
        /// Line, from 1.
        line: usize,
        /// The name found.
        found: String,
    },
    /// A field every laser needs is not there.
    #[error("line {line}: no {field}; every laser needs laser_id, rot_correction, vert_correction and dist_correction")]
    MissingField {
        /// Line of the header or of the laser, from 1.
        line: usize,
        /// The name missing, as in CSV and YAML.
        field: &'static str,
    },
    /// A CSV line with more or fewer values than the header has names.
    #[error("line {line} has {found} values, the header names {expected}")]
    Columns {
        /// Line, from 1.
        line: usize,
        /// Values found.
        found: usize,
        /// Values expected.
        expected: usize,
    },
    /// Something that should be a number.
    #[error("line {line}: {field} is `{found}`, a number was expected")]
    Number {
        /// Line, from 1.
        line: usize,
        /// The field's name.
        field: &'static str,
        /// The text found.
        found: String,
    },
    /// A laser id outside 0..64.
    #[error("line {line}: laser id {found}; an HDL-64E has lasers 0 to 63")]
    LaserId {
        /// Line, from 1; 0 for a calibration out of the packets.
        line: usize,
        /// The id found.
        found: f64,
    },
    /// A count of lasers other than 64.
    #[error("line {line}: {found} lasers; this is a file of another sensor, an HDL-64E has 64")]
    LaserCount {
        /// Line, from 1.
        line: usize,
        /// The count found.
        found: f64,
    },
    /// A laser given twice.
    #[error("line {line}: laser {laser} is there a second time; each of the 64 lasers belongs there once")]
    Duplicate {
        /// Line, from 1; 0 for a calibration out of the packets.
        line: usize,
        /// The laser.
        laser: u8,
    },
    /// A laser not given.
    #[error("laser {laser} is missing; all lasers from 0 to 63 are needed")]
    MissingLaser {
        /// The first laser missing.
        laser: u8,
    },
    /// A number no HDL-64E can have: mostly another unit.
    #[error(
        "laser {laser}: {field} is {found}, expected {low} to {high}; angles are in radians, lengths in metres (db.xml: degrees, centimetres)"
    )]
    Implausible {
        /// The laser.
        laser: u8,
        /// The field's name.
        field: &'static str,
        /// The value, in SI.
        found: f64,
        /// Lowest value accepted.
        low: f64,
        /// Highest value accepted.
        high: f64,
    },
    /// A distance unit no HDL-64E has.
    #[error("distance resolution {found} m; an HDL-64E counts in 0.002 m")]
    DistanceUnit {
        /// The value, metres.
        found: f64,
    },
}

/// What one laser needs. Defaults (0, intensities 0..255) leave the ideal beam as it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaserCalibration {
    /// Horizontal angle of the laser against the head, radians, subtracted from the encoder's azimuth.
    pub rotation_rad: f64,
    /// Elevation, radians, up positive.
    pub vertical_rad: f64,
    /// Added to every distance (far point, 25.04 m), metres.
    pub distance_m: f64,
    /// The same at 2.40 m along the sensor's X. With `distance_y_m` both 0: no two-point calibration.
    pub distance_x_m: f64,
    /// The same at 1.93 m along the sensor's Y.
    pub distance_y_m: f64,
    /// Height of the beam's origin over the sensor's, metres.
    pub vertical_offset_m: f64,
    /// Sideways offset of the beam's origin, metres.
    pub horizontal_offset_m: f64,
    /// Distance at which the beam is in focus, metres.
    pub focal_distance_m: f64,
    /// Strength of the intensity's correction for defocus; 0 = none.
    pub focal_slope: f64,
    /// Corrected intensities below are raised to it.
    pub min_intensity: u8,
    /// Corrected intensities above are lowered to it.
    pub max_intensity: u8,
    /// Returns of a laser that is not enabled are left out.
    pub enabled: bool,
}

impl Default for LaserCalibration {
    fn default() -> Self {
        Self {
            rotation_rad: 0.0,
            vertical_rad: 0.0,
            distance_m: 0.0,
            distance_x_m: 0.0,
            distance_y_m: 0.0,
            vertical_offset_m: 0.0,
            horizontal_offset_m: 0.0,
            focal_distance_m: 0.0,
            focal_slope: 0.0,
            min_intensity: 0,
            max_intensity: 255,
            enabled: true,
        }
    }
}

impl LaserCalibration {
    /// Whether the near points were measured. Tables of one point leave both at 0.
    pub fn two_point(&self) -> bool {
        self.distance_x_m != 0.0 || self.distance_y_m != 0.0
    }
}

/// The 64 lasers, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    lasers: [LaserCalibration; LASERS],
    rings: [u8; LASERS],
    distance_unit_m: f64,
}

impl Calibration {
    /// Checks the lasers and ranks them by elevation.
    ///
    /// # Errors
    /// [`CalibrationError::Implausible`].
    pub fn new(lasers: [LaserCalibration; LASERS]) -> Result<Self, CalibrationError> {
        Self::with_unit(lasers, DISTANCE_UNIT_M)
    }

    pub(super) fn with_unit(
        mut lasers: [LaserCalibration; LASERS],
        distance_unit_m: f64,
    ) -> Result<Self, CalibrationError> {
        // Half to twice 2 mm: another sensor's 4 mm is inside, centimetres and millimetres are not.
        let plausible = (0.001..=0.004).contains(&distance_unit_m);
        if !plausible {
            return Err(CalibrationError::DistanceUnit { found: distance_unit_m });
        }
        for (id, laser) in (0u8..).zip(lasers.iter_mut()) {
            for field in Field::ALL {
                let value = field.get(laser);
                field.put(laser, id, value)?;
            }
            if laser.min_intensity > laser.max_intensity {
                return Err(CalibrationError::Implausible {
                    laser: id,
                    field: Field::MaxIntensity.name(),
                    found: f64::from(laser.max_intensity),
                    low: f64::from(laser.min_intensity),
                    high: 255.0,
                });
            }
        }
        Ok(Self { rings: rings(&lasers), lasers, distance_unit_m })
    }

    /// Reads db.xml, YAML or CSV, whichever the text is.
    ///
    /// # Errors
    /// [`CalibrationError`] with the line and the remedy.
    pub fn parse(text: &str) -> Result<Self, CalibrationError> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let mut lines = text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
        let first = lines.next().unwrap_or_default();
        if first.starts_with('<') {
            db_xml::parse(text)
        } else if first.split(',').any(|name| name.trim() == "laser_id") {
            csv::parse(text)
        } else if text.lines().any(|line| line.starts_with("lasers:")) {
            yaml::parse(text)
        } else {
            Err(CalibrationError::Unrecognised)
        }
    }

    /// As Velodyne's `db.xml`: [`Self::parse`] reads it.
    pub fn to_db_xml(&self) -> String {
        db_xml::write(self)
    }

    /// The lasers by id.
    pub fn lasers(&self) -> &[LaserCalibration; LASERS] {
        &self.lasers
    }

    /// Rank of each laser by elevation, 0 = lowest; lasers of equal elevation rank by id.
    pub fn rings(&self) -> &[u8; LASERS] {
        &self.rings
    }

    /// Metres per count of the distance field.
    pub fn distance_unit_m(&self) -> f64 {
        self.distance_unit_m
    }
}

fn rings(lasers: &[LaserCalibration; LASERS]) -> [u8; LASERS] {
    let mut order: [(u8, f64); LASERS] = [(0, 0.0); LASERS];
    for (id, (slot, laser)) in (0u8..).zip(order.iter_mut().zip(lasers)) {
        *slot = (id, laser.vertical_rad);
    }
    order.sort_by(|a, b| a.1.total_cmp(&b.1).then(a.0.cmp(&b.0)));
    let mut rings = [0; LASERS];
    for (rank, (id, _)) in (0u8..).zip(order) {
        if let Some(ring) = rings.get_mut(usize::from(id)) {
            *ring = rank;
        }
    }
    rings
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ring_zero_is_the_lowest_laser() {
        let mut lasers = [LaserCalibration::default(); LASERS];
        lasers[5].vertical_rad = -0.4;
        lasers[9].vertical_rad = 0.03;
        let calibration = Calibration::new(lasers).expect("plausible");
        // Of the 62 level lasers, laser 0 comes first behind the lowest, laser 63 last before the highest.
        let ring = |laser: usize| calibration.rings()[laser];
        assert_eq!((ring(5), ring(0), ring(63), ring(9)), (0, 1, 62, 63));
    }

    #[test]
    fn degrees_and_centimetres_are_told_from_radians_and_metres() {
        let refused = |change: fn(&mut LaserCalibration)| {
            let mut lasers = [LaserCalibration::default(); LASERS];
            change(&mut lasers[7]);
            match Calibration::new(lasers).expect_err("implausible") {
                CalibrationError::Implausible { laser, field, .. } => (laser, field),
                other => panic!("{other}"),
            }
        };
        assert_eq!(refused(|l| l.vertical_rad = -24.8), (7, "vert_correction"));
        assert_eq!(refused(|l| l.distance_m = 118.0), (7, "dist_correction"));
        assert_eq!(refused(|l| l.focal_distance_m = 1500.0), (7, "focal_distance"));
        assert_eq!(refused(|l| l.rotation_rad = f64::NAN), (7, "rot_correction"));
        assert_eq!(refused(|l| (l.min_intensity, l.max_intensity) = (9, 8)), (7, "max_intensity"));
    }

    #[test]
    fn a_text_of_no_known_format_names_the_three() {
        let error = Calibration::parse("lidar: 64\n").expect_err("no calibration");
        assert_eq!(error, CalibrationError::Unrecognised);
        assert!(error.to_string().contains("db.xml") && error.to_string().contains("CSV"));
    }
}

//! The numbers of a laser as files name them, and lasers gathered from a file until all 64 are there.

use super::calibration::{Calibration, CalibrationError, LASERS, LaserCalibration};

/// A number of a laser in files, by its name in CSV and YAML.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Field {
    Rotation,
    Vertical,
    Distance,
    DistanceX,
    DistanceY,
    VerticalOffset,
    HorizontalOffset,
    FocalDistance,
    FocalSlope,
    MinIntensity,
    MaxIntensity,
}

impl Field {
    pub(super) const ALL: [Self; 11] = [
        Self::Rotation,
        Self::Vertical,
        Self::Distance,
        Self::DistanceX,
        Self::DistanceY,
        Self::VerticalOffset,
        Self::HorizontalOffset,
        Self::FocalDistance,
        Self::FocalSlope,
        Self::MinIntensity,
        Self::MaxIntensity,
    ];
    pub(super) const NAMES: [&'static str; 11] = [
        "rot_correction",
        "vert_correction",
        "dist_correction",
        "dist_correction_x",
        "dist_correction_y",
        "vert_offset_correction",
        "horiz_offset_correction",
        "focal_distance",
        "focal_slope",
        "min_intensity",
        "max_intensity",
    ];
    /// Without these three a table says nothing.
    pub(super) const NEEDED: [Self; 3] = [Self::Rotation, Self::Vertical, Self::Distance];

    pub(super) fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|field| field.name() == name)
    }

    pub(super) fn name(self) -> &'static str {
        Self::NAMES.get(self as usize).copied().unwrap_or_default()
    }

    /// What is accepted, SI. Angles: the lasers span −25°..+2° and ±10°, so 46° holds any of them and tells degrees
    /// from radians. Lengths: factory tables hold 0.8..1.6 m distances and 0.03..0.3 m offsets; centimetres are 100 ×.
    /// Focus: 131 m is where its formula turns ([`super::geometry`]).
    fn limits(self) -> (f64, f64) {
        match self {
            Self::Rotation | Self::Vertical => (-0.8, 0.8),
            Self::Distance | Self::DistanceX | Self::DistanceY => (-5.0, 5.0),
            Self::VerticalOffset | Self::HorizontalOffset => (-1.0, 1.0),
            Self::FocalDistance => (0.0, 131.0),
            Self::FocalSlope => (-100.0, 100.0),
            Self::MinIntensity | Self::MaxIntensity => (0.0, 255.0),
        }
    }

    /// Puts `value` (SI) into `laser`, whose number is `id`.
    pub(super) fn put(self, laser: &mut LaserCalibration, id: u8, value: f64) -> Result<(), CalibrationError> {
        let (low, high) = self.limits();
        let plausible = value >= low && value <= high; // false for NaN
        if !plausible {
            return Err(CalibrationError::Implausible { laser: id, field: self.name(), found: value, low, high });
        }
        match self {
            Self::Rotation => laser.rotation_rad = value,
            Self::Vertical => laser.vertical_rad = value,
            Self::Distance => laser.distance_m = value,
            Self::DistanceX => laser.distance_x_m = value,
            Self::DistanceY => laser.distance_y_m = value,
            Self::VerticalOffset => laser.vertical_offset_m = value,
            Self::HorizontalOffset => laser.horizontal_offset_m = value,
            Self::FocalDistance => laser.focal_distance_m = value,
            Self::FocalSlope => laser.focal_slope = value,
            Self::MinIntensity => laser.min_intensity = libm::round(value) as u8,
            Self::MaxIntensity => laser.max_intensity = libm::round(value) as u8,
        }
        Ok(())
    }

    pub(super) fn get(self, laser: &LaserCalibration) -> f64 {
        match self {
            Self::Rotation => laser.rotation_rad,
            Self::Vertical => laser.vertical_rad,
            Self::Distance => laser.distance_m,
            Self::DistanceX => laser.distance_x_m,
            Self::DistanceY => laser.distance_y_m,
            Self::VerticalOffset => laser.vertical_offset_m,
            Self::HorizontalOffset => laser.horizontal_offset_m,
            Self::FocalDistance => laser.focal_distance_m,
            Self::FocalSlope => laser.focal_slope,
            Self::MinIntensity => f64::from(laser.min_intensity),
            Self::MaxIntensity => f64::from(laser.max_intensity),
        }
    }
}

/// Lasers as they come, until all 64 are there.
#[derive(Clone, Debug)]
pub(super) struct Gathered([Option<LaserCalibration>; LASERS]);

impl Gathered {
    pub(super) fn new() -> Self {
        Self([None; LASERS])
    }

    /// The laser a number names.
    pub(super) fn id(line: usize, found: f64) -> Result<u8, CalibrationError> {
        let id = libm::round(found);
        let valid = id == found && (0.0..LASERS as f64).contains(&id);
        if valid { Ok(id as u8) } else { Err(CalibrationError::LaserId { line, found }) }
    }

    pub(super) fn insert(&mut self, line: usize, id: u8, laser: LaserCalibration) -> Result<(), CalibrationError> {
        match self.0.get_mut(usize::from(id)) {
            None => Err(CalibrationError::LaserId { line, found: f64::from(id) }),
            Some(Some(_)) => Err(CalibrationError::Duplicate { line, laser: id }),
            Some(free) => {
                *free = Some(laser);
                Ok(())
            }
        }
    }

    pub(super) fn finish(self, distance_unit_m: f64) -> Result<Calibration, CalibrationError> {
        let mut lasers = [LaserCalibration::default(); LASERS];
        for (id, (laser, gathered)) in (0u8..).zip(lasers.iter_mut().zip(self.0)) {
            *laser = gathered.ok_or(CalibrationError::MissingLaser { laser: id })?;
        }
        Calibration::with_unit(lasers, distance_unit_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_fields_are_in_the_same_order() {
        for (field, name) in Field::ALL.into_iter().zip(Field::NAMES) {
            assert_eq!((field.name(), Field::named(name)), (name, Some(field)));
        }
    }

    #[test]
    fn a_field_gives_back_what_was_put() {
        let mut laser = LaserCalibration::default();
        for (n, field) in (1u8..).zip(Field::ALL) {
            let value = if n < 10 { f64::from(n) / 16.0 } else { f64::from(n) };
            field.put(&mut laser, 0, value).expect("plausible");
            assert_eq!(field.get(&laser), value, "{}", field.name());
        }
        // All eleven went to places of their own: the first still holds 1/16.
        assert_eq!(Field::ALL[0].get(&laser), 0.0625);
    }
}

//! Arguments of `register` as people write them.

use nalgebra::Point3;
use tumbled_core::register::SensorKind;

/// What made the two clouds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Sensors {
    pub(super) moving: SensorKind,
    pub(super) reference: SensorKind,
}

impl Sensors {
    /// The sparser cloud is the LiDAR's; of two alike the reference.
    pub(super) const fn by_density(moving: usize, reference: usize) -> Self {
        if moving < reference {
            Self { moving: SensorKind::Lidar, reference: SensorKind::Kinect }
        } else {
            Self { moving: SensorKind::Kinect, reference: SensorKind::Lidar }
        }
    }
}

/// Where a sensor stood; `None` inside: nobody knows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Viewpoint(pub(super) Option<Point3<f32>>);

pub(super) fn sensors(text: &str) -> Result<Sensors, String> {
    let expected = || "expected e.g. moving=lidar,reference=kinect (each lidar or kinect)".to_owned();
    let (mut moving, mut reference) = (None, None);
    for part in text.split(',') {
        let (cloud, sensor) = part.split_once('=').ok_or_else(expected)?;
        let kind = match sensor.trim() {
            "lidar" => SensorKind::Lidar,
            "kinect" => SensorKind::Kinect,
            _ => return Err(expected()),
        };
        let place = match cloud.trim() {
            "moving" => &mut moving,
            "reference" => &mut reference,
            _ => return Err(expected()),
        };
        if place.replace(kind).is_some() {
            return Err(expected());
        }
    }
    match (moving, reference) {
        (Some(moving), Some(reference)) => Ok(Sensors { moving, reference }),
        _ => Err(expected()),
    }
}

pub(super) fn viewpoint(text: &str) -> Result<Viewpoint, String> {
    if text.trim() == "none" {
        return Ok(Viewpoint(None));
    }
    let numbers: Option<Vec<f32>> =
        text.split(',').map(|number| number.trim().parse().ok().filter(|n: &f32| n.is_finite())).collect();
    match numbers.as_deref() {
        Some([x, y, z]) => Ok(Viewpoint(Some(Point3::new(*x, *y, *z)))),
        _ => Err("expected three numbers x,y,z in metres, or `none`".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sensors_are_named_for_both_clouds_once() {
        let both = Sensors { moving: SensorKind::Lidar, reference: SensorKind::Lidar };
        assert_eq!(sensors("moving=lidar,reference=lidar"), Ok(both));
        assert_eq!(sensors("reference=lidar, moving=lidar"), Ok(both));
        for wrong in ["moving=lidar", "moving=lidar,moving=kinect", "moving=radar,reference=lidar", "lidar", ""] {
            assert!(sensors(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn the_sparser_cloud_is_the_lidars() {
        assert_eq!(Sensors::by_density(100, 2000).moving, SensorKind::Lidar);
        assert_eq!(Sensors::by_density(2000, 100).reference, SensorKind::Lidar);
    }

    #[test]
    fn a_viewpoint_is_three_numbers_or_none() {
        assert_eq!(viewpoint("1, -2,0.5"), Ok(Viewpoint(Some(Point3::new(1.0, -2.0, 0.5)))));
        assert_eq!(viewpoint("none"), Ok(Viewpoint(None)));
        for wrong in ["", "1,2", "1,2,nan", "1,2,3,4", "origin"] {
            assert!(viewpoint(wrong).is_err(), "{wrong}");
        }
    }
}

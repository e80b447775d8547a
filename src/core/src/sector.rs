//! The region of interest as a LiDAR's head sweeps over it: from which azimuth to which, and where a turn is cut.

use crate::config::RegionOfInterest;
use core::f64::consts::PI;
use tumbled_model::{Iso, Lidar, Rig};

/// A full turn, 0.01°.
pub const TURN_CDEG: i32 = 36_000;
const HALF_TURN_CDEG: i32 = TURN_CDEG / 2;

/// Beams point up to 9° beside the head (HDL-64E; the VLP-32C's 4.2°), and the turn is cut where all have passed.
const MARGIN_CDEG: i32 = 1_000;

/// A sector of azimuths round the region of interest.
///
/// ```text
///      -180°          -reach   -half      0      +half   +reach          +180°
///  ──────┼───────────────┼───────┼────────┼────────┼────────┼──────────────┼──▶ head, relative to the centre
///        next turn       │       │ region of interest       │ cut: the turn ends
///                        └────────── crossing ──────────────┘
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sector {
    center_cdeg: i32,
    half_cdeg: i32,
    reach_cdeg: i32,
}

impl Sector {
    /// The sector in which a LiDAR mounted so sees the region; a whole turn when it stands inside, or above or below.
    pub fn new(roi: &RegionOfInterest, t_rig_lidar: &Iso<Rig, Lidar>) -> Self {
        let center = t_rig_lidar.inverse() * roi.center;
        let (x, y) = (center.coords.x, center.coords.y);
        let distance = (x * x + y * y).sqrt();
        let half_rad = if distance > roi.radius_m { libm::asin(roi.radius_m / distance) } else { PI };
        // Velodyne azimuths run clockwise from above: y to the left is 270°.
        let center_cdeg = to_cdeg(libm::atan2(-y, x)).rem_euclid(TURN_CDEG);
        let half_cdeg = to_cdeg(half_rad).clamp(1, HALF_TURN_CDEG);
        Self { center_cdeg, half_cdeg, reach_cdeg: (half_cdeg + MARGIN_CDEG).min(HALF_TURN_CDEG) }
    }

    /// Where a head stands relative to the centre, 0.01°, −18000..18000.
    pub fn offset(&self, head_cdeg: u16) -> i32 {
        (i32::from(head_cdeg) - self.center_cdeg + HALF_TURN_CDEG).rem_euclid(TURN_CDEG) - HALF_TURN_CDEG
    }

    /// Whether a head at this offset may see the region. The cut itself belongs to the next turn.
    pub fn is_crossing(&self, offset: i32) -> bool {
        (-self.reach_cdeg..self.reach_cdeg).contains(&offset)
    }

    /// Whether a head at this offset points at the region itself.
    pub fn is_region(&self, offset: i32) -> bool {
        offset.abs() <= self.half_cdeg
    }

    /// Width of the region, 0.01°.
    pub fn width_cdeg(&self) -> i32 {
        2 * self.half_cdeg
    }

    /// How far a head at this offset has to turn until the turn is cut, 0.01°, 1..=36000.
    pub fn to_cut(&self, offset: i32) -> i32 {
        forward(offset, self.reach_cdeg)
    }

    /// How far a head at this offset has to turn until the region's centre, 0.01°, 1..=36000.
    pub fn to_center(&self, offset: i32) -> i32 {
        forward(offset, 0)
    }

    /// How far it is from the cut to the next centre, 0.01°.
    pub fn cut_to_center(&self) -> i32 {
        forward(self.reach_cdeg, 0)
    }
}

/// The way forward from one offset to another; a whole turn when they are the same.
fn forward(from: i32, to: i32) -> i32 {
    match (to - from).rem_euclid(TURN_CDEG) {
        0 => TURN_CDEG,
        way => way,
    }
}

fn to_cdeg(rad: f64) -> i32 {
    libm::round(rad * (f64::from(HALF_TURN_CDEG) / PI)) as i32
}

#[cfg(test)]
mod tests {
    use super::*;
    use tumbled_model::Point;

    fn sector(x: f64, y: f64, radius_m: f64) -> Sector {
        Sector::new(&RegionOfInterest { center: Point::new(x, y, 0.0), radius_m }, &Iso::identity())
    }

    #[test]
    fn the_default_region_is_seen_from_323_to_37_degrees() {
        // asin(1.2 / 2.0) = 36.87 degrees to both sides of straight ahead; cut 10 degrees behind.
        let ahead = sector(2.0, 0.0, 1.2);
        assert_eq!(ahead.width_cdeg(), 7_374);
        assert!(ahead.is_region(ahead.offset(3_687)) && !ahead.is_region(ahead.offset(3_688)));
        assert!(ahead.is_region(ahead.offset(32_313)) && !ahead.is_region(ahead.offset(32_312)));
        assert_eq!(ahead.to_cut(ahead.offset(0)), 4_687);
        assert_eq!(ahead.to_cut(ahead.offset(4_687)), 36_000);
        assert_eq!(ahead.to_center(ahead.offset(35_990)), 10);
    }

    #[test]
    fn a_region_to_the_left_lies_at_270_degrees() {
        let left = sector(0.0, 3.0, 0.3);
        assert_eq!(left.offset(27_000), 0);
        assert_eq!(left.offset(26_900), -100);
    }

    #[test]
    fn from_within_the_region_the_turn_is_cut_behind_the_centre() {
        let within = sector(0.5, 0.0, 1.0);
        assert_eq!(within.width_cdeg(), 36_000);
        assert_eq!(within.to_cut(within.offset(0)), 18_000);
        assert!(within.is_crossing(within.offset(18_000)));
    }

    #[test]
    fn the_mounting_turns_the_sector() {
        // A LiDAR that looks to the rig's left (90 degrees about z) sees what lies left of the rig straight ahead.
        let half = core::f64::consts::FRAC_1_SQRT_2;
        let t_rig_lidar = Iso::from_parts([0.0; 3], [0.0, 0.0, half, half]).expect("a rotation");
        let roi = RegionOfInterest { center: Point::new(0.0, 3.0, 0.0), radius_m: 0.5 };
        assert_eq!(Sector::new(&roi, &t_rig_lidar).offset(0), 0);
    }
}

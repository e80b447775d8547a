//! From a distance count to a point, and from a ray to the count it would give.
//!
//! Sensor axes of the manual: X right, Y forward, Z up; azimuth a clockwise from +Y, elevation v. With the laser's
//! rotation taken from the encoder's azimuth (a = azimuth − rotation) and d = count × 2 mm:
//!
//! ```text
//!   X = (d + Dx) cos v sin a − h cos a      Dx = DX + (D − DX) (|(d + D) cos v sin a| − 2.40) / (25.04 − 2.40)
//!   Y = (d + Dy) cos v cos a + h sin a      Dy = DY + (D − DY) (|(d + D) cos v cos a| − 1.93) / (25.04 − 1.93)
//!   Z = (d + Dz) sin v + vertical offset    Dz = (Dx + Dy) / 2
//! ```
//!
//! Dx = Dy = D from d = 25.04 m on, and for lasers without near points. Source: HDL-64E S3 manual, "Two point
//! calibration"; 25.04, 2.40 and 1.93 m are where Velodyne measures. The lidar frame is x = Y, y = −X, z = Z.

use super::calibration::{Calibration, LASERS, LaserCalibration};

/// The far calibration point, metres. The comparison is with the uncorrected distance.
const FAR_M: f64 = 25.04;
/// The near point of X, metres.
const NEAR_X_M: f64 = 2.40;
/// The near point of Y, metres.
const NEAR_Y_M: f64 = 1.93;
/// How much of Dx (the rest: of Dy) goes into the height. The manual takes Dy alone (0), which makes the height of a
/// flat floor depend on the direction; the mean is symmetric and is what VeloView shows.
const DX_IN_HEIGHT: f64 = 0.5;

/// A laser, ready to place points.
#[derive(Clone, Copy, Debug)]
struct Beam {
    sin_rotation: f64,
    cos_rotation: f64,
    sin_vertical: f64,
    cos_vertical: f64,
    far_m: f64,
    /// Dx at |X| = 0 and its change per metre of |X|.
    near_x: (f64, f64),
    near_y: (f64, f64),
    horizontal_m: f64,
    vertical_m: f64,
}

impl Beam {
    fn new(laser: &LaserCalibration) -> Self {
        let (sin_rotation, cos_rotation) = libm::sincos(laser.rotation_rad);
        let (sin_vertical, cos_vertical) = libm::sincos(laser.vertical_rad);
        let far_m = laser.distance_m;
        let line = |near_m: f64, at_m: f64| {
            let slope = if laser.two_point() { (far_m - near_m) / (FAR_M - at_m) } else { 0.0 };
            (if laser.two_point() { near_m - slope * at_m } else { far_m }, slope)
        };
        Self {
            sin_rotation,
            cos_rotation,
            sin_vertical,
            cos_vertical,
            far_m,
            near_x: line(laser.distance_x_m, NEAR_X_M),
            near_y: line(laser.distance_y_m, NEAR_Y_M),
            horizontal_m: laser.horizontal_offset_m,
            vertical_m: laser.vertical_offset_m,
        }
    }

    /// Sine and cosine of the beam's own azimuth.
    #[inline]
    fn azimuth(&self, (sin, cos): (f64, f64)) -> (f64, f64) {
        (sin * self.cos_rotation - cos * self.sin_rotation, cos * self.cos_rotation + sin * self.sin_rotation)
    }
}

/// Where a return came from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// Lidar frame, metres.
    pub xyz: [f64; 3],
    /// Distance from the beam's own origin along the beam, metres.
    pub range_m: f64,
}

/// A beam in space, lidar frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where the beam leaves, metres.
    pub origin: [f64; 3],
    /// Unit vector.
    pub direction: [f64; 3],
}

/// The 64 beams of a calibrated sensor; nothing here depends on time.
#[derive(Clone, Debug)]
pub struct Beams {
    beams: [Beam; LASERS],
    unit_m: f64,
}

impl Beams {
    /// Everything of the calibration that a point needs, computed once.
    pub fn new(calibration: &Calibration) -> Self {
        Self { beams: calibration.lasers().each_ref().map(Beam::new), unit_m: calibration.distance_unit_m() }
    }

    /// The point of a distance count. `head` is the sine and cosine of the head's azimuth when the laser fired.
    /// `None` for a laser there is none of.
    #[inline]
    pub fn place(&self, laser: u8, head: (f64, f64), raw: u16) -> Option<Placed> {
        let beam = self.beams.get(usize::from(laser))?;
        let (sin, cos) = beam.azimuth(head);
        let d = f64::from(raw) * self.unit_m;
        let (dx, dy) = if d < FAR_M {
            let horizontal = (d + beam.far_m) * beam.cos_vertical;
            (
                beam.near_x.0 + beam.near_x.1 * (horizontal * sin).abs(),
                beam.near_y.0 + beam.near_y.1 * (horizontal * cos).abs(),
            )
        } else {
            (beam.far_m, beam.far_m)
        };
        let dz = DX_IN_HEIGHT * dx + (1.0 - DX_IN_HEIGHT) * dy;
        let right = (d + dx) * beam.cos_vertical * sin - beam.horizontal_m * cos;
        let forward = (d + dy) * beam.cos_vertical * cos + beam.horizontal_m * sin;
        let up = (d + dz) * beam.sin_vertical + beam.vertical_m;
        let (wx, wy) = beam.weights(sin, cos);
        Some(Placed { xyz: [forward, -right, up], range_m: d + wx * dx + wy * dy })
    }

    /// The ray a laser looks along while the head is at `head_azimuth_rad` (clockwise from above, radians).
    pub fn ray(&self, laser: u8, head_azimuth_rad: f64) -> Option<Ray> {
        let beam = self.beams.get(usize::from(laser))?;
        let (sin, cos) = beam.azimuth(libm::sincos(head_azimuth_rad));
        Some(Ray {
            origin: [beam.horizontal_m * sin, beam.horizontal_m * cos, beam.vertical_m],
            direction: [beam.cos_vertical * cos, -beam.cos_vertical * sin, beam.sin_vertical],
        })
    }

    /// The count that [`Beams::place`] turns into `range_m` along the [`Beams::ray`], to half a count.
    ///
    /// `None` when no count does (below the laser's distance correction, beyond 131 m). Where the two-point line ends,
    /// at 25.04 m, the sensor's formula jumps by millimetres; ranges inside the jump get the count next to it. The point
    /// of a two-point laser lies off its ray by up to half of Dx − Dy (millimetres), as the real sensor's does.
    pub fn raw(&self, laser: u8, head_azimuth_rad: f64, range_m: f64) -> Option<u16> {
        if range_m.is_nan() {
            return None;
        }
        let beam = self.beams.get(usize::from(laser))?;
        let (sin, cos) = beam.azimuth(libm::sincos(head_azimuth_rad));
        let (wx, wy) = beam.weights(sin, cos);
        // range = d + wx Dx + wy Dy with Dx = p + q |(d + D) cos v sin a| is linear in d below 25.04 m.
        let (qx, qy) = (beam.near_x.1 * beam.cos_vertical * sin.abs(), beam.near_y.1 * beam.cos_vertical * cos.abs());
        let at_minus_far = wx * beam.near_x.0 + wy * beam.near_y.0;
        let slope = wx * qx + wy * qy;
        let near = (range_m - at_minus_far - slope * beam.far_m) / (1.0 + slope);
        let d = if near < FAR_M { near } else { (range_m - beam.far_m).max(FAR_M) };
        let count = libm::round(d / self.unit_m);
        let fits = (1.0..=f64::from(u16::MAX)).contains(&count);
        fits.then_some(count as u16)
    }
}

impl Beam {
    /// How much of Dx and Dy lies along the beam: they act on X, Y and Z by the beam's direction cosines, squared.
    #[inline]
    fn weights(&self, sin: f64, cos: f64) -> (f64, f64) {
        let (level, height) = (self.cos_vertical * self.cos_vertical, self.sin_vertical * self.sin_vertical);
        (level * sin * sin + DX_IN_HEIGHT * height, level * cos * cos + (1.0 - DX_IN_HEIGHT) * height)
    }
}

/// The intensity of a laser as a function of distance: a beam out of focus is dimmer than its target deserves.
///
/// corrected = I + 256 · slope · |(1 − f / 131 m)² − (1 − count / 65535)²|, then held between minimum and maximum
/// (S2 and S3 manuals; 131 m = 65535 counts of 2 mm, so both terms are the same quadratic of distance).
#[derive(Clone, Copy, Debug)]
pub struct Brightness {
    gain: f64,
    focus: f64,
    min: f64,
    max: f64,
}

impl Brightness {
    /// The correction of a laser.
    pub fn new(laser: &LaserCalibration) -> Self {
        let defocus = 1.0 - laser.focal_distance_m / 131.0;
        Self {
            gain: 256.0 * laser.focal_slope,
            focus: defocus * defocus,
            min: f64::from(laser.min_intensity),
            max: f64::from(laser.max_intensity),
        }
    }

    /// The corrected intensity, 0..=255, of a return at `raw` counts.
    #[inline]
    pub fn correct(&self, intensity: u8, raw: u16) -> u8 {
        let far = 1.0 - f64::from(raw) / 65535.0;
        let corrected = f64::from(intensity) + self.gain * (self.focus - far * far).abs();
        // Minimum ≤ maximum is the calibration's promise; both lie in 0..=255, so adding a half rounds.
        (corrected.max(self.min).min(self.max) + 0.5) as u8
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn beams(laser: LaserCalibration) -> Beams {
        Beams::new(&Calibration::new([laser; LASERS]).expect("plausible"))
    }

    fn close(found: [f64; 3], expected: [f64; 3]) {
        for (f, e) in found.into_iter().zip(expected) {
            assert!((f - e).abs() < 1e-9, "{found:?} {expected:?}");
        }
    }

    #[test]
    fn an_ideal_beam_goes_where_the_head_points() {
        let beams = beams(LaserCalibration::default());
        // 5000 counts = 10 m. Forward is x; a quarter turn clockwise is right, −y.
        close(beams.place(0, (0.0, 1.0), 5000).expect("laser 0").xyz, [10.0, 0.0, 0.0]);
        close(beams.place(63, (1.0, 0.0), 5000).expect("laser 63").xyz, [0.0, -10.0, 0.0]);
        assert!(beams.place(64, (0.0, 1.0), 5000).is_none());
    }

    #[test]
    fn two_point_correction_by_hand() {
        // v = 30°, rotation −90° so that a = 90° + 0°: the head looks forward, the beam right (sin a = 1, cos a = 0).
        let beams = beams(LaserCalibration {
            rotation_rad: -0.5,
            vertical_rad: 0.5,
            distance_m: 1.0,
            distance_x_m: 1.2,
            distance_y_m: 1.1,
            horizontal_offset_m: 0.026,
            vertical_offset_m: 0.2,
            ..LaserCalibration::default()
        });
        let head = libm::sincos(core::f64::consts::FRAC_PI_2 - 0.5);
        let placed = beams.place(0, head, 5000).expect("laser 0");
        // cos 0.5 = 0.8775825618904, sin 0.5 = 0.4794255386042. xx = 11 · 0.87758 = 9.653408180794, yy = 0.
        // Dx = 1.2 − 0.2 · (9.653408180794 − 2.40) / 22.64 = 1.135923956000
        // Dy = 1.1 − 0.1 · (0 − 1.93) / 23.11              = 1.108351363046
        // X = 11.135923956 · 0.87758256 = 9.772692674, Y = h = 0.026, Dz = 1.122137659523
        // Z = 11.122137659523 · 0.47942554 + 0.2 = 5.532236838; lidar x = Y, y = −X.
        let [x, y, z] = placed.xyz;
        assert!(
            (x - 0.026).abs() < 1e-9 && (y + 9.772_692_674).abs() < 2e-8 && (z - 5.532_236_838).abs() < 2e-8,
            "{placed:?}"
        );
        // Along the beam: cos² 0.5 · Dx + sin² 0.5 · Dz = 0.770151153 · 1.135923956 + 0.229848847 · 1.122137660
        assert!((placed.range_m - 11.132_755_202).abs() < 2e-8, "{placed:?}");
        // From 25.04 m (12 520 counts) on, D alone: 26.04 · cos 0.5.
        let far = beams.place(0, head, 12_520).expect("laser 0");
        assert!((far.xyz[1] + 26.04 * 0.877_582_561_890).abs() < 1e-9, "{far:?}");
    }

    #[test]
    fn intensity_correction_by_hand() {
        let laser = |focal_distance_m: f64, focal_slope: f64, min_intensity: u8, max_intensity: u8| {
            Brightness::new(&LaserCalibration {
                focal_distance_m,
                focal_slope,
                min_intensity,
                max_intensity,
                ..LaserCalibration::default()
            })
        };
        // In focus at 65.5 m = half: (1 − 0.5)² = 0.25; at 0 counts 1: 256 · 0.1 · 0.75 = 19.2.
        assert_eq!(laser(65.5, 0.1, 0, 255).correct(100, 0), 119);
        // At 32 767 counts (65.5 m) the terms agree to 1e-5: nothing.
        assert_eq!(laser(65.5, 0.1, 0, 255).correct(100, 32_767), 100);
        assert_eq!((laser(65.5, 0.1, 0, 110).correct(100, 0), laser(65.5, -1.0, 40, 255).correct(100, 0)), (110, 40));
    }

    proptest! {
        #[test]
        fn counts_and_ranges_are_inverse_along_the_ray(
            laser in 0u8..64, azimuth in 0.0f64..7.0, raw in 300u16..60_000,
            rotation_rad in -0.2f64..0.2, vertical_rad in -0.44f64..0.05,
            distance_m in 0.8f64..1.5, near_x in -0.1f64..0.1, near_y in -0.1f64..0.1,
        ) {
            let beams = beams(LaserCalibration {
                rotation_rad, vertical_rad, distance_m,
                distance_x_m: distance_m + near_x, distance_y_m: distance_m + near_y,
                horizontal_offset_m: -0.026, vertical_offset_m: 0.2,
                ..LaserCalibration::default()
            });
            let placed = beams.place(laser, libm::sincos(azimuth), raw).expect("64 lasers");
            // Within the jump at 25.04 m (at most 0.1 m · 2 = 100 counts here) two counts share a range.
            if !(12_420..12_620).contains(&raw) {
                prop_assert_eq!(beams.raw(laser, azimuth, placed.range_m), Some(raw));
            }
            let ray = beams.ray(laser, azimuth).expect("64 lasers");
            let mut along = 0.0;
            let mut off = 0.0;
            for ((p, o), u) in placed.xyz.into_iter().zip(ray.origin).zip(ray.direction) {
                along += (p - o) * u;
                off += (p - o - placed.range_m * u) * (p - o - placed.range_m * u);
            }
            prop_assert!((along - placed.range_m).abs() < 1e-9);
            // |Dx − Dy| ≤ 0.2 m plus its extrapolation below 2.4 m; half of it at most is across.
            prop_assert!(off.sqrt() < 0.13, "{}", off.sqrt());
        }

        #[test]
        fn a_count_beyond_the_field_is_none(range in 133.0f64..1e9) {
            let beams = beams(LaserCalibration::default());
            prop_assert_eq!(beams.raw(0, 0.0, range), None);
            prop_assert_eq!(beams.raw(0, 0.0, -range), None);
            prop_assert_eq!(beams.raw(0, 0.0, f64::NAN), None);
        }
    }
}

//! A sensor's points in the rig's frame.

use crate::config::RegionOfInterest;
use crate::epoch::RigCloud;
use crate::workers::Workers;
use tumbled_model::{Frame, Iso, Rig};

/// Where a sensor is, ready to be applied to columns of points.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Placement {
    /// Rows of the rotation, and the translation in m.
    rows: [[f64; 3]; 3],
    translation: [f64; 3],
    center: [f64; 3],
    radius_squared: f64,
}

impl Placement {
    pub(crate) fn new<F: Frame>(t_rig_sensor: &Iso<Rig, F>, roi: &RegionOfInterest) -> Self {
        let rotation = t_rig_sensor.isometry.rotation.to_rotation_matrix();
        let matrix = rotation.matrix();
        let row = |r: usize| [matrix[(r, 0)], matrix[(r, 1)], matrix[(r, 2)]];
        let vector = t_rig_sensor.isometry.translation.vector;
        Self {
            rows: [row(0), row(1), row(2)],
            translation: [vector.x, vector.y, vector.z],
            center: [roi.center.coords.x, roi.center.coords.y, roi.center.coords.z],
            radius_squared: roi.radius_m * roi.radius_m,
        }
    }

    /// Fills `cloud` with the points, in their order.
    pub(crate) fn apply(&self, points: [&[f32]; 3], cloud: &mut RigCloud, workers: &Workers) {
        let len = points.iter().map(|column| column.len()).min().unwrap_or_default();
        for column in [&mut cloud.x, &mut cloud.y, &mut cloud.z] {
            column.resize(len, 0.0);
        }
        cloud.in_roi.resize(len, false);
        let to = [cloud.x.as_mut_slice(), cloud.y.as_mut_slice(), cloud.z.as_mut_slice()];
        workers.map_columns(points, to, &mut cloud.in_roi, |from, to, flags| self.place(from, to, flags));
    }

    fn place(&self, [x, y, z]: [&[f32]; 3], [to_x, to_y, to_z]: [&mut [f32]; 3], in_roi: &mut [bool]) {
        let [row_x, row_y, row_z] = self.rows;
        let [tx, ty, tz] = self.translation;
        let [cx, cy, cz] = self.center;
        let on = |row: [f64; 3], [x, y, z]: [f64; 3], t: f64| row[0] * x + row[1] * y + row[2] * z + t;
        let to = to_x.iter_mut().zip(to_y).zip(to_z).zip(in_roi);
        for ((((to_x, to_y), to_z), inside), ((&x, &y), &z)) in to.zip(x.iter().zip(y).zip(z)) {
            let point = [f64::from(x), f64::from(y), f64::from(z)];
            let placed = [on(row_x, point, tx), on(row_y, point, ty), on(row_z, point, tz)];
            let [px, py, pz] = placed;
            let (dx, dy, dz) = (px - cx, py - cy, pz - cz);
            *inside = dx * dx + dy * dy + dz * dz <= self.radius_squared;
            (*to_x, *to_y, *to_z) = (px as f32, py as f32, pz as f32);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use tumbled_model::{Kinect, Point};

    fn default_mounting() -> Placement {
        let t = Iso::<Rig, Kinect>::from_parts([0.0, 0.3, 0.0], [-0.5, 0.5, -0.5, 0.5]).expect("unit");
        Placement::new(&t, &RegionOfInterest { center: Point::new(2.0, 0.0, 0.0), radius_m: 0.5 })
    }

    #[test]
    fn a_kinect_point_lands_where_the_mounting_says() {
        // Right 0.1, down 0.2, forward 2 m; the camera looks along the rig's x from 0.3 m left: (2, 0.2, -0.2).
        let mut cloud = RigCloud::default();
        default_mounting().apply([&[0.1, 0.1], &[0.2, 0.2], &[2.0, 3.0]], &mut cloud, &Workers::none());
        assert!((cloud.x[0] - 2.0).abs() < 1e-6 && (cloud.y[0] - 0.2).abs() < 1e-6 && (cloud.z[0] + 0.2).abs() < 1e-6);
        // 0.28 m from the centre; 1.04 m for the one farther back.
        assert_eq!(cloud.in_roi, [true, false]);
    }

    #[test]
    fn any_number_of_threads_gives_the_same_bits() {
        let column = |scale: f32| (0..100_001).map(|n| (n as f32 * scale) % 3.0).collect::<Vec<f32>>();
        let (x, y, z) = (column(0.317), column(0.871), column(0.123));
        let clouds: Vec<_> = [0, 1, 2, 3]
            .into_iter()
            .map(|threads| {
                let pool = || rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
                let workers = if threads == 0 { Workers::none() } else { Workers::pool(Arc::new(pool())) };
                let mut cloud = RigCloud::default();
                default_mounting().apply([&x, &y, &z], &mut cloud, &workers);
                cloud
            })
            .collect();
        assert!(clouds.iter().all(|cloud| *cloud == clouds[0]) && clouds[0].len() == 100_001);
    }
}

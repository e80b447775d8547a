//! Rigid transforms whose frames the compiler checks.
//!
//! `Iso<A, B>` takes coordinates in `B` to coordinates in `A`; it is named `t_a_b` wherever it is a variable.
//!
//! ```
//! use tumbled_model::{Iso, Lidar, Point, Rig};
//! let t_rig_lidar = Iso::<Rig, Lidar>::identity();
//! let p: Point<Rig> = t_rig_lidar * Point::<Lidar>::new(1.0, 0.0, 0.0);
//! ```
//! ```compile_fail
//! use tumbled_model::{Iso, Kinect, Lidar, Point, Rig};
//! let t_rig_lidar = Iso::<Rig, Lidar>::identity();
//! let p = t_rig_lidar * Point::<Kinect>::new(1.0, 0.0, 0.0); // a Kinect point through the LiDAR's mounting
//! ```
//! ```compile_fail
//! use tumbled_model::{Iso, Kinect, Lidar, Rig};
//! let wrong = Iso::<Rig, Lidar>::identity() * Iso::<Rig, Kinect>::identity(); // the inner frames differ
//! ```

use core::marker::PhantomData;
use core::ops::Mul;
use nalgebra::{Isometry3, Point3, Quaternion, Translation3, UnitQuaternion};

/// A coordinate frame; implemented by zero-sized markers only.
pub trait Frame: Copy + 'static {
    /// The name people and files use.
    const NAME: &'static str;
}

macro_rules! frame {
    ($(#[$doc:meta])* $name:ident, $text:literal) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub struct $name;
        impl Frame for $name {
            const NAME: &'static str = $text;
        }
    };
}

frame!(
    /// The rig's fixed frame. The LiDAR's own frame unless the config says otherwise.
    Rig, "rig"
);
frame!(
    /// A LiDAR: x forward at azimuth 0 (the side opposite the cable), y left, z up. Metres.
    Lidar, "lidar"
);
frame!(
    /// A Kinect's depth camera: x right, y down, z forward; pixel centres at integer u, v. Metres.
    Kinect, "kinect"
);
frame!(
    /// The turntable: z is its axis.
    Stage, "stage"
);
frame!(
    /// The target's body frame, fixed at acquisition.
    Target, "target"
);

/// A point with the frame its coordinates are in. Metres.
#[derive(Debug, PartialEq)]
pub struct Point<F: Frame> {
    /// Coordinates in frame `F`, metres.
    pub coords: Point3<f64>,
    frame: PhantomData<F>,
}

impl<F: Frame> Clone for Point<F> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<F: Frame> Copy for Point<F> {}

impl<F: Frame> Point<F> {
    /// A point from its coordinates in frame `F`, metres.
    pub const fn new(x: f64, y: f64, z: f64) -> Self {
        Self { coords: Point3::new(x, y, z), frame: PhantomData }
    }
}

/// A rigid transform: coordinates in `From` → coordinates in `To`.
#[derive(Debug, PartialEq)]
pub struct Iso<To: Frame, From: Frame> {
    /// Rotation and translation (metres).
    pub isometry: Isometry3<f64>,
    frames: PhantomData<(To, From)>,
}

impl<To: Frame, From: Frame> Clone for Iso<To, From> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<To: Frame, From: Frame> Copy for Iso<To, From> {}

/// A rotation that is not one.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("a rotation quaternion has length 1, this one has {norm}: the order is [x, y, z, w]")]
pub struct UnitQuaternionError {
    /// The length found.
    pub norm: f64,
}

impl<To: Frame, From: Frame> Iso<To, From> {
    /// The transform that changes nothing but the name of the frame.
    pub fn identity() -> Self {
        Self { isometry: Isometry3::identity(), frames: PhantomData }
    }

    /// From a translation in metres and a quaternion in the order x, y, z, w.
    ///
    /// # Errors
    /// When the quaternion's length differs from 1 by more than 1e-6; within that it is normalised.
    pub fn from_parts(translation_m: [f64; 3], rotation_xyzw: [f64; 4]) -> Result<Self, UnitQuaternionError> {
        let [x, y, z, w] = rotation_xyzw;
        let quaternion = Quaternion::new(w, x, y, z);
        let norm = quaternion.norm();
        let unit = (norm - 1.0).abs() <= 1e-6; // false for NaN
        if !unit {
            return Err(UnitQuaternionError { norm });
        }
        let translation = Translation3::new(translation_m[0], translation_m[1], translation_m[2]);
        let rotation = UnitQuaternion::new_normalize(quaternion);
        Ok(Self { isometry: Isometry3::from_parts(translation, rotation), frames: PhantomData })
    }

    /// The transform the other way.
    pub fn inverse(self) -> Iso<From, To> {
        Iso { isometry: self.isometry.inverse(), frames: PhantomData }
    }
}

impl<A: Frame, B: Frame, C: Frame> Mul<Iso<B, C>> for Iso<A, B> {
    type Output = Iso<A, C>;
    fn mul(self, inner: Iso<B, C>) -> Iso<A, C> {
        Iso { isometry: self.isometry * inner.isometry, frames: PhantomData }
    }
}

impl<A: Frame, B: Frame> Mul<Point<B>> for Iso<A, B> {
    type Output = Point<A>;
    fn mul(self, point: Point<B>) -> Point<A> {
        Point { coords: self.isometry * point.coords, frame: PhantomData }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn default_kinect_mounting_looks_along_the_rigs_x() {
        // config/rig.toml: rotation_xyzw = [-0.5, 0.5, -0.5, 0.5] turns (right, down, forward) into (−y, −z, +x).
        let t = Iso::<Rig, Kinect>::from_parts([0.0, 0.3, 0.0], [-0.5, 0.5, -0.5, 0.5]).expect("unit");
        let p = t * Point::<Kinect>::new(0.1, 0.2, 2.0);
        let expected = Point3::new(2.0, 0.3 - 0.1, -0.2);
        assert!((p.coords - expected).norm() < 1e-12, "{p:?}");
        let back = t.inverse() * p;
        assert!((back.coords - Point3::new(0.1, 0.2, 2.0)).norm() < 1e-12);
    }

    #[test]
    fn quaternions_off_unit_length_are_refused() {
        let error = Iso::<Rig, Lidar>::from_parts([0.0; 3], [0.0, 0.0, 0.0, 1.1]).expect_err("1.1 is not 1");
        assert_eq!(error.norm, 1.1);
        assert!(Iso::<Rig, Lidar>::from_parts([0.0; 3], [f64::NAN, 0.0, 0.0, 1.0]).is_err());
    }
}

//! What the ends of a plane are drawn by: the last points that each camera frame saw of it.
//!
//! A frame's points are means over voxels that lie otherwise in every frame, so that the outermost of many frames tell an edge
//! far closer than the spacing; fused points are one for each bit of surface, and their outermost are off by up to a spacing.

use super::fuse::steady;
use super::plane::FoundPlane;
use super::{OTHER_STRUCTURE, ReconSettings, Reconstruction, RegisteredFrame, SAME_FACING};
use crate::register::SensorKind;
use nalgebra::{Point2, Vector2};

/// A plane's points, in its coordinates.
pub(super) struct Rim {
    /// The fused ones, and the widest angle between their sights, rad.
    pub(super) fused: Vec<(Point2<f64>, f64)>,
    /// What cameras' frames saw of it, with the frame's number; frame by frame.
    sightings: Vec<(Point2<f64>, u32)>,
}

/// A strip along a side of an outline: places have a way along it and one out of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Strip {
    pub(super) from: Point2<f64>,
    pub(super) along: Vector2<f64>,
    pub(super) out: Vector2<f64>,
    pub(super) length: f64,
    /// How far it reaches inside and outside, m.
    pub(super) reach: (f64, f64),
    /// It is cut across into stretches of this, m.
    pub(super) stretch: f64,
}

impl Strip {
    /// How far along and how far out a place is; `None`: it is beside the strip.
    pub(super) fn within(&self, place: &Point2<f64>) -> Option<(f64, f64)> {
        let offset = place - self.from;
        let (at, off) = (offset.dot(&self.along), offset.dot(&self.out));
        ((0.0..=self.length).contains(&at) && (-self.reach.0..=self.reach.1).contains(&off)).then_some((at, off))
    }

    fn stretches(&self) -> usize {
        (self.length / self.stretch) as usize + 1
    }

    /// Of places with something each, the outermost in every stretch: how far along and out it is.
    pub(super) fn outermost<T: Copy>(&self, places: impl Iterator<Item = (Point2<f64>, T)>) -> Vec<(f64, f64, T)> {
        let mut found: Vec<Option<(f64, f64, T)>> = vec![None; self.stretches()];
        for (place, with) in places {
            let Some((at, off)) = self.within(&place) else { continue };
            if let Some(held) = found.get_mut((at / self.stretch) as usize)
                && held.is_none_or(|(_, most, _)| off > most)
            {
                *held = Some((at, off, with));
            }
        }
        found.into_iter().flatten().collect()
    }
}

impl Rim {
    /// Of a plane: its fused points, and what frames have within three σ of it, facing as it does.
    pub(super) fn of(
        made: &Reconstruction,
        plane: &FoundPlane,
        frames: &[RegisteredFrame],
        settings: &ReconSettings,
    ) -> Self {
        let steady = steady(&made.points, &plane.members);
        let fused = steady.map(|point| (plane.in_plane(&point.place), point.views_rad)).collect();
        let cameras = frames.iter().zip(0u32..).filter(|(frame, _)| frame.kind == SensorKind::Kinect);
        let sightings = cameras.flat_map(|(frame, number)| {
            let of_plane = frame.points.iter().filter(|point| {
                let reach = OTHER_STRUCTURE * libm::hypot(point.sigma_m, settings.slow_sigma_m);
                plane.height(&point.place).abs() <= reach && plane.normal.dot(&point.normal) > SAME_FACING
            });
            of_plane.map(move |point| (plane.in_plane(&point.place), number))
        });
        Self { fused, sightings: sightings.collect() }
    }

    /// The outermost sighting of every frame in every stretch of a strip: how far along and out it is.
    pub(super) fn last_seen(&self, strip: &Strip) -> Vec<(f64, f64)> {
        let of_frames = self.sightings.chunk_by(|(_, a), (_, b)| a == b);
        let last = of_frames.flat_map(|sightings| strip.outermost(sightings.iter().copied()));
        last.map(|(at, off, _)| (at, off)).collect()
    }
}

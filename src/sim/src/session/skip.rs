//! Leaving out what a live session came too late for.

use super::{FRAME_NS, Simulation};
use tumbled_model::{RigNs, Span};

impl Simulation {
    /// Everything that is sent before this instant has been made, or left out.
    pub fn made(&self) -> RigNs {
        self.made
    }

    /// Leaves out what is sent before `until` and has not been made. To those who listen it is as if it had been lost on
    /// the way: what follows is what it would have been. The host of a stage was away and asks it anew.
    pub fn skip_to(&mut self, until: RigNs) {
        let until = until.min(RigNs(self.scene.duration().0));
        for (lidar, packets) in self.scene.lidars.iter().zip(&mut self.packets) {
            let first = lidar.model.first_packet_at(until).max(packets.next);
            packets.line.skip(first - packets.next);
            packets.next = first;
        }
        for (lidar, positions) in self.scene.lidars.iter().zip(&mut self.positions) {
            while lidar.model.position(positions.next).is_some_and(|position| position.t < until) {
                positions.line.skip(1);
                positions.next += 1;
            }
        }
        for (kinect, frames) in self.scene.kinects.iter().zip(&mut self.frames) {
            // Frame n is half a period after the n-th period's start, as the oscillator counts.
            let before = kinect.clock.oscillator_ns(until) - FRAME_NS / 2;
            let mut first = frames.next.max(u64::try_from(before.div_euclid(FRAME_NS)).unwrap_or(0));
            while kinect.clock.instant((first as i64).saturating_mul(FRAME_NS) + FRAME_NS / 2) < until {
                first += 1;
            }
            frames.line.skip(first - frames.next);
            frames.next = first;
        }
        if let Some(serial) = &mut self.serial {
            serial.resume(until);
        }
        self.made = self.made.max(until);
    }

    /// The stretch that is made at once.
    pub const STRETCH: Span = super::STRETCH;
}

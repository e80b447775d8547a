//! From packets to frames.
//!
//! The library tells of each packet it accepts: which place of the frame it has, and its payload. Then, for a frame that it
//! takes for whole (up to five packets may be missing), it calls the frame callback. Two things make this more than a copy:
//!
//! * The packets that are missing show only in the numbers that never came.
//! * When the *last* packets of a frame are missing, the library notices at the first packet of the next one, and tells of
//!   **that packet first**, of the finished frame after it. So a number that does not rise begins the next frame in the
//!   other buffer, and the frame callback that follows at once is for the one before. A frame that the library gave up
//!   (more than five missing) gets no callback: the next packet takes its buffer.

use crate::frame::PACKED_BYTES;
use tumbled_model::PacketMask;

/// Payload of a depth packet, bytes; the last of a frame has the rest.
const PACKET_PAYLOAD: usize = 1_748;
const PACKETS: usize = PacketMask::PACKETS;
/// What stands where nothing arrived: eleven ones are "no data".
const NO_DATA: u8 = 0xFF;

/// Two frames in the making: one that fills, one that may be waiting for its callback.
#[derive(Debug)]
pub(crate) struct Assembler {
    filling: Slot,
    other: Slot,
    /// `other` is the frame before `filling`, whose callback is due before the next packet.
    other_waits: bool,
}

#[derive(Debug)]
struct Slot {
    bytes: Box<[u8]>,
    arrived: Box<[bool; PACKETS]>,
    /// The highest place told of so far; `None` in a frame without packets.
    last: Option<usize>,
}

impl Slot {
    fn new() -> Self {
        Self { bytes: vec![NO_DATA; PACKED_BYTES].into(), arrived: Box::new([false; PACKETS]), last: None }
    }

    fn clear(&mut self) {
        self.arrived.fill(false);
        self.last = None;
    }

    fn take(&mut self, place: usize, payload: &[u8]) {
        self.last = Some(place);
        let start = place * PACKET_PAYLOAD;
        let end = (start + PACKET_PAYLOAD).min(PACKED_BYTES);
        let Some(room) = self.bytes.get_mut(start..end) else { return };
        // A packet cut short has no place for the missing bytes: which ones they are is not known.
        if room.len() == payload.len() {
            room.copy_from_slice(payload);
            if let Some(arrived) = self.arrived.get_mut(place) {
                *arrived = true;
            }
        }
    }

    /// The lost packets, their places overwritten.
    fn close(&mut self) -> PacketMask {
        let mut lost = PacketMask::NONE;
        for place in (0..PACKETS).filter(|&place| !self.arrived.get(place).copied().unwrap_or(false)) {
            lost.mark_lost(place);
            let start = place * PACKET_PAYLOAD;
            if let Some(hole) = self.bytes.get_mut(start..(start + PACKET_PAYLOAD).min(PACKED_BYTES)) {
                hole.fill(NO_DATA);
            }
        }
        lost
    }
}

impl Assembler {
    pub(crate) fn new() -> Self {
        Self { filling: Slot::new(), other: Slot::new(), other_waits: false }
    }

    /// A packet that was accepted at `place`; places past the frame's end are none.
    pub(crate) fn packet(&mut self, place: usize, payload: &[u8]) {
        if place >= PACKETS {
            return;
        }
        if self.filling.last.is_some_and(|last| place <= last) {
            std::mem::swap(&mut self.filling, &mut self.other);
            self.filling.clear();
            self.other_waits = true;
        } else {
            // Its callback would have come before this packet: it was given up.
            self.other_waits = false;
        }
        self.filling.take(place, payload);
    }

    /// The library has finished a frame: which packets it lacks, and its bytes. `None` when no packet of it was told of.
    pub(crate) fn frame(&mut self) -> Option<(PacketMask, &[u8])> {
        if !self.other_waits {
            self.filling.last?;
            std::mem::swap(&mut self.filling, &mut self.other);
            self.filling.clear();
        }
        self.other_waits = false;
        let lost = self.other.close();
        Some((lost, &self.other.bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn payload(place: usize, fill: u8) -> Vec<u8> {
        // 241 × 1748 = 421 268; 422 400 - 421 268 = 1132.
        vec![fill; if place == 241 { 1_132 } else { 1_748 }]
    }

    fn send(assembler: &mut Assembler, places: impl IntoIterator<Item = usize>, fill: u8) {
        places.into_iter().for_each(|place| assembler.packet(place, &payload(place, fill)));
    }

    fn lost(assembler: &mut Assembler) -> (Vec<usize>, Vec<u8>) {
        let (lost, bytes) = assembler.frame().expect("a frame");
        (lost.iter().collect(), bytes.to_vec())
    }

    #[test]
    fn a_whole_frame_is_its_packets_in_order() {
        let mut assembler = Assembler::new();
        for place in 0..242 {
            assembler.packet(place, &payload(place, place as u8));
        }
        let (lost, bytes) = lost(&mut assembler);
        assert_eq!((lost.len(), bytes.len()), (0, 422_400));
        assert_eq!((bytes[0], bytes[1_747], bytes[1_748], bytes[421_267], bytes[421_268]), (0, 0, 1, 240, 241));
    }

    #[test]
    fn holes_are_marked_and_never_hold_the_frame_before() {
        let mut assembler = Assembler::new();
        for _ in 0..3 {
            // Both buffers are full of sevens by then.
            send(&mut assembler, 0..242, 7);
            assert_eq!(lost(&mut assembler).0, []);
        }
        send(&mut assembler, (0..242).filter(|place| ![0, 40, 41].contains(place)), 9);
        let (lost, bytes) = lost(&mut assembler);
        assert_eq!(lost, [0, 40, 41]);
        assert!(bytes[..1_748].iter().all(|&byte| byte == 0xFF) && bytes[1_748] == 9);
        assert!(bytes[40 * 1_748..42 * 1_748].iter().all(|&byte| byte == 0xFF) && bytes[42 * 1_748] == 9);
        assert!(!bytes.contains(&7));
    }

    #[test]
    fn a_frame_without_its_end_is_told_of_after_the_first_packet_of_the_next() {
        let mut assembler = Assembler::new();
        send(&mut assembler, 0..239, 1);
        // Lost: 239, 240, 241 of this one and 0 of the next.
        send(&mut assembler, [1], 2);
        let (first, bytes) = lost(&mut assembler);
        assert_eq!(first, [239, 240, 241]);
        assert!(!bytes.contains(&2));
        send(&mut assembler, 2..242, 2);
        assert_eq!(lost(&mut assembler).0, [0]);
    }

    #[test]
    fn a_frame_given_up_leaves_nothing_in_the_next() {
        let mut assembler = Assembler::new();
        send(&mut assembler, 0..100, 1);
        // More than five lost: no callback; the next frame begins at 0.
        send(&mut assembler, 0..242, 2);
        let (lost, bytes) = lost(&mut assembler);
        assert_eq!(lost, []);
        assert!(bytes.iter().all(|&byte| byte == 2));
    }

    #[test]
    fn packets_of_another_length_or_place_are_lost() {
        let mut assembler = Assembler::new();
        send(&mut assembler, 0..242, 1);
        assembler.frame();
        assembler.packet(0, &[3; 100]);
        assembler.packet(1, &[]);
        send(&mut assembler, 2..241, 3);
        assembler.packet(241, &[3; 1_748]);
        assembler.packet(242, &[3; 1_748]);
        assembler.packet(usize::MAX, &[3; 1_748]);
        assert_eq!(lost(&mut assembler).0, [0, 1, 241]);
    }

    #[test]
    fn a_callback_without_packets_is_no_frame() {
        let mut assembler = Assembler::new();
        assert!(assembler.frame().is_none());
        send(&mut assembler, 0..242, 1);
        assert!(assembler.frame().is_some());
        assert!(assembler.frame().is_none());
    }
}

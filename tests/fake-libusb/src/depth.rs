//! What the camera sends: frames cut into packets, 30 times a second.
//!
//! Frame k of a run begins 800 k / 3 slots (33.3 ms) after the run's first; its packets follow each other slot by slot.

use std::io;

use fake_libusb_control::{Corruption, StallEnd};

use crate::chronicle::Chronicle;
use crate::clock::{Nanos, SLOT, from_seconds};
use crate::packet::{self, Chance};
use crate::source::Source;

/// From the start's register to the first frame: 50 ms.
const START_SLOTS: u64 = 400;

/// The depth stream of one camera.
#[derive(Debug)]
pub(crate) struct Depth {
    device: usize,
    source: Source,
    run: Option<Run>,
    sending: Option<Sending>,
    /// The first slot of the first run's first frame.
    first: Option<u64>,
    begun: u64,
    sequence: u8,
    frozen: bool,
    stall: Option<Stall>,
    /// What the next frame's ticks shall be; and what is added to a source's ticks since.
    clock: Option<u32>,
    offset: u32,
    /// What happens to the next frame's packets.
    drop: Vec<u16>,
    corrupt: Vec<(u16, Corruption)>,
    chance: Chance,
    bytes: Vec<u8>,
    payload: Vec<u8>,
    packet: Vec<u8>,
}

/// From start to stop.
#[derive(Debug)]
struct Run {
    first: u64,
    next: u64,
    ten_bits: bool,
}

/// A frame being sent.
#[derive(Debug)]
struct Sending {
    number: u64,
    first: u64,
    ticks: u32,
    packets: u16,
    sent: u16,
    drop: Vec<u16>,
    corrupt: Vec<(u16, Corruption)>,
}

/// Nothing is sent until.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Stall {
    /// This time.
    Time(Nanos),
    /// The host does this, or something stronger.
    Host(Recovery),
}

/// What a host can do about a silent camera, weakest first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Recovery {
    Restart,
    Reopen,
    Reset,
}

/// A packet on the bus.
#[derive(Debug)]
pub(crate) struct Packet<'a> {
    pub(crate) frame: u64,
    pub(crate) index: u16,
    pub(crate) bytes: &'a [u8],
}

impl Depth {
    pub(crate) fn new(device: usize, source: Source) -> Self {
        Self {
            device,
            source,
            run: None,
            sending: None,
            first: None,
            begun: 0,
            sequence: 0,
            frozen: false,
            stall: None,
            clock: None,
            offset: 0,
            drop: Vec::new(),
            corrupt: Vec::new(),
            chance: Chance::new(0.0, 0),
            bytes: Vec::new(),
            payload: Vec::new(),
            packet: Vec::new(),
        }
    }

    pub(crate) fn is_running(&self) -> bool {
        self.run.is_some()
    }

    /// Frames begun, which is the next frame's number.
    pub(crate) fn begun(&self) -> u64 {
        self.begun
    }

    /// Whether there is something to send, now or at the next frame's beginning.
    pub(crate) fn has_work(&mut self) -> bool {
        self.run.is_some() && (self.sending.is_some() || (self.stall.is_none() && self.has_frame()))
    }

    fn has_frame(&mut self) -> bool {
        (self.frozen && !self.bytes.is_empty()) || self.source.is_ready()
    }

    pub(crate) fn start(&mut self, slot: u64, ten_bits: bool, chronicle: &mut Chronicle) {
        self.stop(chronicle);
        self.recover(Recovery::Restart);
        let first = slot + START_SLOTS;
        self.first.get_or_insert(first);
        self.run = Some(Run { first, next: 0, ten_bits });
    }

    /// Stops within the packet: the frame that is being sent is cut.
    pub(crate) fn stop(&mut self, chronicle: &mut Chronicle) {
        if let Some(sending) = self.sending.take() {
            chronicle.end(self.device, sending.number, sending.sent);
        }
        self.run = None;
    }

    pub(crate) fn stall(&mut self, end: StallEnd, now: Nanos) {
        self.stall = Some(match end {
            StallEnd::After(seconds) => Stall::Time(now + from_seconds(seconds)),
            StallEnd::Restart => Stall::Host(Recovery::Restart),
            StallEnd::Reopen => Stall::Host(Recovery::Reopen),
            StallEnd::Reset => Stall::Host(Recovery::Reset),
        });
    }

    /// The host did something that may end a stall.
    pub(crate) fn recover(&mut self, done: Recovery) {
        self.stall = self.stall.filter(|stall| match stall {
            Stall::Time(_) => true,
            Stall::Host(needed) => done < *needed,
        });
    }

    /// The camera was without power.
    pub(crate) fn repower(&mut self) {
        self.stall = None;
        self.sequence = 0;
    }

    pub(crate) fn freeze(&mut self, frozen: bool) {
        self.frozen = frozen;
    }

    pub(crate) fn set_clock(&mut self, ticks: u32) {
        self.clock = Some(ticks);
    }

    pub(crate) fn drop_random(&mut self, probability: f64, seed: u64) {
        self.chance = Chance::new(probability, seed);
    }

    pub(crate) fn drop_next(&mut self, packets: &[u16]) {
        self.drop.extend(packets);
    }

    pub(crate) fn corrupt_next(&mut self, kind: Corruption, packets: &[u16]) {
        self.corrupt.extend(packets.iter().map(|&packet| (packet, kind)));
    }

    /// Whether a frame's beginning falls into this slot and there is a frame to begin.
    pub(crate) fn is_due(&mut self, slot: u64) -> bool {
        let Some(run) = &mut self.run else { return false };
        if slot != run.first + run.next * 800 / 3 {
            return false;
        }
        run.next += 1;
        if let Some(Stall::Time(end)) = self.stall
            && slot * SLOT >= end
        {
            self.stall = None;
        }
        self.stall.is_none() && self.has_frame()
    }

    /// Begins the frame that is due; an error if the source cannot be read.
    pub(crate) fn begin(&mut self, slot: u64, chronicle: &mut Chronicle) -> io::Result<()> {
        let Some(ten_bits) = self.run.as_ref().map(|run| run.ten_bits) else { return Ok(()) };
        let elapsed = ((slot - self.first.unwrap_or(slot)) * 3 + 400) / 800;
        let Some(source_ticks) = self.take(elapsed)? else { return Ok(()) };
        if let Some(ticks) = self.clock.take() {
            self.offset = ticks.wrapping_sub(source_ticks);
        }
        if ten_bits {
            self.payload.clear();
            packet::ten_bit_stream(&self.bytes, &mut self.payload);
        } else {
            self.payload.clone_from(&self.bytes);
        }
        let sending = Sending {
            number: self.begun,
            first: slot,
            ticks: source_ticks.wrapping_add(self.offset),
            packets: packet::count(&self.payload),
            sent: 0,
            drop: std::mem::take(&mut self.drop),
            corrupt: std::mem::take(&mut self.corrupt),
        };
        chronicle.frame(self.device, sending.number, sending.ticks, slot * SLOT, sending.packets);
        self.begun += 1;
        self.sending = Some(sending);
        Ok(())
    }

    /// The next frame's ticks, its bytes being in `bytes`. A frozen camera's clock goes on, its image does not.
    fn take(&mut self, elapsed: u64) -> io::Result<Option<u32>> {
        if !self.frozen || self.bytes.is_empty() {
            return self.source.take(elapsed, &mut self.bytes);
        }
        let mut unseen = Vec::new();
        self.source.take(elapsed, &mut unseen)
    }

    /// The packet that is sent in this slot; `None` if there is none, or it is lost.
    pub(crate) fn packet(&mut self, slot: u64, chronicle: &mut Chronicle) -> Option<Packet<'_>> {
        let sending = self.sending.as_mut()?;
        let (frame, packets, ticks) = (sending.number, sending.packets, sending.ticks);
        let index = u16::try_from(slot - sending.first).ok()?;
        sending.sent = index + 1;
        let lost = sending.drop.contains(&index) | self.chance.strikes();
        let damage = sending.corrupt.iter().find(|(packet, _)| *packet == index).map(|(_, kind)| *kind);
        let sequence = self.sequence;
        // The device counts what it sends, whether it arrives or not.
        self.sequence = sequence.wrapping_add(1);
        packet::write(&mut self.packet, &self.payload, index, sequence, ticks);
        if index + 1 == packets {
            self.sending = None;
        }
        if lost {
            chronicle.lost(self.device, frame, index);
        } else if let Some(kind) = damage {
            packet::corrupt(&mut self.packet, kind);
            chronicle.corrupt(self.device, frame, index, kind);
        }
        if index + 1 == packets {
            chronicle.end(self.device, frame, packets);
        }
        (!lost).then_some(Packet { frame, index, bytes: &self.packet })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use fake_libusb_control::{FrameWriter, Frames};

    /// A camera that was started in slot 0, with a file of one frame of the byte 0xA5.
    fn camera() -> Depth {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("frames");
        let mut writer = FrameWriter::new(std::fs::File::create(&path).expect("creates")).expect("writes");
        writer.write(5, &[0xA5; 422_400]).expect("writes");
        writer.finish().expect("flushes");
        let frames = Frames::File { path, once: false, follow: false };
        let mut depth = Depth::new(0, Source::open(Some(&frames), || ()).expect("opens"));
        depth.start(0, false, &mut Chronicle::default());
        depth
    }

    /// (slot, bytes) of every packet in the slots before `end`.
    fn packets(depth: &mut Depth, end: u64) -> Vec<(u64, Vec<u8>)> {
        let mut chronicle = Chronicle::default();
        let mut sent = Vec::new();
        for slot in 0..end {
            if depth.is_due(slot) {
                depth.begin(slot, &mut chronicle).expect("reads");
            }
            sent.extend(depth.packet(slot, &mut chronicle).map(|packet| (slot, packet.bytes.to_vec())));
        }
        sent
    }

    #[test]
    fn thirty_frames_a_second_in_242_packets_each() {
        // A second is 8000 slots; the first frame begins in slot 400.
        let sent = packets(&mut camera(), 8_400);
        assert_eq!(sent.len(), 30 * 242);
        let first_slots: Vec<u64> = sent.iter().filter(|(_, bytes)| bytes[3] == 0x71).map(|(slot, _)| *slot).collect();
        assert_eq!(first_slots[..5], [400, 666, 933, 1_200, 1_466]); // every 266 2/3
        let lengths: usize = sent[..242].iter().map(|(_, bytes)| bytes.len() - 12).sum();
        assert_eq!((lengths, sent[241].1.len()), (422_400, 12 + 1_132));
        assert_eq!((sent[1].1[3], sent[241].1[3]), (0x72, 0x75));
        // Every packet has the next number modulo 256 and the frame's ticks; 2 000 005 = 0x1E8485.
        assert!(sent.iter().zip(0_u32..).all(|((_, bytes), number)| bytes[5] == number as u8));
        assert_eq!(sent[242].1[8..12], [0x85, 0x84, 0x1E, 0]);
    }

    #[test]
    fn dropped_packets_are_counted_by_the_device_but_do_not_arrive() {
        let mut depth = camera();
        depth.drop_next(&[0, 17]);
        let sent = packets(&mut depth, 700);
        let numbers: Vec<u8> = sent[..17].iter().map(|(_, bytes)| bytes[5]).collect();
        assert_eq!(numbers, [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 18]);
        assert_eq!(sent[240].1[3], 0x71, "the next frame is whole");
    }

    #[test]
    fn a_stall_ends_at_its_time_or_by_what_the_host_does() {
        let mut depth = camera();
        depth.stall(StallEnd::After(0.1), 0); // 800 slots: the frames of 400 and 666 are missing
        assert_eq!(packets(&mut depth, 1_000).first().map(|(slot, _)| *slot), Some(933));
        for (end, helps) in [(StallEnd::Restart, Recovery::Restart), (StallEnd::Reopen, Recovery::Reset)] {
            let mut depth = camera();
            depth.stall(end, 0);
            assert_eq!(packets(&mut depth, 500).len(), 0);
            depth.recover(helps);
            assert_eq!(depth.stall, None);
        }
        let mut depth = camera();
        depth.stall(StallEnd::Reset, 0);
        depth.recover(Recovery::Reopen);
        assert_eq!(depth.stall, Some(Stall::Host(Recovery::Reset)));
    }
}

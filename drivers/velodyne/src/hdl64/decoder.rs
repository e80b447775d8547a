//! The decoder: packets of one HDL-64E in, points out.

use super::calibration::{Calibration, LASERS};
use super::geometry::{Beams, Brightness};
use super::in_stream::{Collector, InStreamError, Unit};
use super::pace::{Pace, Step};
use super::status::{Status, Tail};
use super::timing::Generation;
use crate::points::{LidarPoint, Points, Return};
use crate::wire::{BLOCKS, Bank, Block, DataPacket, SLOTS, TURN_CDEG, WireError};
use core::f64::consts::TAU;

/// Radians of 0.01°.
const RAD_PER_CDEG: f64 = TAU / TURN_CDEG as f64;
/// More than the head turns between two firings: 1 200 rpm for 57.6 µs is 0.41°. A longer way is no rotation but the
/// edge of a field of view, and keeps out of the rate.
const LONGEST_TURN_CDEG: u16 = 100;

/// What a packet was, besides the points appended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hdl64Packet {
    /// The generation it was decoded as.
    pub generation: Generation,
    /// Whether that is known. Between S2 and S3 it takes two packets in a row (or a status type W); until then S2 is
    /// assumed, whose lasers fire up to 48 µs earlier than an S3's at the end of a packet.
    pub settled: bool,
    /// Strongest and last return of each firing.
    pub dual: bool,
    /// Firings in the packet: S1 12 (of 32 lasers), else 6 or, dual, 3 (of 64).
    pub firings: u8,
    /// Points appended.
    pub points: usize,
    /// No calibration is known (yet): nothing was appended.
    pub uncalibrated: bool,
    /// This packet completed the calibration in the stream; its own points are already placed by it.
    pub calibration_completed: bool,
    /// Whether the packet's stamp is a clock. If not, times count back from the packet's arrival.
    pub stamped: bool,
    /// Nominal time from one packet to the next, ns.
    pub period_ns: i32,
    /// Packets lost before this one, by the stamps; 0 when they do not tell.
    pub lost: u16,
    /// Azimuth of the first block, 0.01°.
    pub azimuth_first_cdeg: u16,
    /// Azimuth of the last block, 0.01°.
    pub azimuth_last_cdeg: u16,
    /// Two neighbouring firings are further apart than the head turns.
    pub azimuth_jump: bool,
}

/// Turns the data packets of one HDL-64E into points, and gathers its status and calibration.
///
/// Generation, return mode and clock are recognised packet by packet. Points are placed by the calibration given, else by
/// the one an S2 or S3 sends along, from the packet that completes it (1.2 to 1.5 s after the first).
#[derive(Clone, Debug)]
pub struct Hdl64Decoder {
    calibration: Option<Calibration>,
    optics: Option<Box<Optics>>,
    status: Status,
    pace: Pace,
    collector: Option<Collector>,
    unit: Option<Unit>,
    forced: Option<Generation>,
    generation: Option<Generation>,
    dual: bool,
}

/// All a point needs of the calibration.
#[derive(Clone, Debug)]
struct Optics {
    beams: Beams,
    /// By laser.
    lasers: [Laser; LASERS],
}

#[derive(Clone, Copy, Debug)]
struct Laser {
    id: u8,
    ring: u8,
    enabled: bool,
    rotation_rad: f64,
    brightness: Brightness,
}

impl Optics {
    fn new(calibration: &Calibration) -> Self {
        let mut id = 0u8;
        let mut rings = calibration.rings().iter();
        let lasers = calibration.lasers().each_ref().map(|laser| {
            let this = Laser {
                id,
                ring: rings.next().copied().unwrap_or_default(),
                enabled: laser.enabled,
                rotation_rad: laser.rotation_rad,
                brightness: Brightness::new(laser),
            };
            id += 1;
            this
        });
        Self { beams: Beams::new(calibration), lasers }
    }

    fn bank(&self, bank: Bank) -> &[Laser] {
        let (upper, lower) = self.lasers.split_at(SLOTS);
        match bank {
            Bank::Upper => upper,
            Bank::Lower => lower,
        }
    }
}

/// Where and when a block fires.
#[derive(Clone, Copy)]
struct Firing {
    column: u8,
    at_ns: i32,
    azimuth_rad: f64,
    /// Sine and cosine of the azimuth.
    head: (f64, f64),
}

/// What the head does while the lasers of a block fire, by slot.
#[derive(Clone, Copy)]
struct Turn {
    after_ns: i32,
    angle_rad: f64,
    sin: f64,
    cos: f64,
}

impl Hdl64Decoder {
    /// A decoder with a calibration, or without: then it waits for the one in the stream. An S1 sends none.
    pub fn new(calibration: Option<Calibration>) -> Self {
        Self {
            optics: calibration.as_ref().map(|calibration| Box::new(Optics::new(calibration))),
            collector: calibration.is_none().then(Collector::new),
            calibration,
            status: Status::default(),
            pace: Pace::default(),
            unit: None,
            forced: None,
            generation: None,
            dual: false,
        }
    }

    /// The same, for a sensor whose generation is known.
    #[must_use]
    pub fn with_generation(mut self, generation: Generation) -> Self {
        self.forced = Some(generation);
        self
    }

    /// The generation, once it is known.
    pub fn generation(&self) -> Option<Generation> {
        self.forced.or(self.generation)
    }

    /// What the sensor said of itself so far.
    pub fn status(&self) -> &Status {
        &self.status
    }

    /// The calibration in use.
    pub fn calibration(&self) -> Option<&Calibration> {
        self.calibration.as_ref()
    }

    /// What the calibration in the stream says of the unit, when it was read.
    pub fn unit(&self) -> Option<&Unit> {
        self.unit.as_ref()
    }

    /// While waiting for the calibration in the stream: bytes there of [`super::in_stream::STREAM_LEN`], and why the last
    /// full set was none.
    pub fn awaiting(&self) -> Option<(usize, Option<&InStreamError>)> {
        self.collector.as_ref().map(|collector| (collector.filled(), collector.failure()))
    }

    /// Appends the packet's points, in the order block, channel; in dual return firing, bank, channel, of two different
    /// returns the last one first. Counts of zero and lasers that are not enabled are left out, nothing else is. Columns
    /// count pairs of blocks, in dual return fours: S2's and S3's firings.
    ///
    /// # Errors
    /// [`WireError`] for a payload that is none; nothing was appended then, and the decoder is as before.
    pub fn decode(&mut self, packet: &DataPacket<'_>, points: &mut Points) -> Result<Hdl64Packet, WireError> {
        let azimuths = packet.azimuths()?;
        let alternating = packet.blocks().zip(Generation::S2.banks()).all(|(block, bank)| block.bank() == Some(bank));
        let tail = self.status.update(packet.tail());
        let stamped = alternating && tail.stamped();
        let dual = alternating && self.returns_twice(&azimuths);
        let step = if stamped { Some(self.pace.step(packet.stamp(), dual)) } else { None };
        let (generation, settled) = self.recognise(alternating);
        let calibration_completed = match (step, tail) {
            (Some(step), Tail::Typed { kind, value }) => self.collect(step, kind, value),
            _ => false,
        };

        let (rate, azimuth_jump) = turn_rate(generation, dual, &azimuths);
        let before = points.len();
        if let Some(optics) = &self.optics {
            let turns = generation.lasers_ns().map(|after_ns| turn(after_ns, rate));
            let single =
                if self.unit.is_some_and(|unit| unit.return_mode == 1) { Return::Last } else { Return::Strongest };
            let mut firings = [None; BLOCKS];
            for ((index, firing), cdeg) in (0u8..).zip(firings.iter_mut()).zip(azimuths) {
                let azimuth_rad = f64::from(cdeg) * RAD_PER_CDEG;
                let at_ns = generation.block_ns(dual, stamped, index);
                // An S1's blocks are counted in pairs like the others', though each is a firing of its own.
                let column = if generation == Generation::S1 { index / 2 } else { generation.cycle(dual, index) };
                *firing = Some(Firing { column, at_ns, azimuth_rad, head: libm::sincos(azimuth_rad) });
            }
            let mut blocks = packet.blocks().zip(firings.into_iter().flatten());
            if dual {
                // Upper, lower, upper, lower of one firing: the strongest returns, then the last.
                while let (Some(a), Some(b), Some(c), Some(d)) =
                    (blocks.next(), blocks.next(), blocks.next(), blocks.next())
                {
                    optics.dual_block(a.0, c.0, a.1, &turns, points);
                    optics.dual_block(b.0, d.0, a.1, &turns, points);
                }
            } else {
                for (block, firing) in blocks {
                    optics.block(block, firing, &turns, single, points);
                }
            }
        }
        Ok(Hdl64Packet {
            generation,
            settled,
            dual,
            firings: generation.cycles_per_packet(dual),
            points: points.len() - before,
            uncalibrated: self.optics.is_none(),
            calibration_completed,
            stamped,
            period_ns: generation.period_ns(dual),
            lost: match step {
                Some(Step::Packets(packets)) => packets.saturating_sub(1),
                _ => 0,
            },
            azimuth_first_cdeg: azimuths.first().copied().unwrap_or_default(),
            azimuth_last_cdeg: azimuths.last().copied().unwrap_or_default(),
            azimuth_jump,
        })
    }

    /// Dual return shows in the azimuths alone: four blocks share one. A head that stands still gives no sign.
    fn returns_twice(&mut self, azimuths: &[u16; BLOCKS]) -> bool {
        let (fours, _) = azimuths.as_chunks::<4>();
        let still = azimuths.iter().all(|azimuth| Some(azimuth) == azimuths.first());
        if !still {
            self.dual = fours.iter().all(|[a, b, c, d]| a == b && b == c && c == d);
        }
        self.dual
    }

    fn recognise(&mut self, alternating: bool) -> (Generation, bool) {
        if !alternating {
            self.generation = Some(Generation::S1);
        } else if self.status.warnings.is_some() {
            self.generation = Some(Generation::S3);
        } else if self.status.text == Some(true) {
            // No S3 has text for status.
            self.generation = Some(Generation::S2);
        } else if let Some(generation) = self.pace.generation() {
            self.generation = Some(generation);
        } else if self.generation == Some(Generation::S1) {
            self.generation = None;
        }
        let known = self.forced.or(self.generation);
        (known.unwrap_or(Generation::S2), known.is_some())
    }

    fn collect(&mut self, step: Step, kind: u8, value: u8) -> bool {
        let Some(found) = self.collector.as_mut().and_then(|collector| collector.push(step, kind, value)) else {
            return false;
        };
        self.optics = Some(Box::new(Optics::new(&found.calibration)));
        self.calibration = Some(found.calibration);
        self.unit = Some(found.unit);
        self.collector = None;
        true
    }
}

impl Optics {
    fn block(&self, block: Block<'_>, firing: Firing, turns: &[Turn; SLOTS], ret: Return, points: &mut Points) {
        let Some(bank) = block.bank() else { return };
        let (raws, intensities) = block.slots();
        for (((laser, turn), raw), intensity) in self.bank(bank).iter().zip(turns).zip(raws).zip(intensities) {
            if raw != 0 {
                self.point(laser, firing, turn, (raw, intensity), ret, points);
            }
        }
    }

    fn dual_block(
        &self,
        strongest: Block<'_>,
        last: Block<'_>,
        firing: Firing,
        turns: &[Turn; SLOTS],
        points: &mut Points,
    ) {
        let Some(bank) = strongest.bank() else { return };
        let (strongest, strongest_intensities) = strongest.slots();
        let (last, last_intensities) = last.slots();
        let strongest = strongest.into_iter().zip(strongest_intensities);
        let last = last.into_iter().zip(last_intensities);
        for (((laser, turn), strongest), last) in self.bank(bank).iter().zip(turns).zip(strongest).zip(last) {
            if strongest.0 == last.0 {
                if strongest.0 != 0 {
                    self.point(laser, firing, turn, strongest, Return::Both, points);
                }
                continue;
            }
            for (slot, ret) in [(last, Return::Last), (strongest, Return::Strongest)] {
                if slot.0 != 0 {
                    self.point(laser, firing, turn, slot, ret, points);
                }
            }
        }
    }

    #[inline]
    fn point(
        &self,
        laser: &Laser,
        firing: Firing,
        turn: &Turn,
        (raw, intensity): (u16, u8),
        ret: Return,
        points: &mut Points,
    ) {
        let (sin, cos) = firing.head;
        let head = (sin * turn.cos + cos * turn.sin, cos * turn.cos - sin * turn.sin);
        if !laser.enabled {
            return;
        }
        let Some(placed) = self.beams.place(laser.id, head, raw) else { return };
        let [x, y, z] = placed.xyz;
        points.push(LidarPoint {
            xyz: [x as f32, y as f32, z as f32],
            range_m: placed.range_m as f32,
            azimuth_rad: turned(firing.azimuth_rad + turn.angle_rad - laser.rotation_rad),
            dt_ns: firing.at_ns + turn.after_ns,
            intensity: laser.brightness.correct(intensity, raw),
            laser: laser.id,
            ring: laser.ring,
            column: firing.column,
            ret,
        });
    }
}

/// An angle within a turn of 0..2π, brought there.
fn turned(angle_rad: f64) -> f32 {
    let angle = if angle_rad < 0.0 {
        angle_rad + TAU
    } else if angle_rad >= TAU {
        angle_rad - TAU
    } else {
        angle_rad
    };
    let angle = angle as f32;
    // Just below 2π rounds to it.
    if angle >= TAU as f32 { 0.0 } else { angle }
}

/// How far the head turns in `after_ns`. At most 1° (see [`LONGEST_TURN_CDEG`]), so three terms give it to 1e-9.
fn turn(after_ns: i32, rate_rad_per_ns: f64) -> Turn {
    let angle_rad = f64::from(after_ns) * rate_rad_per_ns;
    let square = angle_rad * angle_rad;
    Turn { after_ns, angle_rad, sin: angle_rad * (1.0 - square / 6.0), cos: 1.0 - square * (0.5 - square / 24.0) }
}

/// The head's mean rate over the packet, radians per ns, and whether a step was left out as a jump. The mean, because
/// the encoder's steps of 0.09° make the single ones uneven. Zero when the head stands still or nothing was left.
fn turn_rate(generation: Generation, dual: bool, azimuths: &[u16; BLOCKS]) -> (f64, bool) {
    let blocks_per_firing = BLOCKS / usize::from(generation.cycles_per_packet(dual));
    let ahead = azimuths.iter().step_by(blocks_per_firing).skip(1);
    let (mut sum, mut steps, mut jump) = (0u32, 0u32, false);
    for (from, to) in azimuths.iter().step_by(blocks_per_firing).zip(ahead) {
        let step = if to >= from { to - from } else { to + (TURN_CDEG - from) };
        if step > LONGEST_TURN_CDEG {
            jump = true;
        } else {
            sum += u32::from(step);
            steps += 1;
        }
    }
    let ns = f64::from(steps) * f64::from(generation.cycle_ns());
    (if steps == 0 { 0.0 } else { f64::from(sum) * RAD_PER_CDEG / ns }, jump)
}

//! One packet of a model with built-in geometry to points.
//!
//! For the slot of laser c in block b (the manuals' formula, M16 and M32 chapter 9):
//!
//! ```text
//!   a = azimuth[b] + gap[b]·t(c)/T_block + offset(c)         clockwise from above
//!   x =  r·cos(w)·cos(a)    y = −r·cos(w)·sin(a)    z = r·sin(w) + height(c)
//! ```
//!
//! with x forward, y left, z up (the manuals' X is −y, their Y is x). Only the block's azimuth needs a sine and
//! cosine from the library; the slots follow from it by two rotations, the laser's constant offset and the small turn
//! within the block.

use crate::azimuth::Turning;
use crate::beams::BeamTable;
use crate::models::ReturnMode;
use crate::points::{Points, Return};
use crate::wire::{DataPacket, SLOTS};
use core::f64::consts::{PI, TAU};

const RAD_PER_CDEG: f64 = PI / 18_000.0;

/// Below this turn within a block the Taylor series of [`small_sincos`] are exact to 1e-13; above it (no real motor
/// gets there) the library's sine and cosine take over.
const SMALL_TURN_RAD: f64 = 0.1;

/// How the firings of one packet are timed, beyond what the block number says.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Timing {
    /// Added to every firing time, ns: 0 when the packet's stamp is its first firing's.
    pub shift_ns: i32,
    /// The silence of a sensor with a limited field of view: firings behind the packet's last azimuth jump come this much
    /// later, ns.
    pub pause_ns: i64,
}

/// Appends the packet's points with a distance, in the order packet, block, slot; in dual mode firing, slot, last
/// return before the other one, one point where both are equal.
pub fn decode_packet(
    packet: &DataPacket<'_>,
    beams: &BeamTable,
    mode: ReturnMode,
    turning: &Turning,
    timing: Timing,
    points: &mut Points,
) {
    let mut blocks = packet.blocks();
    let groups = turning.base_cdeg.iter().zip(&turning.gap_cdeg).take(turning.groups);
    for (group, (azimuth_cdeg, gap_cdeg)) in (0u8..).zip(groups) {
        let pause_ns = turning.jumps.pause_before_ns(usize::from(group), timing.pause_ns) as i32;
        let firing = Firing {
            azimuth_rad: f64::from(*azimuth_cdeg) * RAD_PER_CDEG,
            turn_rad: f64::from(*gap_cdeg) * RAD_PER_CDEG,
            start_ns: i32::from(group) * beams.block_ns as i32 + timing.shift_ns + pause_ns,
            column: group * beams.columns_per_block,
        };
        let Some(first) = blocks.next() else { return };
        let directions = Directions::of(beams, &firing);
        let (raw, intensity) = first.slots();
        let slots = Slots::of(beams, &directions, raw, intensity);
        match mode {
            ReturnMode::Strongest => emit(beams, &firing, &directions, &slots, Return::Strongest, points),
            ReturnMode::Last => emit(beams, &firing, &directions, &slots, Return::Last, points),
            ReturnMode::Dual => {
                let Some(second) = blocks.next() else { return };
                let last = slots;
                let (raw, intensity) = second.slots();
                let strongest = Slots::of(beams, &directions, raw, intensity);
                emit_dual(beams, &firing, &directions, &last, &strongest, points);
            }
        }
    }
}

/// One firing group: where the head stands, how far it turns until the next group, when it starts.
struct Firing {
    azimuth_rad: f64,
    turn_rad: f64,
    start_ns: i32,
    column: u8,
}

/// Unit-range directions of the 32 slots: multiply by raw counts for metres.
struct Directions {
    x: [f64; SLOTS],
    y: [f64; SLOTS],
    azimuth_rad: [f32; SLOTS],
}

impl Directions {
    #[inline]
    fn of(beams: &BeamTable, firing: &Firing) -> Self {
        let (sin_block, cos_block) = libm::sincos(firing.azimuth_rad);
        let small = firing.turn_rad.abs() < SMALL_TURN_RAD;
        let mut out = Self { x: [0.0; SLOTS], y: [0.0; SLOTS], azimuth_rad: [0.0; SLOTS] };
        let slots = out.x.iter_mut().zip(&mut out.y).zip(&mut out.azimuth_rad);
        let lasers = beams.turn_share.iter().zip(&beams.offset_rad).zip(&beams.horizontal_m);
        let offsets = beams.offset_sin.iter().zip(&beams.offset_cos);
        for ((((x, y), azimuth), ((share, offset), horizontal)), (sin_offset, cos_offset)) in
            slots.zip(lasers).zip(offsets)
        {
            let turn = firing.turn_rad * share;
            let (sin_turn, cos_turn) = if small { small_sincos(turn) } else { libm::sincos(turn) };
            let sin_beam = sin_offset * cos_turn + cos_offset * sin_turn;
            let cos_beam = cos_offset * cos_turn - sin_offset * sin_turn;
            *x = horizontal * (cos_block * cos_beam - sin_block * sin_beam);
            *y = -horizontal * (sin_block * cos_beam + cos_block * sin_beam);
            *azimuth = wrap_turn(firing.azimuth_rad + turn + offset);
        }
        out
    }
}

/// Sine and cosine of a small angle by their Taylor series; the first terms left out are x⁹/9! and x⁸/8!.
#[inline]
fn small_sincos(x: f64) -> (f64, f64) {
    let x2 = x * x;
    let sin = x * (1.0 - x2 * (1.0 / 6.0 - x2 * (1.0 / 120.0 - x2 * (1.0 / 5_040.0))));
    let cos = 1.0 - x2 * (0.5 - x2 * (1.0 / 24.0 - x2 * (1.0 / 720.0)));
    (sin, cos)
}

/// An angle within one turn of 0..2π into it. `f32` rounds the last 1e-7 below 2π up to more than 2π: that is 0.
#[inline]
fn wrap_turn(angle: f64) -> f32 {
    let up = if angle < 0.0 { angle + TAU } else { angle };
    let wrapped = if up >= TAU { up - TAU } else { up } as f32;
    if wrapped >= core::f32::consts::TAU { 0.0 } else { wrapped }
}

/// The slots of one block in metres.
struct Slots {
    raw: [u16; SLOTS],
    intensity: [u8; SLOTS],
    x: [f32; SLOTS],
    y: [f32; SLOTS],
    z: [f32; SLOTS],
    range_m: [f32; SLOTS],
}

impl Slots {
    #[inline]
    fn of(beams: &BeamTable, directions: &Directions, raw: [u16; SLOTS], intensity: [u8; SLOTS]) -> Self {
        let mut counts = [0.0f64; SLOTS];
        for (count, raw) in counts.iter_mut().zip(&raw) {
            *count = f64::from(*raw);
        }
        let mut out = Self { raw, intensity, x: [0.0; SLOTS], y: [0.0; SLOTS], z: [0.0; SLOTS], range_m: [0.0; SLOTS] };
        for ((x, direction), count) in out.x.iter_mut().zip(&directions.x).zip(&counts) {
            *x = (count * direction) as f32;
        }
        for ((y, direction), count) in out.y.iter_mut().zip(&directions.y).zip(&counts) {
            *y = (count * direction) as f32;
        }
        for (((z, vertical), height), count) in
            out.z.iter_mut().zip(&beams.vertical_m).zip(&beams.height_m).zip(&counts)
        {
            *z = (count * vertical + height) as f32;
        }
        for (range, count) in out.range_m.iter_mut().zip(&counts) {
            *range = (count * beams.distance_lsb_m) as f32;
        }
        out
    }
}

/// Appends the slots of one block that have a return.
#[inline]
fn emit(beams: &BeamTable, firing: &Firing, directions: &Directions, slots: &Slots, ret: Return, points: &mut Points) {
    let mut hits = Hits::default();
    for (slot, raw) in (0u8..).zip(&slots.raw) {
        hits.add(slot, ret, *raw != 0);
    }
    let hits = hits.codes();
    points.x.extend(hits.iter().map(|&code| at(&slots.x, code)));
    points.y.extend(hits.iter().map(|&code| at(&slots.y, code)));
    points.z.extend(hits.iter().map(|&code| at(&slots.z, code)));
    points.range_m.extend(hits.iter().map(|&code| at(&slots.range_m, code)));
    points.intensity.extend(hits.iter().map(|&code| at(&slots.intensity, code)));
    points.ret.extend(core::iter::repeat_n(ret, hits.len()));
    emit_beams(beams, firing, directions, hits, points);
}

/// Appends the slots of a dual-return pair: the last return, then the other one; one point where they are the same.
///
/// The sensor sends one return twice when there is only one (M16 9.2). The distances then are equal; should the
/// reflectivities not be, the strongest return's counts.
#[inline]
fn emit_dual(
    beams: &BeamTable,
    firing: &Firing,
    directions: &Directions,
    last: &Slots,
    strongest: &Slots,
    points: &mut Points,
) {
    let mut hits = Hits::default();
    for (slot, (last, strongest)) in (0u8..).zip(last.raw.iter().zip(&strongest.raw)) {
        let same = last == strongest;
        hits.add(slot, if same { Return::Both } else { Return::Last }, *last != 0);
        hits.add(slot, Return::Strongest, !same && *strongest != 0);
    }
    let hits = hits.codes();
    let of = |code| if Hits::ret(code) == Return::Last { last } else { strongest };
    points.x.extend(hits.iter().map(|&code| at(&of(code).x, code)));
    points.y.extend(hits.iter().map(|&code| at(&of(code).y, code)));
    points.z.extend(hits.iter().map(|&code| at(&of(code).z, code)));
    points.range_m.extend(hits.iter().map(|&code| at(&of(code).range_m, code)));
    points.intensity.extend(hits.iter().map(|&code| at(&of(code).intensity, code)));
    points.ret.extend(hits.iter().map(|&code| Hits::ret(code)));
    emit_beams(beams, firing, directions, hits, points);
}

/// Appends what depends on the slot alone and not on the distance.
#[inline]
fn emit_beams(beams: &BeamTable, firing: &Firing, directions: &Directions, hits: &[u8], points: &mut Points) {
    points.azimuth_rad.extend(hits.iter().map(|&code| at(&directions.azimuth_rad, code)));
    points.dt_ns.extend(hits.iter().map(|&code| firing.start_ns + at(&beams.dt_ns, code)));
    points.laser.extend(hits.iter().map(|&code| at(&beams.laser, code)));
    points.ring.extend(hits.iter().map(|&code| at(&beams.ring, code)));
    points.column.extend(hits.iter().map(|&code| firing.column + at(&beams.column, code)));
}

/// The slots of a firing that have a return, in order: at most two returns a slot. A code is the slot in its low five
/// bits, as [`at`] takes it, and the return above.
struct Hits {
    codes: [u8; 2 * SLOTS],
    len: usize,
}

impl Default for Hits {
    fn default() -> Self {
        Self { codes: [0; 2 * SLOTS], len: 0 }
    }
}

impl Hits {
    /// Writes the code always and keeps it only if it is a hit: no branch on the data.
    #[inline]
    fn add(&mut self, slot: u8, ret: Return, hit: bool) {
        if let Some(place) = self.codes.get_mut(self.len) {
            *place = slot | (ret as u8) << 5;
        }
        self.len += usize::from(hit);
    }

    #[inline]
    fn codes(&self) -> &[u8] {
        self.codes.get(..self.len).unwrap_or_default()
    }

    #[inline]
    fn ret(code: u8) -> Return {
        match code >> 5 {
            3 => Return::Both,
            2 => Return::Last,
            _ => Return::Strongest,
        }
    }
}

/// The entry of a slot, or of a hit's code: the low five bits. The remainder keeps the index inside the array without a
/// check.
#[allow(clippy::indexing_slicing, reason = "the index is taken modulo the array's length")]
#[inline]
fn at<T: Copy>(column: &[T; SLOTS], slot: u8) -> T {
    column[usize::from(slot) % SLOTS]
}

//! From stamps and azimuths of consecutive packets to what was lost between them.
//!
//! A packet follows the one before it by a fixed period, so the stamps count what is missing. Two things look like
//! loss and are not: a sensor with a limited field of view is silent for part of each turn, mostly inside a packet
//! (its azimuth jumps), now and then exactly between two; and a counter that starts anew (reboot, PPS lock).
//!
//! The head keeps turning through the silence, so its length follows from the jump's width and the speed, to a few
//! µs once the speed is known over some packets; the next packet's stamp then gives it exactly, and tells whether
//! packets were lost behind it.

use crate::azimuth::{Jump, Turning, forward_cdeg};
use tumbled_model::{LidarTime, RigNs, Span};

const HOUR_NS: i64 = LidarTime::HOUR_US as i64 * 1_000;

/// Stamps and arrivals that disagree by more mean that the counter was set anew. Above every delay of a kernel-stamped
/// packet and the silence of a 300 rpm turn (200 ms); below, a sub-second PPS alignment can hide as loss.
const RESET_NS: i64 = 250_000_000;

/// Nobody waits longer for the next packet; what comes then is a new beginning. Half a year.
const MAX_SILENCE_NS: i64 = 183 * 24 * HOUR_NS;

/// One turn in the azimuths' unit.
const TURN_CDEG: f64 = 36_000.0;
/// A step this far off its expected angle has an unknown number of turns, or the motor changed its speed: a fifth of a turn.
const MAX_SURPRISE_CDEG: f64 = 7_200.0;

/// Shortest stretch of packets that gives a speed: at 600 rpm 18°, so quantisation costs 0.06 %.
const SPEED_MIN_NS: i64 = 5_000_000;
/// After this stretch the speed is taken and measured afresh.
const SPEED_SPAN_NS: i64 = 40_000_000;

/// A silence between packets is at least this wide before it can be taken for the view's limit.
const MIN_SILENCE_CDEG: i32 = 500;
/// Two gaps at the same azimuths to within this are the view's limit and not chance, if they are wide enough.
const SAME_GAP_CDEG: i32 = 100;
/// Narrower, loss itself strikes twice at the same azimuths now and then.
const MIN_TWIN_CDEG: i32 = 1_500;
/// Unexplained gaps remembered until the view's limits are known.
const MAX_CANDIDATES: usize = 32;
/// Stamps remembered to tell a late packet from a repeated one.
const RECENT: usize = 32;

/// Running totals of one sensor's packet stream.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StreamTotals {
    /// Packets seen.
    pub received: u64,
    /// Packets that the stamps say were sent and that never came, late ones taken off again.
    pub lost: u64,
    /// Places where packets are missing.
    pub gaps: u64,
    /// Most packets missing in one place.
    pub longest_gap: u64,
    /// Packets that came twice.
    pub duplicates: u64,
    /// Packets that came after a later one.
    pub late: u64,
    /// Times the counter was set anew.
    pub resets: u64,
    /// Silences of a limited field of view.
    pub pauses: u64,
}

/// How a packet stands to the ones before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// The first, or the next after `lost` missing ones.
    Next {
        /// Packets missing just before it.
        lost: u64,
    },
    /// Its stamp has been seen before.
    Duplicate,
    /// Older than the newest one seen.
    Late,
    /// The counter was set anew before this packet; what was lost in between cannot be known.
    Reset,
}

/// The sector in which a sensor with a limited field of view does not fire.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SilentSector {
    /// Azimuth of the last firing before it, 0.01°.
    pub from_cdeg: u16,
    /// From there to the first firing behind it, 0.01°.
    pub width_cdeg: u16,
    /// How much later than without it the firings behind it come, ns.
    pub pause_ns: i64,
}

/// What the tracker says of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Observation {
    /// Its place in the stream.
    pub order: Order,
    /// The silence inside the packet before this one, if that had an azimuth jump, ns.
    pub previous_pause_ns: Option<i64>,
}

/// Follows one sensor's data packets. Pure bookkeeping: stamps, arrivals and azimuths in, counts out.
#[derive(Clone, Debug, Default)]
pub struct PacketTracker {
    last: Option<Last>,
    speed: Speed,
    silent: Option<SilentSector>,
    candidates: Vec<Gap>,
    recent: [Option<LidarTime>; RECENT],
    totals: StreamTotals,
}

#[derive(Clone, Copy, Debug)]
struct Last {
    stamp: LidarTime,
    arrived: RigNs,
    period_ns: i64,
    first_cdeg: u16,
    last_cdeg: u16,
    median_cdeg: i32,
    groups: usize,
    jump: Option<Jump>,
}

#[derive(Clone, Copy, Debug)]
struct Gap {
    from_cdeg: u16,
    to_cdeg: u16,
    span_ns: i64,
    period_ns: i64,
    lost: u64,
}

impl PacketTracker {
    /// Takes note of one packet. `period_ns` is the time from its stamp to the next packet's when nothing is lost.
    pub fn observe(&mut self, stamp: LidarTime, arrived: RigNs, period_ns: i64, turning: &Turning) -> Observation {
        self.totals.received += 1;
        let seen_before = self.recent.contains(&Some(stamp));
        let slot = (self.totals.received % RECENT as u64) as usize;
        if let Some(place) = self.recent.get_mut(slot) {
            *place = Some(stamp);
        }
        let now = Last {
            stamp,
            arrived,
            period_ns,
            first_cdeg: turning.first_cdeg(),
            last_cdeg: turning.last_cdeg(),
            median_cdeg: turning.median_cdeg,
            groups: turning.groups,
            jump: turning.jump,
        };
        let Some(last) = self.last else {
            self.last = Some(now);
            return Observation { order: Order::Next { lost: 0 }, previous_pause_ns: None };
        };
        let Some(span_ns) = elapsed(&last, stamp, arrived) else {
            self.totals.resets += 1;
            self.speed.interrupt();
            self.last = Some(now);
            let previous_pause_ns = last.jump.map(|jump| self.pause_by_angle(&last, jump));
            return Observation { order: Order::Reset, previous_pause_ns };
        };
        if span_ns <= 0 {
            // Not newer than the newest: the newest stays what it is, its own silence still unknown.
            let order = if seen_before { Order::Duplicate } else { Order::Late };
            match order {
                Order::Duplicate => self.totals.duplicates += 1,
                _ => {
                    self.totals.late += 1;
                    self.totals.lost = self.totals.lost.saturating_sub(1); // it was counted when its successor came
                }
            }
            return Observation { order, previous_pause_ns: None };
        }
        let (lost, previous_pause_ns) = match last.jump {
            Some(jump) => {
                let (lost, pause_ns) = self.behind_jump(&last, jump, &now, span_ns);
                (lost, Some(pause_ns))
            }
            None => (self.between(&last, &now, span_ns), None),
        };
        // The head turns on through loss and silence alike: only a gap of so many turns that their number is in doubt
        // says nothing about its speed.
        let turned_cdeg = self.speed_or_rough(&last) * span_ns as f64;
        self.speed.advance(forward_cdeg(last.first_cdeg, now.first_cdeg), turned_cdeg, span_ns);
        if lost > 0 {
            self.totals.lost += lost;
            self.totals.gaps += 1;
            self.totals.longest_gap = self.totals.longest_gap.max(lost);
        }
        self.last = Some(now);
        Observation { order: Order::Next { lost }, previous_pause_ns }
    }

    /// Counts a packet of a sensor without a clock: nothing can be said of what is missing before it.
    pub fn count_unstamped(&mut self) {
        self.totals.received += 1;
    }

    /// Sets the counts of lost packets back to none, since they were counted with a wrong period; `period_ns` is the right one.
    pub fn forget_losses(&mut self, period_ns: i64) {
        if let Some(last) = &mut self.last {
            last.period_ns = period_ns;
        }
        self.totals = StreamTotals { lost: 0, gaps: 0, longest_gap: 0, ..self.totals };
        self.candidates.clear();
    }

    /// What has been counted so far.
    pub fn totals(&self) -> StreamTotals {
        self.totals
    }

    /// The sector the sensor is set not to look at, once a turn has shown it.
    pub fn silent_sector(&self) -> Option<SilentSector> {
        self.silent
    }

    /// The head's speed, turns per minute, once known.
    pub fn rpm(&self) -> Option<f64> {
        let turns_per_ns = self.speed.measured()? / TURN_CDEG;
        Some(turns_per_ns * 60e9)
    }

    /// The best estimate of a silence inside the newest packet, for when no packet follows, ns.
    pub fn pending_pause_ns(&self) -> Option<i64> {
        let last = self.last?;
        last.jump.map(|jump| self.pause_by_angle(&last, jump))
    }

    /// Speed in 0.01° per ns: measured over some packets, or else from the newest packet alone.
    fn speed_or_rough(&self, last: &Last) -> f64 {
        let rough = f64::from(last.median_cdeg) * last.groups as f64 / last.period_ns as f64;
        self.speed.measured().unwrap_or(rough)
    }

    /// The silence that the width of the jump tells: the time to turn through it less the one firing cycle that
    /// passes anyway, on the sensor's own grid of firing cycles.
    fn pause_by_angle(&self, last: &Last, jump: Jump) -> i64 {
        let speed = self.speed_or_rough(last);
        if speed <= 0.0 {
            return 0;
        }
        let cycle = last.period_ns as f64 / last.groups as f64;
        let cycles = libm::round(f64::from(jump.width_cdeg) / speed / cycle) - 1.0;
        (cycles.max(0.0) * cycle) as i64
    }

    /// Packets lost behind a packet that holds a jump, and the jump's exact pause.
    fn behind_jump(&mut self, last: &Last, jump: Jump, now: &Last, span_ns: i64) -> (u64, i64) {
        let period = last.period_ns;
        let lost = if self.speed.measured().is_some() {
            // Behind the jump the head may have come round to the silent sector again.
            let span_ns = span_ns - self.pause_by_angle(last, jump);
            let gap = Gap { from_cdeg: last.last_cdeg, to_cdeg: now.first_cdeg, span_ns, period_ns: period, lost: 0 };
            match (packets_missing(span_ns, period), self.silent) {
                (1.., Some(silent)) => self.explain(&gap, silent).0,
                (missing, _) => missing,
            }
        } else {
            // One packet's own speed is too coarse for half a turn, yet good enough for the short way from this
            // packet's last azimuth to the next one's first.
            let packet_cdeg = i64::from(last.median_cdeg) * last.groups as i64;
            let behind = i64::from(forward_cdeg(last.last_cdeg, now.first_cdeg) - last.median_cdeg);
            if packet_cdeg > 0 { ((behind + packet_cdeg / 2) / packet_cdeg).max(0) as u64 } else { 0 }
        };
        let exact = span_ns - (lost as i64 + 1) * period;
        let pause_ns = if exact >= 0 { exact } else { self.pause_by_angle(last, jump) };
        self.totals.pauses += 1;
        let from_cdeg = last.last_cdeg_before_jump(jump);
        self.learn(SilentSector { from_cdeg, width_cdeg: jump.width_cdeg, pause_ns });
        (lost, pause_ns)
    }

    /// Packets lost between two packets, the silences in between taken off.
    fn between(&mut self, last: &Last, now: &Last, span_ns: i64) -> u64 {
        let period = last.period_ns;
        let missing = packets_missing(span_ns, period);
        if missing == 0 {
            return 0;
        }
        let gap = Gap { from_cdeg: last.last_cdeg, to_cdeg: now.first_cdeg, span_ns, period_ns: period, lost: missing };
        if let Some(silent) = self.silent {
            let (lost, passes) = self.explain(&gap, silent);
            self.totals.pauses += passes;
            return lost;
        }
        if forward_cdeg(gap.from_cdeg, gap.to_cdeg) >= MIN_SILENCE_CDEG {
            let twin = self.candidates.iter().find(|other| gap.same_place(other));
            let twin = twin.filter(|_| forward_cdeg(gap.from_cdeg, gap.to_cdeg) >= MIN_TWIN_CDEG);
            if let Some(twin) = twin {
                // Wide loss does not strike twice at the same azimuths: the shorter of the two is the view's limit.
                let shorter = if twin.span_ns < gap.span_ns { *twin } else { gap };
                self.learn(SilentSector {
                    from_cdeg: shorter.from_cdeg,
                    width_cdeg: forward_cdeg(shorter.from_cdeg, shorter.to_cdeg).max(0) as u16,
                    pause_ns: shorter.span_ns - shorter.period_ns,
                });
                return self.between(last, now, span_ns);
            }
            if self.candidates.len() >= MAX_CANDIDATES {
                // The widest are the likeliest to hold the view's limits.
                let narrowest = self.candidates.iter().enumerate().min_by_key(|(_, other)| other.lost);
                if let Some(narrowest) = narrowest.map(|(place, _)| place) {
                    self.candidates.swap_remove(narrowest);
                }
            }
            self.candidates.push(gap);
        }
        missing
    }

    /// Keeps the view's limits; when they come to be known, takes earlier silences off the losses.
    fn learn(&mut self, silent: SilentSector) {
        self.silent = Some(silent);
        for gap in core::mem::take(&mut self.candidates) {
            let (lost, passes) = self.explain(&gap, silent);
            self.totals.pauses += passes;
            self.totals.lost = self.totals.lost.saturating_sub(gap.lost.saturating_sub(lost));
            if lost == 0 {
                self.totals.gaps = self.totals.gaps.saturating_sub(1);
            }
            if self.totals.longest_gap == gap.lost {
                self.totals.longest_gap = lost;
            }
        }
    }

    /// Packets lost in a gap, and how often the head passed the silent sector in it.
    fn explain(&self, gap: &Gap, silent: SilentSector) -> (u64, u64) {
        // The middle of the sector is passed, wherever exactly its ends lie this turn.
        let middle = (u32::from(silent.from_cdeg) + u32::from(silent.width_cdeg) / 2) % 36_000;
        let to_middle = i64::from(forward_cdeg(gap.from_cdeg, middle as u16));
        let direct = i64::from(forward_cdeg(gap.from_cdeg, gap.to_cdeg));
        // Whole turns within the gap, from the time it took; without a speed there is less than one.
        let turned = self.speed.measured().map_or(direct as f64, |speed| speed * gap.span_ns as f64);
        let whole_turns = libm::round((turned - direct as f64) / TURN_CDEG).max(0.0) as i64;
        let passes = whole_turns + i64::from((0..=direct).contains(&to_middle));
        (packets_missing(gap.span_ns - passes * silent.pause_ns, gap.period_ns), passes as u64)
    }
}

impl Gap {
    fn same_place(&self, other: &Self) -> bool {
        let near = |a: u16, b: u16| {
            let d = forward_cdeg(a, b).rem_euclid(36_000);
            d.min(36_000 - d) < SAME_GAP_CDEG
        };
        near(self.from_cdeg, other.from_cdeg) && near(self.to_cdeg, other.to_cdeg)
    }
}

impl Last {
    /// Azimuth of the last group before the jump, counted back from the packet's end.
    fn last_cdeg_before_jump(&self, jump: Jump) -> u16 {
        let behind = self.groups as i32 - 2 - i32::from(jump.after_group);
        let back = behind * self.median_cdeg + i32::from(jump.width_cdeg);
        (i32::from(self.last_cdeg) - back).rem_euclid(36_000) as u16
    }
}

/// Device time from the newest packet to this one, hours resolved by the arrivals; `None` when the two clocks
/// disagree so much that the device's was set anew.
fn elapsed(last: &Last, stamp: LidarTime, arrived: RigNs) -> Option<i64> {
    let short = stamp.since(last.stamp).0;
    let by_arrival = (arrived - last.arrived).0;
    if by_arrival.checked_abs().is_none_or(|gap| gap > MAX_SILENCE_NS) {
        return None;
    }
    let hours = (by_arrival - short + HOUR_NS / 2).div_euclid(HOUR_NS);
    let span = Span(short + hours * HOUR_NS).0;
    let allowed = RESET_NS + by_arrival.abs() / 1_000;
    ((span - by_arrival).abs() <= allowed).then_some(span)
}

/// Packets missing in a span between two stamps.
fn packets_missing(span_ns: i64, period_ns: i64) -> u64 {
    let periods = (span_ns + period_ns / 2) / period_ns.max(1);
    (periods - 1).max(0) as u64
}

/// The head's speed over some packets.
#[derive(Clone, Copy, Debug, Default)]
struct Speed {
    angle_cdeg: i64,
    span_ns: i64,
    taken: Option<f64>,
}

impl Speed {
    /// Adds one step: its angle modulo a turn, the angle expected by the speed so far, its time.
    fn advance(&mut self, step_cdeg: i32, expected_cdeg: f64, span_ns: i64) {
        let turns = libm::round((expected_cdeg - f64::from(step_cdeg)) / TURN_CDEG);
        let angle_cdeg = f64::from(step_cdeg) + turns * TURN_CDEG;
        if (angle_cdeg - expected_cdeg).abs() > MAX_SURPRISE_CDEG {
            self.interrupt();
            return;
        }
        self.angle_cdeg += angle_cdeg as i64;
        self.span_ns += span_ns;
        if self.span_ns >= SPEED_SPAN_NS {
            self.interrupt();
        }
    }

    /// Takes the speed of the stretch behind; the next one starts afresh.
    fn interrupt(&mut self) {
        if self.span_ns >= SPEED_MIN_NS {
            self.taken = Some(self.angle_cdeg as f64 / self.span_ns as f64);
        }
        self.angle_cdeg = 0;
        self.span_ns = 0;
    }

    /// 0.01° per ns; `None` before enough packets, or when the motor stands.
    fn measured(&self) -> Option<f64> {
        let current = (self.span_ns >= SPEED_MIN_NS).then(|| self.angle_cdeg as f64 / self.span_ns as f64);
        self.taken.or(current).filter(|speed| *speed > 0.0)
    }
}

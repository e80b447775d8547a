//! From stamps and azimuths of consecutive packets to what was lost between them.
//!
//! A packet follows the one before it by a fixed period, so the stamps count what is missing. Two things look like
//! loss and are not: a sensor with a limited field of view is silent for part of each turn, mostly inside a packet
//! (its azimuth jumps), now and then exactly between two; and a counter that starts anew (reboot, PPS lock).
//!
//! The head keeps turning through the silence, so its length follows from the jump's width and the speed, to a few
//! µs once the speed is known over some packets; the next packet's stamp then gives it exactly, and tells whether
//! packets were lost behind it.

use crate::azimuth::{Jumps, Turning, forward_cdeg};
pub use crate::order::{Observation, Order, StreamTotals};
pub use crate::silence::SilentSector;
use crate::silence::{Fired, Gap, SAME_GAP_CDEG, near, packets_missing, pause_by_angle};
use crate::speed::{Speed, TURN_CDEG};
use tumbled_model::{LidarTime, RigNs};

const HOUR_NS: i64 = LidarTime::HOUR_US as i64 * 1_000;

/// Stamps and arrivals that disagree by more mean that the counter was set anew, unless the azimuths say otherwise.
/// Above every usual delay of a packet and the silence of a 300 rpm turn (200 ms).
const RESET_NS: i64 = 250_000_000;

/// Nobody waits longer for the next packet; what comes then is a new beginning. Half a year.
const MAX_SILENCE_NS: i64 = 183 * 24 * HOUR_NS;

/// Where the head stands tells a gap from a clock that was set: the two agree to within this much, and 3 % of the angle
/// turned, for a motor that changes its speed.
const MAX_ANGLE_ERROR_CDEG: f64 = 600.0;
/// Packets in a row that are neither new, nor repeated, nor out of a gap: the counter was set back.
const SET_BACK_RUN: u32 = 3;
/// Packets in a row that fit each other and nothing before them: the counter was set. One stamp alone is broken, or of
/// another sender.
const DOUBT_RUN: u32 = 3;

/// A silence between packets is at least this wide before it can be taken for the view's limit.
const MIN_SILENCE_CDEG: i32 = 500;
/// Narrower, loss itself strikes twice at the same azimuths now and then.
const MIN_TWIN_CDEG: i32 = 1_500;
/// Unexplained gaps remembered until the view's limits are known.
const MAX_CANDIDATES: usize = 32;
/// Stamps remembered to tell a late packet from a repeated one.
const RECENT: usize = 32;

/// Follows one sensor's data packets. Pure bookkeeping: stamps, arrivals and azimuths in, counts out.
#[derive(Clone, Debug, Default)]
pub struct PacketTracker {
    last: Option<Last>,
    speed: Speed,
    silent: Option<SilentSector>,
    candidates: Vec<Gap>,
    fired: Fired,
    recent: [Option<LidarTime>; RECENT],
    /// Spans of stamps in which packets are missing, newest last.
    missing: [Option<(LidarTime, LidarTime)>; RECENT],
    /// Packets on end that look late without a gap they could be from.
    set_back: u32,
    /// The newest doubtful packet, and how many on end agree with each other.
    doubt: Option<(Last, u32)>,
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
    jumps: Jumps,
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
            jumps: turning.jumps,
        };
        self.fired.note(now.first_cdeg);
        self.fired.note(now.last_cdeg);
        let Some(last) = self.last else {
            self.last = Some(now);
            return Observation { order: Order::Next { lost: 0 }, previous_pause_ns: None };
        };
        let span_ns = elapsed(&last, stamp, arrived);
        // Whatever its stamp is beside the newest: behind a counter that was set, what came before and comes again may look newer.
        if seen_before {
            self.totals.duplicates += 1;
            return Observation { order: Order::Duplicate, previous_pause_ns: None };
        }
        if span_ns.is_some_and(|span| span <= 0) {
            if let Some(order) = self.not_newer(stamp) {
                return Observation { order, previous_pause_ns: None };
            }
        } else if let Some(span_ns) = span_ns.filter(|span| self.is_continuous(&last, &now, *span)) {
            self.set_back = 0;
            self.doubt = None;
            return self.newer(&last, now, span_ns);
        } else if self.is_doubtful(now) {
            self.totals.doubtful += 1;
            return Observation { order: Order::Doubtful, previous_pause_ns: None };
        }
        self.totals.resets += 1;
        self.set_back = 0;
        self.doubt = None;
        self.missing = [None; RECENT];
        self.speed.interrupt();
        self.last = Some(now);
        Observation { order: Order::Reset, previous_pause_ns: self.pause_by_angle(&last) }
    }

    /// A packet in its order: what is missing before it.
    fn newer(&mut self, last: &Last, now: Last, span_ns: i64) -> Observation {
        let (lost, previous_pause_ns) = if last.jumps.is_empty() {
            (self.between(last, &now, span_ns), None)
        } else {
            let (lost, pause_ns) = self.behind_jump(last, &now, span_ns);
            (lost, Some(pause_ns))
        };
        // The head turns on through loss and silence alike: only a gap of so many turns that their number is in doubt
        // says nothing about its speed.
        let turned_cdeg = self.speed_or_rough(last) * span_ns as f64;
        self.speed.advance(forward_cdeg(last.first_cdeg, now.first_cdeg), turned_cdeg, span_ns);
        if lost > 0 {
            self.totals.lost += lost;
            self.totals.gaps += 1;
            self.totals.longest_gap = self.totals.longest_gap.max(lost);
            self.missing.rotate_left(1);
            if let Some(newest) = self.missing.last_mut() {
                *newest = Some((last.stamp, now.stamp));
            }
        }
        self.last = Some(now);
        Observation { order: Order::Next { lost }, previous_pause_ns }
    }

    /// A packet with a stamp no newer than the newest: late, or (`None`) of a counter that was set back.
    fn not_newer(&mut self, stamp: LidarTime) -> Option<Order> {
        let inside = |(from, to): (LidarTime, LidarTime)| stamp.since(from).0 > 0 && to.since(stamp).0 > 0;
        let out_of_a_gap = self.missing.iter().flatten().any(|gap| inside(*gap));
        if out_of_a_gap {
            self.totals.lost = self.totals.lost.saturating_sub(1); // it was counted when its successor came
            self.set_back = 0;
        } else {
            self.set_back += 1;
            if self.set_back >= SET_BACK_RUN {
                self.totals.late = self.totals.late.saturating_sub(u64::from(SET_BACK_RUN) - 1);
                return None;
            }
        }
        self.totals.late += 1;
        Some(Order::Late)
    }

    /// Whether a packet that fits nothing before it stands alone; the last of some that agree does not.
    fn is_doubtful(&mut self, now: Last) -> bool {
        let follows = |doubt: &Last| {
            let span_ns = elapsed(doubt, now.stamp, now.arrived).filter(|span| *span > 0);
            span_ns.is_some_and(|span_ns| self.is_continuous(doubt, &now, span_ns))
        };
        let run = self.doubt.filter(|(doubt, _)| follows(doubt)).map_or(1, |(_, run)| run + 1);
        self.doubt = Some((now, run));
        run < DOUBT_RUN
    }

    /// Whether a newer packet belongs to the same run of the counter.
    ///
    /// The head is the witness: it stands where the time between the stamps says it must, or the counter was set. Only
    /// where there is no speed to go by do the arrivals decide, which a stalled host delays.
    fn is_continuous(&self, last: &Last, now: &Last, span_ns: i64) -> bool {
        let by_arrival = (now.arrived - last.arrived).0;
        let apart = (span_ns - by_arrival).abs();
        let silence_ns = self.pause_by_angle(last).unwrap_or(0);
        if packets_missing(span_ns - silence_ns, last.period_ns) == 0 {
            return true;
        }
        let Some(speed) = self.speed.measured() else {
            return apart <= RESET_NS + by_arrival.abs() / 1_000;
        };
        let turned = speed * span_ns as f64;
        let seen = f64::from(forward_cdeg(last.first_cdeg, now.first_cdeg));
        let error = turned - seen - TURN_CDEG * libm::round((turned - seen) / TURN_CDEG);
        let tolerance = MAX_ANGLE_ERROR_CDEG + 0.03 * turned;
        if tolerance >= TURN_CDEG / 4.0 {
            // Too long ago for the azimuth to say anything.
            return apart <= RESET_NS + by_arrival.abs() / 1_000;
        }
        error.abs() <= tolerance
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
        self.last.and_then(|last| self.pause_by_angle(&last))
    }

    /// The silence inside a packet by the widths of its jumps, for one that came late or twice, ns.
    pub fn pause_of_ns(&self, turning: &Turning, period_ns: i64) -> i64 {
        let speed = self.speed_or(turning.median_cdeg, turning.groups, period_ns);
        let (angle_cdeg, jumps) = (turning.jumps.total_cdeg(), turning.jumps.count());
        pause_by_angle(angle_cdeg, jumps, speed, turning.groups, period_ns)
    }

    /// Speed in 0.01° per ns: measured over some packets, or else from the newest packet alone.
    fn speed_or_rough(&self, last: &Last) -> f64 {
        self.speed_or(last.median_cdeg, last.groups, last.period_ns)
    }

    fn speed_or(&self, median_cdeg: i32, groups: usize, period_ns: i64) -> f64 {
        let rough = f64::from(median_cdeg) * groups as f64 / period_ns as f64;
        self.speed.measured().unwrap_or(rough)
    }

    /// The silence in a packet by the widths of its jumps; `None` when it has none.
    fn pause_by_angle(&self, last: &Last) -> Option<i64> {
        let speed = self.speed_or_rough(last);
        let (angle_cdeg, jumps) = (last.jumps.total_cdeg(), last.jumps.count());
        (jumps > 0).then(|| pause_by_angle(angle_cdeg, jumps, speed, last.groups, last.period_ns))
    }

    /// Packets lost behind a packet that holds jumps, and the jumps' exact pause.
    fn behind_jump(&mut self, last: &Last, now: &Last, span_ns: i64) -> (u64, i64) {
        let period = last.period_ns;
        let (_, width_cdeg) = last.jumps.first().unwrap_or_default();
        let behind_cdeg = forward_cdeg(last.last_cdeg, now.first_cdeg);
        // A narrow view can end again right behind the packet: that silence is between the two packets and not in this one.
        let from_cdeg = last.last_cdeg_before_jumps();
        let ends_again = near(last.last_cdeg, from_cdeg) && (behind_cdeg - i32::from(width_cdeg)).abs() < SAME_GAP_CDEG;
        let (angle_cdeg, jumps) = match ends_again {
            true => (last.jumps.total_cdeg() + behind_cdeg as u32, last.jumps.count() + 1),
            false => (last.jumps.total_cdeg(), last.jumps.count()),
        };
        let by_angle = pause_by_angle(angle_cdeg, jumps, self.speed_or_rough(last), last.groups, period);
        let lost = if self.speed.measured().is_some() {
            // Behind the jump the head may have come round to the silent sector again.
            let span_ns = span_ns - by_angle;
            let gap = Gap { from_cdeg: last.last_cdeg, to_cdeg: now.first_cdeg, span_ns, period_ns: period, lost: 0 };
            match (packets_missing(span_ns, period), self.silent) {
                (1.., Some(silent)) if !ends_again => gap.explain(silent, self.speed.measured()).0,
                (missing, _) => missing,
            }
        } else if ends_again {
            0 // too rough a speed to tell a lost packet from an uneven one
        } else {
            // One packet's own speed is too coarse for half a turn, yet good enough for the short way from this
            // packet's last azimuth to the next one's first.
            let packet_cdeg = i64::from(last.median_cdeg) * last.groups as i64;
            let behind = i64::from(behind_cdeg - last.median_cdeg);
            if packet_cdeg > 0 { ((behind + packet_cdeg / 2) / packet_cdeg).max(0) as u64 } else { 0 }
        };
        let exact = span_ns - (lost as i64 + 1) * period;
        let silence_ns = if exact >= 0 { exact } else { by_angle };
        self.totals.pauses += jumps as u64;
        self.learn(SilentSector { from_cdeg, width_cdeg, pause_ns: silence_ns / jumps.max(1) as i64 });
        // Of the silence, the part within the packet.
        let within = i128::from(last.jumps.total_cdeg()) * i128::from(silence_ns) / i128::from(angle_cdeg.max(1));
        (lost, within as i64)
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
            let (lost, passes) = gap.explain(silent, self.speed.measured());
            self.totals.pauses += passes;
            return lost;
        }
        let may_be_silent = forward_cdeg(gap.from_cdeg, gap.to_cdeg) >= MIN_SILENCE_CDEG;
        // Loss strikes twice at the same azimuths when the host stalls in step with the head.
        if may_be_silent && !self.fired.within(&gap) {
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
            let (lost, passes) = gap.explain(silent, self.speed.measured());
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
}

impl Last {
    /// Azimuth of the last group before the last jump, counted back from the packet's end.
    fn last_cdeg_before_jumps(&self) -> u16 {
        let (group, width) = self.jumps.last().unwrap_or((self.groups - 1, 0));
        let behind = self.groups as i32 - 2 - group as i32;
        let back = behind * self.median_cdeg + i32::from(width);
        (i32::from(self.last_cdeg) - back).rem_euclid(36_000) as u16
    }
}

/// Device time from the newest packet to this one, hours resolved by the arrivals; `None` when these are no help.
fn elapsed(last: &Last, stamp: LidarTime, arrived: RigNs) -> Option<i64> {
    let short = stamp.since(last.stamp).0;
    let by_arrival = (arrived - last.arrived).0;
    if by_arrival.checked_abs().is_none_or(|gap| gap > MAX_SILENCE_NS) {
        return None;
    }
    let hours = (by_arrival - short + HOUR_NS / 2).div_euclid(HOUR_NS);
    let span = short + hours * HOUR_NS;
    // A counter that went back by more than any packet can be late was set.
    (span > 0 || (span - by_arrival).abs() <= RESET_NS + by_arrival.abs() / 1_000).then_some(span)
}

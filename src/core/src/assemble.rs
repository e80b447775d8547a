//! A LiDAR's packets to turns: each firing is in exactly one, from the end of a crossing of the region of interest to
//! the end of the next.
//!
//! A turn is cut by where the head stands, not by counting packets: so a limited field of view, lost packets and a
//! changing speed cut no turn twice and none short. Between two firings the head turns evenly; what is passed between
//! them (the cut, the region's middle) is passed at the time that follows from the angle.

use crate::epoch::{LidarScan, TimeBasis};
use crate::reorder::TimedPacket;
use crate::sector::{Sector, TURN_CDEG};
use core::ops::Range;
use tumbled_model::{RigNs, Span};

/// After so long without a firing a turn is over: the slowest motor takes 0.2 s a turn.
pub(crate) const LONGEST_SILENCE: Span = Span(300_000_000);
/// A turn is cut after so long even if the head does not turn: a standing motor must not fill the memory.
const LONGEST_TURN: Span = Span(1_000_000_000);
/// The head turns at least so far from cut to cut: an encoder that jitters at the cut makes no turns.
const LEAST_TURN_CDEG: i64 = TURN_CDEG as i64 / 2;
/// A step backwards of up to 0.5° is jitter of a slow or standing motor.
const JITTER_CDEG: i32 = 50;

/// A turn that is complete.
#[derive(Debug)]
pub(crate) struct Turn {
    pub(crate) t: RigNs,
    pub(crate) span: (RigNs, RigNs),
    pub(crate) sigma: Span,
    pub(crate) basis: TimeBasis,
    pub(crate) arrived: RigNs,
    pub(crate) scan: LidarScan,
}

/// The turn that is being filled.
#[derive(Clone, Debug)]
struct OpenTurn {
    /// When the head passed the region's middle.
    center: Option<RigNs>,
    span: (RigNs, RigNs),
    sigma: Span,
    basis: TimeBasis,
    arrived: RigNs,
    /// Of the region, 0.01°.
    covered_cdeg: i64,
    in_crossing: bool,
    scan: LidarScan,
}

/// Cuts a stream of packets, in the order they were sent, into turns.
#[derive(Clone, Debug)]
pub(crate) struct Assembler {
    sector: Sector,
    open: Option<OpenTurn>,
    /// The newest firing: where the head stood, and when.
    newest: Option<(i32, RigNs)>,
    /// How far the head has turned since the last cut, 0.01°.
    since_cut: i64,
    missed: u64,
    /// No later turn has an earlier time: a clock that is still being found may put a packet before the one ahead of it.
    passed: Option<RigNs>,
    spare: Vec<LidarScan>,
}

impl Assembler {
    pub(crate) fn new(sector: Sector) -> Self {
        Self {
            sector,
            open: None,
            newest: None,
            since_cut: LEAST_TURN_CDEG,
            missed: 0,
            passed: None,
            spare: Vec::new(),
        }
    }

    /// Takes another region of interest: the turn that is open ends with what it has.
    pub(crate) fn set_sector(&mut self, sector: Sector) -> Option<Turn> {
        if sector == self.sector {
            return None;
        }
        let turn = self.finish();
        self.sector = sector;
        turn
    }

    /// Buffers of a turn that is no longer needed.
    pub(crate) fn recycle(&mut self, scan: LidarScan) {
        if self.spare.len() < 4 {
            self.spare.push(scan);
        }
    }

    /// Crossings of the region that nothing at all was received of, between others.
    pub(crate) fn missed(&self) -> u64 {
        self.missed
    }

    /// No later turn will have an earlier time.
    pub(crate) fn watermark(&self) -> Option<RigNs> {
        self.passed
    }

    /// Takes the next packet. `cdeg_per_ns`: the head's speed, to tell how many turns a gap hides.
    pub(crate) fn push(&mut self, packet: &TimedPacket, cdeg_per_ns: Option<f64>, turns: &mut Vec<Turn>) {
        let columns = packet.points.column.as_slice();
        let mut run_start = 0; // points before it are in their turn
        let heads = packet.heads.as_slice();
        for (group, head) in heads.iter().enumerate() {
            let (offset, t) = (self.sector.offset(head.cdeg), packet.t + Span(i64::from(head.dt_ns)));
            let first = columns.partition_point(|column| *column < packet.heads.first_column(group));
            let end = columns.partition_point(|column| *column < packet.heads.first_column(group + 1));
            if self.is_turn_over(t) || self.passes_cut(offset, t, cdeg_per_ns) {
                self.fill(packet, run_start..first);
                run_start = first;
                turns.extend(self.close(offset, t, cdeg_per_ns));
            }
            self.advance(offset, t, cdeg_per_ns);
            self.sweep(packet, offset, t, first - run_start..end - run_start);
        }
        self.fill(packet, run_start..columns.len());
        let newest = self.newest.map(|(_, t)| t);
        self.passed = self.passed.max(self.open.as_ref().and_then(|open| open.center).or(newest));
    }

    /// Ends the open turn with what it has.
    pub(crate) fn finish(&mut self) -> Option<Turn> {
        self.newest = None;
        self.since_cut = LEAST_TURN_CDEG;
        self.open.take().map(|open| self.turn(open))
    }

    fn is_turn_over(&self, t: RigNs) -> bool {
        let silent = self.newest.is_some_and(|(_, newest)| t - newest > LONGEST_SILENCE);
        silent || self.open.as_ref().is_some_and(|open| t - open.span.0 > LONGEST_TURN)
    }

    /// How far the head has turned from the newest firing to this one, whole turns included, 0.01°.
    fn way(&self, offset: i32, t: RigNs, cdeg_per_ns: Option<f64>) -> Option<(i32, i64, i64)> {
        let (from, since) = self.newest?;
        let step = (offset - from).rem_euclid(TURN_CDEG);
        let direct = i64::from(if step >= TURN_CDEG - JITTER_CDEG { step - TURN_CDEG } else { step });
        let elapsed = (t - since).0;
        let turned = cdeg_per_ns.map_or(direct as f64, |speed| speed * elapsed as f64);
        let hidden = libm::round((turned - direct as f64) / f64::from(TURN_CDEG)).max(0.0) as i64;
        Some((from, direct + hidden * i64::from(TURN_CDEG), elapsed))
    }

    fn passes_cut(&self, offset: i32, t: RigNs, cdeg_per_ns: Option<f64>) -> bool {
        let Some((from, way, _)) = self.way(offset, t, cdeg_per_ns) else { return false };
        way >= i64::from(self.sector.to_cut(from)) && self.since_cut + way >= LEAST_TURN_CDEG
    }

    /// Ends the open turn at a firing that belongs to the next one.
    fn close(&mut self, offset: i32, t: RigNs, cdeg_per_ns: Option<f64>) -> Option<Turn> {
        let mut open = self.open.take()?;
        if self.newest.is_some_and(|(_, newest)| t - newest > LONGEST_SILENCE) {
            // Nothing is known of what lies between.
            self.newest = None;
            self.since_cut = LEAST_TURN_CDEG;
            return Some(self.turn(open));
        }
        let (from, way, elapsed) = self.way(offset, t, cdeg_per_ns)?;
        let (_, since) = self.newest?;
        let (to_cut, to_center) = (i64::from(self.sector.to_cut(from)), i64::from(self.sector.to_center(from)));
        let at = |angle: i64| since + Span((i128::from(elapsed) * i128::from(angle) / i128::from(way.max(1))) as i64);
        if open.center.is_none() && to_center <= way && to_center < to_cut {
            open.center = Some(at(to_center));
        }
        let cuts = if way >= to_cut { 1 + (way - to_cut) / i64::from(TURN_CDEG) } else { 0 };
        self.missed += u64::try_from(cuts - 1).unwrap_or(0);
        if cuts > 0 {
            // The rest of the way is the next turn's: it may reach beyond the next middle.
            let rest = (way - to_cut) % i64::from(TURN_CDEG);
            let cut_to_center = i64::from(self.sector.cut_to_center());
            let next = (rest >= cut_to_center).then(|| at(way - rest + cut_to_center));
            self.since_cut = rest;
            self.newest = Some((offset, t));
            let closed = self.turn(open);
            self.begin(t);
            if let Some(opened) = &mut self.open {
                opened.center = next;
            }
            return Some(closed);
        }
        Some(self.turn(open))
    }

    /// Notes where the head is, and whether it passed the region's middle on the way.
    fn advance(&mut self, offset: i32, t: RigNs, cdeg_per_ns: Option<f64>) {
        let way = self.way(offset, t, cdeg_per_ns);
        let since = self.newest.replace((offset, t)).map(|(_, since)| since);
        if self.open.is_none() {
            self.begin(t);
            if let Some(open) = &mut self.open
                && way.is_none()
                && offset > 0
                && self.sector.is_crossing(offset)
            {
                // The stream began behind the middle: nearest to it is the first firing.
                open.center = Some(t);
            }
        }
        let (Some(open), Some((from, way, elapsed)), Some(since)) = (&mut self.open, way, since) else { return };
        self.since_cut += way;
        let to_center = i64::from(self.sector.to_center(from));
        if open.center.is_none() && way > 0 && to_center <= way {
            open.center = Some(since + Span((i128::from(elapsed) * i128::from(to_center) / i128::from(way)) as i64));
        }
    }

    fn begin(&mut self, t: RigNs) {
        let mut scan = self.spare.pop().unwrap_or_default();
        scan.points.clear();
        let scan = LidarScan { stamp: t, points: scan.points, ..LidarScan::default() };
        let basis = TimeBasis::Arrival;
        self.open = Some(OpenTurn {
            center: None,
            span: (t, t),
            sigma: Span(0),
            basis,
            arrived: t,
            covered_cdeg: 0,
            in_crossing: false,
            scan,
        });
    }

    /// Counts a firing of the open turn; `unfilled` are the firing's points, counted from the first that is not in the
    /// turn's columns yet.
    fn sweep(&mut self, packet: &TimedPacket, offset: i32, t: RigNs, unfilled: Range<usize>) {
        let Some(open) = &mut self.open else { return };
        // While the clock is being found a packet may lie some µs before the end of the one before it.
        open.span = (open.span.0.min(t), open.span.1.max(t));
        (open.sigma, open.basis) = (packet.sigma, packet.basis);
        open.arrived = open.arrived.max(packet.arrived);
        if self.sector.is_region(offset) {
            open.covered_cdeg += i64::from(packet.heads.step_cdeg().max(0));
        }
        let filled = open.scan.points.len();
        let (begin, end) = (filled + unfilled.start, filled + unfilled.end);
        let is_crossing = self.sector.is_crossing(offset);
        if is_crossing && !open.in_crossing {
            // The newest run of such firings: the one before the cut, whatever an encoder jittered behind the last.
            open.scan.crossing = begin..begin;
        }
        open.in_crossing = is_crossing;
        if is_crossing {
            open.scan.crossing.end = end;
        }
    }

    /// Moves points of a packet into the open turn.
    fn fill(&mut self, packet: &TimedPacket, points: Range<usize>) {
        let Some(open) = self.open.as_mut().filter(|_| !points.is_empty()) else { return };
        let columns = &mut open.scan.points;
        let before = columns.len();
        columns.extend_from_range(&packet.points, points);
        open.scan.packets += 1;
        let later = (packet.t - open.scan.stamp).0;
        for dt_ns in columns.dt_ns.iter_mut().skip(before) {
            *dt_ns = (i64::from(*dt_ns) + later) as i32; // within a turn, 1 s at most
        }
    }

    fn turn(&self, open: OpenTurn) -> Turn {
        let OpenTurn { center, span, sigma, basis, arrived, covered_cdeg, mut scan, .. } = open;
        scan.coverage = (covered_cdeg as f64 / f64::from(self.sector.width_cdeg())).min(1.0);
        // A turn that ended before the middle is nearest to it at its end.
        let t = center.unwrap_or(span.1);
        Turn { t: self.passed.map_or(t, |passed| passed.max(t)), span, sigma, basis, arrived, scan }
    }
}

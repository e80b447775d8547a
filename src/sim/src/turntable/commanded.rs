//! A stage that goes where it is told, at once at full speed.

use super::scripted::StageState;
use core::f64::consts::TAU;
use tumbled_model::{RigNs, Span};

/// A stage that carries out moves. It has no mass: it is at its speed and at rest without ramps.
///
/// Instants must not go back; an earlier one counts as the latest.
#[derive(Clone, Debug)]
pub struct CommandedStage {
    fastest_rps: f64,
    since: RigNs,
    from_rad: f64,
    rate_rps: f64,
    /// Where the move ends, and when; `None`: it stands, or turns for ever.
    end: Option<(RigNs, f64)>,
    homing: bool,
    /// The table's angle where the counts are 0.
    zero_rad: f64,
    homed: bool,
}

impl CommandedStage {
    /// A stage that stands `angle_rad` from its reference and does not know it: counts are 0 here until it is homed.
    /// Moves go at `fastest_rps`, which must be above 0.
    pub fn new(angle_rad: f64, fastest_rps: f64) -> Self {
        Self {
            fastest_rps,
            since: RigNs(i64::MIN),
            from_rad: angle_rad,
            rate_rps: 0.0,
            end: None,
            homing: false,
            zero_rad: angle_rad,
            homed: false,
        }
    }

    /// The fastest it moves, rad/s.
    pub fn fastest_rps(&self) -> f64 {
        self.fastest_rps
    }

    /// Whether its counts are referred to the reference.
    pub fn homed(&self) -> bool {
        self.homed
    }

    /// Where the table is at an instant, from the reference.
    pub fn table(&mut self, t: RigNs) -> StageState {
        self.settle(t);
        let on_the_way = (t - self.since).as_secs_f64().max(0.0);
        let angle_rad = if self.rate_rps == 0.0 { self.from_rad } else { self.from_rad + self.rate_rps * on_the_way };
        StageState { angle_rad, rate_rps: self.rate_rps }
    }

    /// The same from where its counts are 0.
    pub fn counted(&mut self, t: RigNs) -> StageState {
        let table = self.table(t);
        StageState { angle_rad: table.angle_rad - self.zero_rad, ..table }
    }

    /// Goes to an angle of its counts.
    pub fn move_to(&mut self, t: RigNs, counted_rad: f64) {
        let zero_rad = self.zero_rad;
        self.go(t, counted_rad + zero_rad);
    }

    /// Goes to the reference, the shorter way, and counts from there.
    pub fn home(&mut self, t: RigNs) {
        let turns = (self.table(t).angle_rad / TAU).round();
        self.go(t, turns * TAU);
        self.homing = true;
        self.settle(t);
    }

    /// Turns for ever; at its fastest where it is asked for more. 0 stops it.
    pub fn spin(&mut self, t: RigNs, rate_rps: f64) {
        self.from_rad = self.table(t).angle_rad;
        self.since = self.since.max(t);
        self.rate_rps = rate_rps.clamp(-self.fastest_rps, self.fastest_rps);
        self.end = None;
        self.homing = false;
    }

    fn go(&mut self, t: RigNs, to_rad: f64) {
        let way = to_rad - self.table(t).angle_rad;
        self.spin(t, if way < 0.0 { -self.fastest_rps } else { self.fastest_rps });
        let duration = Span((way.abs() / self.fastest_rps * 1e9).round() as i64);
        self.end = Some((RigNs(self.since.0.saturating_add(duration.0)), to_rad));
        self.settle(t);
    }

    /// Ends a move that has ended by `t`.
    fn settle(&mut self, t: RigNs) {
        if let Some((end, to_rad)) = self.end.filter(|(end, _)| *end <= t) {
            (self.since, self.from_rad, self.rate_rps, self.end) = (end, to_rad, 0.0, None);
            if core::mem::take(&mut self.homing) {
                (self.zero_rad, self.homed) = (to_rad, true);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn s(seconds: f64) -> RigNs {
        RigNs((1e9 * seconds) as i64)
    }

    #[test]
    fn it_goes_where_it_is_told_and_counts_from_its_reference_once_homed() {
        let mut stage = CommandedStage::new(1.0, 0.5);
        assert_eq!((stage.counted(s(0.0)).angle_rad, stage.homed()), (0.0, false));
        stage.home(s(1.0));
        // 1 rad at 0.5 rad/s: at 2 s half way, at 3 s there.
        assert_eq!(stage.counted(s(2.0)), StageState { angle_rad: -0.5, rate_rps: -0.5 });
        assert_eq!((stage.counted(s(3.0)), stage.homed()), (StageState::default(), true));
        stage.move_to(s(4.0), 0.25);
        assert_eq!(stage.table(s(4.25)), StageState { angle_rad: 0.125, rate_rps: 0.5 });
        assert_eq!(stage.table(s(9.0)), StageState { angle_rad: 0.25, rate_rps: 0.0 });
        stage.spin(s(10.0), 2.0);
        stage.spin(s(12.0), 0.0);
        // 2 s at the fastest it can.
        assert_eq!(stage.table(s(13.0)), StageState { angle_rad: 1.25, rate_rps: 0.0 });
    }
}

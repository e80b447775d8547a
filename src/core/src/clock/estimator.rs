//! From pairs to the line that the device's clock is believed to be, and whether it is believed.

use super::hull::{LowerHull, Pair};
use super::kalman::MeanDelayFilter;
use super::kind::ClockParameters;
use super::line::Line;
use super::report::ClockMode;

const MS: i64 = 1_000_000;
const S: i64 = 1_000 * MS;

/// Data needed before a slope means anything, device time and pairs.
const ACQUISITION: i64 = 2 * S;
const ACQUISITION_PAIRS: usize = 10;
/// The window until there are 30 s of data.
const FIRST_WINDOW: i64 = 10 * S;
const FIRST_WINDOW_UNTIL: i64 = 30 * S;
/// How often the line is looked for while acquiring and after.
const ACQUIRING_PERIOD: i64 = 100 * MS;
const PERIOD: i64 = S;
/// No crystal is so far off: data sheets promise ≤ 100 ppm, the kernel slews the host by ≤ 500 ppm.
const MAX_SKEW: f64 = 500e-6;
/// So many lines in a row decide between locked and suspect.
const VERDICT_RUN: u32 = 3;
/// When nothing has been less than 100 ms late for 2 s the device's counter stood still or was set back a little.
const ASTRAY_DELAY: i64 = 100 * MS;
const ASTRAY_FOR: i64 = 2 * S;
/// The sigma of a locked line: the median of the lowest tenth of the pairs' heights above it.
const LOWEST_TENTH_MEDIAN: f64 = 0.05;
const MIN_SIGMA: i64 = 1_000;
/// How much earlier than the line a pair may be: it arrived before it was sent. Beyond, the counter was set forward.
const EARLY_LOCKED: i64 = 5 * MS;
const EARLY_OTHERWISE: i64 = S;

/// Whether the line is believed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Lock {
    Acquiring,
    Locked,
    /// The data ask for a skew that no crystal has; the line is the last believable one.
    Suspect,
}

/// What a pair led to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Found {
    Nothing,
    /// The line changed; take it at once (acquiring) or slew to it.
    Line {
        at_once: bool,
    },
    /// The device's counter fell behind for good: begin anew.
    Astray,
}

/// One epoch's estimate. Pairs are relative to the epoch's first, which is (0, 0).
#[derive(Clone, Debug)]
pub(super) struct Estimator {
    mode: ClockMode,
    parameters: &'static ClockParameters,
    hull: LowerHull,
    filter: MeanDelayFilter,
    group: Option<Pair>,
    group_len: u32,
    line: Line,
    sigma: i64,
    lock: Lock,
    verdict_run: u32,
    next_update: i64,
    least_delay: i64,
    astray_since: Option<i64>,
}

impl Estimator {
    pub(super) fn new(mode: ClockMode, parameters: &'static ClockParameters) -> Self {
        Self {
            mode,
            parameters,
            hull: LowerHull::new(),
            filter: MeanDelayFilter::new(parameters.arrival_sigma_ns, 0.0),
            group: None,
            group_len: 0,
            line: Line { x: 0, y: 0, slope: 0.0 },
            sigma: parameters.arrival_sigma_ns,
            lock: Lock::Acquiring,
            verdict_run: 0,
            next_update: 0,
            least_delay: i64::MAX,
            astray_since: None,
        }
    }

    /// Begins an epoch with its first pair, (0, 0). The skew stays: it is the same crystal.
    pub(super) fn begin(&mut self) {
        self.hull.clear();
        self.hull.push(Pair { x: 0, y: 0 });
        self.line = Line { x: 0, y: 0, slope: self.line.slope };
        self.filter = MeanDelayFilter::new(self.parameters.arrival_sigma_ns, self.line.slope);
        self.group = None;
        self.group_len = 0;
        self.sigma = self.parameters.arrival_sigma_ns;
        self.lock = Lock::Acquiring;
        self.verdict_run = 0;
        self.next_update = ACQUIRING_PERIOD;
        self.least_delay = i64::MAX;
        self.astray_since = None;
    }

    pub(super) fn line(&self) -> Line {
        self.line
    }

    pub(super) fn sigma(&self) -> i64 {
        self.sigma
    }

    pub(super) fn lock(&self) -> Lock {
        self.lock
    }

    /// Pairs in the window and the device time they span, ns.
    pub(super) fn window(&self) -> (usize, i64) {
        (self.hull.len(), self.hull.span())
    }

    /// Whether the pair would have arrived before it was sent.
    pub(super) fn too_early(&self, pair: Pair) -> bool {
        let limit = match (self.mode, self.lock) {
            (ClockMode::Hull, Lock::Locked) => EARLY_LOCKED,
            _ => EARLY_OTHERWISE,
        };
        self.delay(pair) < -limit
    }

    /// Takes a pair that is later than all before it.
    pub(super) fn push(&mut self, pair: Pair) -> Found {
        self.least_delay = self.least_delay.min(self.delay(pair));
        match self.mode {
            ClockMode::Hull => self.push_least_delayed(pair),
            ClockMode::Kalman => self.filter.push(pair),
            ClockMode::Arrival => {
                self.line = Line { x: pair.x, y: pair.y, slope: 0.0 };
                if pair.x >= ACQUISITION {
                    self.lock = Lock::Locked;
                }
                return Found::Line { at_once: true };
            }
        }
        if pair.x < self.next_update {
            return Found::Nothing;
        }
        if self.has_gone_astray(pair.x) {
            return Found::Astray;
        }
        self.update(pair.x)
    }

    fn delay(&self, pair: Pair) -> i64 {
        pair.y.saturating_sub(self.line.at(pair.x))
    }

    fn push_least_delayed(&mut self, pair: Pair) {
        if self.group.is_none_or(|least| pair.y < least.y) {
            self.group = Some(pair);
        }
        self.group_len += 1;
        if self.group_len >= self.parameters.decimation
            && let Some(least) = self.group.take()
        {
            self.hull.push(least);
            self.group_len = 0;
        }
    }

    fn has_gone_astray(&mut self, x: i64) -> bool {
        let late = self.least_delay > ASTRAY_DELAY;
        self.least_delay = i64::MAX;
        if !late {
            self.astray_since = None;
            return false;
        }
        x.saturating_sub(*self.astray_since.get_or_insert(x)) >= ASTRAY_FOR
    }

    fn update(&mut self, x: i64) -> Found {
        let Some(measured) = self.measure(x) else {
            self.next_update = x.saturating_add(ACQUIRING_PERIOD);
            return self.hold_lowest();
        };
        let period = if self.mode == ClockMode::Kalman { ACQUIRING_PERIOD } else { PERIOD };
        self.next_update = x.saturating_add(period);

        let believable = measured.slope.abs() <= MAX_SKEW;
        let at_once = self.lock == Lock::Acquiring;
        self.judge(believable);
        if self.lock != Lock::Locked {
            return if at_once { self.hold_lowest() } else { self.keep_previous() };
        }
        if !believable {
            return Found::Nothing;
        }
        self.line = measured;
        self.sigma = match self.mode {
            ClockMode::Kalman => self.filter.sigma_ns(),
            _ => self.hull.height_quantile(&measured, LOWEST_TENTH_MEDIAN),
        }
        .max(MIN_SIGMA);
        Found::Line { at_once }
    }

    /// The line that the data ask for; `None` while there are too few of them.
    fn measure(&mut self, x: i64) -> Option<Line> {
        if self.mode == ClockMode::Kalman {
            return (x >= ACQUISITION).then(|| self.filter.line());
        }
        let (pairs, span) = self.window();
        if self.lock == Lock::Acquiring && (span < ACQUISITION || pairs < ACQUISITION_PAIRS) {
            return None;
        }
        let window = if x < FIRST_WINDOW_UNTIL { FIRST_WINDOW } else { self.parameters.window_ns };
        self.hull.drop_before(x.saturating_sub(window));
        self.hull.middle_edge()
    }

    /// Locked at the first believable line; from then on three in a row change the verdict.
    fn judge(&mut self, believable: bool) {
        let agrees = match self.lock {
            Lock::Acquiring if believable => {
                self.lock = Lock::Locked;
                true
            }
            Lock::Acquiring => false,
            Lock::Locked => believable,
            Lock::Suspect => !believable,
        };
        self.verdict_run = if agrees { 0 } else { self.verdict_run + 1 };
        if self.verdict_run >= VERDICT_RUN {
            self.lock = if believable { Lock::Locked } else { Lock::Suspect };
            self.verdict_run = 0;
        }
    }

    /// Without a slope of its own: the last known slope under the lowest pair.
    fn hold_lowest(&mut self) -> Found {
        if let Some(lowest) = self.hull.support(self.line.slope) {
            self.sigma = self.hull.height_quantile(&lowest, 0.5).max(self.parameters.arrival_sigma_ns);
            self.line = lowest;
        }
        Found::Line { at_once: true }
    }

    /// Suspect: the previous line, with the scatter about it as its uncertainty.
    fn keep_previous(&mut self) -> Found {
        self.sigma = self.hull.height_quantile(&self.line, 0.5).max(self.sigma);
        Found::Nothing
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::DeviceClockKind;

    /// Feeds 30 Hz pairs from `from_s` to `to_s` with y(x); says what the last one led to.
    fn feed(estimator: &mut Estimator, from_s: i64, to_s: i64, y: impl Fn(i64) -> i64) -> Found {
        let mut found = Found::Nothing;
        for frame in from_s * 30 + 1..=to_s * 30 {
            let x = frame * S / 30;
            found = estimator.push(Pair { x, y: y(x) });
            if found == Found::Astray {
                break;
            }
        }
        found
    }

    fn kinect() -> Estimator {
        let mut estimator = Estimator::new(ClockMode::Hull, DeviceClockKind::Kinect.parameters());
        estimator.begin();
        estimator
    }

    #[test]
    fn two_seconds_lock_and_the_skew_is_the_slope() {
        let mut estimator = kinect();
        feed(&mut estimator, 0, 1, |x| x / 10_000);
        assert_eq!(estimator.lock(), Lock::Acquiring);
        feed(&mut estimator, 1, 3, |x| x / 10_000); // 100 ppm
        assert_eq!(estimator.lock(), Lock::Locked);
        assert!((estimator.line().slope - 100e-6).abs() < 1e-9);
    }

    #[test]
    fn an_impossible_skew_is_suspect_after_three_lines_and_keeps_the_previous() {
        let mut estimator = kinect();
        feed(&mut estimator, 0, 60, |_| 0);
        // 600 ppm from 60 s on: the hull of a window of 60 s asks for them when the middle has passed the bend, at 90 s.
        let bend = |x: i64| (x - 60 * S).max(0) * 6 / 10_000;
        feed(&mut estimator, 60, 89, bend);
        assert_eq!(estimator.lock(), Lock::Locked);
        feed(&mut estimator, 89, 94, bend);
        assert_eq!((estimator.lock(), estimator.line().slope), (Lock::Suspect, 0.0));
        // Level again from 94 s: the middle passes that bend at 124 s, and three lines later it is believed.
        feed(&mut estimator, 94, 129, |x| bend(x.min(94 * S)));
        assert_eq!(estimator.lock(), Lock::Locked);
    }

    #[test]
    fn stamps_that_stay_behind_begin_anew_and_a_short_stall_does_not() {
        let mut estimator = kinect();
        feed(&mut estimator, 0, 60, |_| 0);
        assert_ne!(feed(&mut estimator, 60, 61, |_| 300 * MS), Found::Astray);
        assert_ne!(feed(&mut estimator, 61, 63, |_| 0), Found::Astray);
        assert_eq!(feed(&mut estimator, 63, 68, |_| 300 * MS), Found::Astray);
    }
}

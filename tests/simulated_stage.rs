//! What the stage says on its line against where the target truly was: two files of one simulated session.

use tumbled_serial::log::LogEntry;
use tumbled_serial::zaber::{Heard, LineSettings, Listener, Sample};

use crate::support::Workbench;

const COUNTS_PER_TURN: f64 = 768_000.0;

/// The stage's answers, as a host makes them of the bytes.
fn heard(log: &str) -> Vec<Sample> {
    let mut listener = Listener::new(LineSettings::default());
    let mut heard = Vec::new();
    for line in log.lines() {
        let entry = LogEntry::parse(line).expect("a line of the log");
        listener.overheard(entry.at, &entry.bytes, &mut heard);
    }
    assert_eq!(listener.counts().lines.refused(), 0);
    let sample = |heard| if let Heard::Sample(sample) = heard { Some(sample) } else { None };
    heard.into_iter().filter_map(sample).collect()
}

/// Time, s, and angle about z, turns, of each line of the truth; not wrapped.
fn true_turns(truth: &str) -> Vec<(f64, f64)> {
    let mut turns: Vec<(f64, f64)> = Vec::new();
    for line in truth.lines().skip(1) {
        let cells: Vec<f64> = line.split(',').map(|cell| cell.parse().expect("a number")).collect();
        let (z, w) = (cells[7], cells[8]);
        let wrapped = 2.0 * z.atan2(w) / core::f64::consts::TAU;
        let before = turns.last().map_or(0.0, |(_, before)| *before);
        turns.push((1e-9 * cells[0], wrapped + (before - wrapped).round()));
    }
    turns
}

#[test]
fn the_serial_log_of_a_simulated_session_tells_the_angle_of_its_truth_to_a_count_and_the_lines_doubt() {
    let bench = Workbench::new();
    let done = bench.run(&["simulate", "turntable-20dps", "-o", "out", "--duration", "6s"]);
    assert_eq!(done.code, 0, "{}", done.stderr);
    let (samples, truth) = (heard(&bench.read("out/serial.log")), true_turns(&bench.read("out/truth.csv")));
    assert!(samples.len() > 280, "{}", samples.len());
    let mut off_by = Vec::new();
    for sample in &samples {
        // Between two lines of the truth, 10 ms apart; the rate is even.
        let t = 1e-9 * sample.at.0 as f64;
        let next = truth.partition_point(|(at, _)| *at <= t).clamp(1, truth.len() - 1);
        let ((t0, a0), (t1, a1)) = (truth[next - 1], truth[next]);
        let expected = COUNTS_PER_TURN * (a0 + (a1 - a0) * (t - t0) / (t1 - t0));
        let off = (sample.counts as f64 - expected).abs();
        // The angle is of some instant within the round trip: 20° a second is 42 667 counts a second.
        let doubt = 20.0 / 360.0 * COUNTS_PER_TURN * 1e-9 * sample.half_rtt.0 as f64;
        assert!(off <= doubt + 1.0, "{sample:?}: {off} counts off, doubt {doubt}");
        off_by.push(off);
    }
    off_by.sort_by(f64::total_cmp);
    // A request goes at once. A reply waits for the adapter's next look, 1 ms apart, 0.5 ms in the mean, and takes 0.3 ms
    // more on its way: the middle of the round trip is half of that, 0.4 ms or 17 counts, late.
    let (median, worst) = (off_by[off_by.len() / 2], off_by[off_by.len() - 1]);
    println!("{} samples; from the truth: {median:.2} counts in the median, {worst:.1} at most", off_by.len());
    assert!((10.0..25.0).contains(&median), "{median}");
}

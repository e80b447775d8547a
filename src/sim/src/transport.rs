//! From the sensor to the host: when what was sent at one instant is there.
//!
//! Delays have a least value and go only upwards from it, as on real lines: queueing and scheduling add, nothing
//! subtracts. The constants are assumptions of usual size: UDP on a quiet wire takes some tens of µs with a rare tail of ms,
//! USB some hundreds of µs with a tail of several ms.

use crate::noise::Noise;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_model::{RigNs, Span};

/// How a line delays.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Transport {
    /// What nothing is faster than, s.
    pub least_s: f64,
    /// Mean of each of the stages whose delays add up (each exponential, together a gamma distribution), s.
    pub stage_s: f64,
    /// How many stages.
    pub stages: u8,
    /// How often a host is busy with something else.
    pub tail_probability: f64,
    /// Mean of what that adds, s.
    pub tail_s: f64,
    /// The host looks only so often, s; 0: at once. What came between two looks is there at the later one.
    pub granularity_s: f64,
    /// Whether an item may overtake the one before it.
    pub reorders: bool,
}

impl Transport {
    /// UDP over a switch.
    pub const UDP: Self = Self {
        least_s: 60e-6,
        stage_s: 15e-6,
        stages: 3,
        tail_probability: 0.005,
        tail_s: 1.5e-3,
        granularity_s: 0.0,
        reorders: false,
    };

    /// A Kinect's isochronous transfers: sixteen packets make 2 ms (libfreenect), then a thread has to wake.
    ///
    /// Its items are sent when their last USB packet leaves, 30 ms after the first.
    pub const KINECT: Self = Self {
        least_s: 0.3e-3,
        stage_s: 0.15e-3,
        stages: 2,
        tail_probability: 0.01,
        tail_s: 5e-3,
        granularity_s: 2e-3,
        reorders: false,
    };

    /// Bytes through a USB serial adapter set to 1 ms.
    pub const SERIAL: Self = Self {
        least_s: 0.1e-3,
        stage_s: 0.1e-3,
        stages: 2,
        tail_probability: 0.005,
        tail_s: 2e-3,
        granularity_s: 1e-3,
        reorders: false,
    };

    /// What no item is faster than.
    pub fn least(&self) -> Span {
        Span(libm::round(self.least_s.max(0.0) * 1e9) as i64)
    }

    /// The delay of an item by itself, without the ones before it: the same for the same seed, line and index.
    pub fn delay(&self, line: &str, index: u64, seed: u64) -> Span {
        let mut noise = Noise::new(seed, line, index);
        let mut exponential = |mean_s: f64| -mean_s * libm::log(1.0 - noise.uniform());
        let mut delay_s = self.least_s.max(0.0);
        for _ in 0..self.stages {
            delay_s += exponential(self.stage_s.max(0.0));
        }
        let tail_s = exponential(self.tail_s.max(0.0));
        if noise.chance(self.tail_probability) {
            delay_s += tail_s;
        }
        Span(libm::round(delay_s * 1e9) as i64)
    }
}

/// One source's line to the host. Items are given in the order in which they were sent.
#[derive(Clone, Debug)]
pub struct Line {
    transport: Transport,
    name: String,
    seed: u64,
    index: u64,
    last: Option<RigNs>,
}

impl Line {
    /// The line of a sensor, from the `first` of its items on.
    pub fn new(transport: Transport, sensor: &str, first: u64, seed: u64) -> Self {
        Self { transport, name: format!("transport.{sensor}"), seed, index: first, last: None }
    }

    /// The next items, so many, are never sent.
    pub fn skip(&mut self, items: u64) {
        self.index = self.index.saturating_add(items);
    }

    /// When the host has the next item, which left the sensor at `sent`.
    pub fn arrive(&mut self, sent: RigNs) -> RigNs {
        let delayed = sent + self.transport.delay(&self.name, self.index, self.seed);
        self.index += 1;
        let look_ns = libm::round(self.transport.granularity_s * 1e9) as i64;
        let looked = if look_ns > 0 {
            RigNs(delayed.0.div_euclid(look_ns).saturating_add(1).saturating_mul(look_ns))
        } else {
            delayed
        };
        let arrived = match self.last {
            Some(last) if !self.transport.reorders => looked.max(last),
            _ => looked,
        };
        self.last = Some(arrived);
        arrived
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLAIN: Transport = Transport { tail_probability: 0.0, ..Transport::UDP };

    #[test]
    fn delays_have_a_least_value_and_the_mean_of_their_stages() {
        const N: u64 = 20_000;
        let delays: Vec<f64> = (0..N).map(|index| PLAIN.delay("a", index, 1).as_secs_f64()).collect();
        assert!(delays.iter().all(|delay| *delay >= 60e-6));
        // Mean 60 + 3 · 15 = 105 µs, standard error 15 √3 / √20000 = 0.18 µs.
        let mean = delays.iter().sum::<f64>() / N as f64;
        assert!((mean - 105e-6).abs() < 1e-6, "{mean}");
    }

    #[test]
    fn order_is_kept_unless_it_need_not_be() {
        let arrivals = |transport| {
            let mut line = Line::new(transport, "front", 0, 1);
            (0..5_000).map(|k| line.arrive(RigNs(k * 20_000))).collect::<Vec<_>>()
        };
        assert!(arrivals(Transport::UDP).is_sorted());
        assert!(!arrivals(Transport { reorders: true, ..Transport::UDP }).is_sorted());
        assert_eq!(arrivals(Transport::UDP), arrivals(Transport::UDP));
    }

    #[test]
    fn a_frame_is_there_at_the_hosts_next_look() {
        let mut line = Line::new(Transport::KINECT, "left", 0, 1);
        for k in 1..1_000 {
            let sent = RigNs(k * 33_333_333);
            let arrived = line.arrive(sent);
            assert!(arrived.0 % 2_000_000 == 0 && (arrived - sent).0 >= 300_000, "{arrived:?}");
        }
    }

    #[test]
    fn a_line_that_begins_later_has_the_delays_of_the_whole_one() {
        let transport = Transport { reorders: true, ..Transport::UDP };
        let mut whole = Line::new(transport, "front", 0, 3);
        let mut later = Line::new(transport, "front", 100, 3);
        let all: Vec<_> = (0..200).map(|k| whole.arrive(RigNs(k * 663_552))).collect();
        assert!((100..200).all(|k| later.arrive(RigNs(k * 663_552)) == all[k as usize]));
    }
}

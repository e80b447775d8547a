//! Devices with a known clock behind a transport with known delays, seeded.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use tumbled_core::clock::{ClockMode, ClockReport, ClockState, DeviceClock, DeviceClockKind, Pushed};
use tumbled_model::RigNs;

pub(crate) const MS: i64 = 1_000_000;
pub(crate) const S: i64 = 1_000 * MS;

/// How long data take beyond the least delay.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Delays {
    /// gamma(shape, scale µs) and, for 1 % of the data, an exponential tail of the given mean, µs.
    Gamma { shape: u32, scale_us: f64, tail_us: f64 },
    /// Fetched every 1 ms, then gamma(2, 100 µs) and a tail of 8 ms for 1 %.
    Polled,
}

/// UDP: gamma(3, 20 µs) + 1 % tail 2 ms.
pub(crate) const UDP: Delays = Delays::Gamma { shape: 3, scale_us: 20.0, tail_us: 2_000.0 };
/// USB: gamma(3, 250 µs) + 1 % tail 8 ms.
pub(crate) const USB: Delays = Delays::Gamma { shape: 3, scale_us: 250.0, tail_us: 8_000.0 };

/// How the device's rate differs from the host's.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Skew {
    /// Slow by so many ppm.
    Constant(f64),
    /// From 20 ppm on a random walk of 0.2 ppm/√s.
    WarmUp,
    /// So many ppm more every second.
    Ramp(f64),
}

/// A device and its way to the host.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Device {
    pub(crate) kind: DeviceClockKind,
    pub(crate) rate_hz: f64,
    pub(crate) delays: Delays,
    pub(crate) skew: Skew,
    pub(crate) least_delay_ns: i64,
    pub(crate) first_raw: u32,
}

/// A VLP-32C's data packets.
pub(crate) const LIDAR: Device = Device {
    kind: DeviceClockKind::Velodyne,
    rate_hz: 1_507.0,
    delays: UDP,
    skew: Skew::Constant(20.0),
    least_delay_ns: 60_000,
    first_raw: 1_000_000_000,
};

/// A Kinect's depth frames.
pub(crate) const CAMERA: Device = Device {
    kind: DeviceClockKind::Kinect,
    rate_hz: 30.0,
    delays: USB,
    skew: Skew::Constant(-35.0),
    least_delay_ns: 30 * MS,
    first_raw: 123_456_789,
};

/// One stamp as the host gets it, and when it was really made.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Sample {
    pub(crate) raw: u32,
    pub(crate) made: i64,
    pub(crate) arrived: i64,
}

struct Chance(ChaCha8Rng);

impl Chance {
    /// Uniform in (0, 1].
    fn uniform(&mut self) -> f64 {
        ((self.0.next_u64() >> 11) + 1) as f64 / (1u64 << 53) as f64
    }

    fn exponential(&mut self, mean: f64) -> f64 {
        -libm::log(self.uniform()) * mean
    }

    /// A sum of `shape` exponentials.
    fn gamma(&mut self, shape: u32, scale: f64) -> f64 {
        (0..shape).map(|_| self.exponential(scale)).sum()
    }

    fn normal(&mut self) -> f64 {
        let radius = libm::sqrt(-2.0 * libm::log(self.uniform()));
        radius * libm::cos(core::f64::consts::TAU * self.uniform())
    }
}

impl Device {
    /// Samples from `from_s` to `to_s` of true time. Order is kept on the way, as one socket or one USB pipe keeps it.
    pub(crate) fn samples(&self, from_s: i64, to_s: i64, seed: u64) -> Vec<Sample> {
        let mut chance = Chance(ChaCha8Rng::seed_from_u64(seed));
        let parameters = self.kind.parameters();
        let dt = 1.0 / self.rate_hz;
        let mut ppm = match self.skew {
            Skew::Constant(ppm) => ppm,
            Skew::WarmUp => 20.0,
            Skew::Ramp(_) => 0.0,
        };
        // What the device's clock has lost against the true one, s.
        let mut lost = 0.0;
        let mut newest_arrival = i64::MIN;
        let mut samples = Vec::new();
        for index in 0..((to_s - from_s) as f64 * self.rate_hz) as i64 {
            // The device keeps its rate by its own clock.
            let seconds = index as f64 * dt;
            let made = from_s * S + ((seconds + lost) * 1e9) as i64;
            let ticks = (seconds * parameters.hz as f64) as i64;
            let raw = (i64::from(self.first_raw) + ticks).rem_euclid(parameters.wrap) as u32;
            let delay = self.least_delay_ns + self.delay_ns(made, &mut chance);
            newest_arrival = newest_arrival.max(made + delay);
            samples.push(Sample { raw, made, arrived: newest_arrival });

            lost += ppm * 1e-6 * dt;
            match self.skew {
                Skew::Constant(_) => {}
                Skew::WarmUp => ppm += 0.2 * libm::sqrt(dt) * chance.normal(),
                Skew::Ramp(per_second) => ppm += per_second * dt,
            }
        }
        samples
    }

    fn delay_ns(&self, made: i64, chance: &mut Chance) -> i64 {
        let tail =
            |chance: &mut Chance, mean: f64| if chance.uniform() <= 0.01 { chance.exponential(mean) } else { 0.0 };
        match self.delays {
            Delays::Gamma { shape, scale_us, tail_us } => {
                ((chance.gamma(shape, scale_us) + tail(chance, tail_us)) * 1e3) as i64
            }
            Delays::Polled => {
                let wait = MS - made.rem_euclid(MS);
                wait + ((chance.gamma(2, 100.0) + tail(chance, 8_000.0)) * 1e3) as i64
            }
        }
    }
}

/// What became of one sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Outcome {
    pub(crate) pushed: Pushed,
    pub(crate) made: i64,
    pub(crate) t: Option<i64>,
    pub(crate) sigma: i64,
    pub(crate) state: ClockState,
    /// t − made − least delay; 0 where there is no t.
    pub(crate) error: i64,
}

/// Pushes and maps each sample.
pub(crate) fn run(clock: &mut DeviceClock, samples: &[Sample], least_delay_ns: i64) -> Vec<Outcome> {
    let outcome = |sample: &Sample| {
        let pushed = clock.push(sample.raw, RigNs(sample.arrived));
        let mapped = if pushed == Pushed::Doubtful { None } else { clock.map(sample.raw) };
        Outcome {
            pushed,
            made: sample.made,
            t: mapped.map(|mapped| mapped.t.0),
            sigma: mapped.map_or(0, |mapped| mapped.sigma.0),
            state: mapped.map_or(ClockState::Lost, |mapped| mapped.state),
            error: mapped.map_or(0, |mapped| mapped.t.0 - sample.made - least_delay_ns),
        }
    };
    samples.iter().map(outcome).collect()
}

/// A fresh clock's outcomes and its report at the last arrival.
pub(crate) fn run_fresh(device: &Device, mode: ClockMode, samples: &[Sample]) -> (Vec<Outcome>, ClockReport) {
    let mut clock = DeviceClock::new(device.kind, mode);
    let outcomes = run(&mut clock, samples, device.least_delay_ns);
    (outcomes, clock.report(RigNs(samples.last().map_or(0, |last| last.arrived))))
}

/// The outcomes whose samples were made at or after `from_s`.
pub(crate) fn since(outcomes: &[Outcome], from_s: i64) -> &[Outcome] {
    outcomes.get(outcomes.partition_point(|outcome| outcome.made < from_s * S)..).expect("within")
}

/// Largest |error|, ns.
pub(crate) fn worst(outcomes: &[Outcome]) -> i64 {
    outcomes.iter().map(|outcome| outcome.error.abs()).max().expect("not empty")
}

/// In the order pushed, the times never fall; overtaken packets are earlier by nature.
pub(crate) fn never_falls(outcomes: &[Outcome]) -> bool {
    let in_order = outcomes.iter().filter(|outcome| outcome.pushed != Pushed::Reordered);
    in_order.filter_map(|outcome| outcome.t).is_sorted()
}

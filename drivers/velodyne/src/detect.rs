//! Which model sends these packets: the product byte, checked against the packet period.
//!
//! The byte is not always true: a VLP-16 with firmware before 3.0.29 calls itself an HDL-32E (seen on real captures).
//! The period between packets does not lie: it follows from the firing cycle.

use crate::models::{Model, Product, ReturnMode};
use crate::wire::{BLOCKS, DataPacket, FLAG_LOWER};

/// Block flags of a VLS-128's third and fourth bank, which no sensor decoded here sends.
const FLAGS_VLS128: [u16; 2] = [0xCCFF, 0xBBFF];

/// What a packet itself says it is. The HDL-64E sends no product byte (its bytes 1204 and 1205 count through
/// status values), but it alone of the models here uses the flag of the lower bank.
pub fn claimed_product(packet: &DataPacket<'_>) -> Product {
    let flags = packet.flags();
    if flags.iter().any(|flag| FLAGS_VLS128.contains(flag)) {
        Product::Unsupported("VLS-128")
    } else if flags.contains(&FLAG_LOWER) {
        Product::Supported(Model::Hdl64e)
    } else {
        Product::from_byte(packet.product_byte())
    }
}

/// Time between two packets of a model in a return mode, ns; `None` for the HDL-64E, which has several.
pub fn packet_period_ns(model: Model, mode: ReturnMode) -> Option<i64> {
    let spec = model.spec()?;
    let cycles_per_block = 32 / spec.elevation_deg.len().clamp(1, 32) as i64;
    Some(i64::from(spec.cycle_ns) * cycles_per_block * BLOCKS as i64 / mode.blocks_per_firing() as i64)
}

/// A packet period that does not belong to the model the packets claim.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PeriodMismatch {
    /// The model decoded as.
    pub claimed: Model,
    /// The period that model would have, ns.
    pub expected_ns: i64,
    /// The shortest step between consecutive stamps, ns.
    pub measured_ns: i64,
    /// A model that has the measured period in the same return mode.
    pub fits: Option<Model>,
}

impl core::fmt::Display for PeriodMismatch {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(
            f,
            "decoded as {}, but the packets come every {:.1} µs instead of {:.1} µs",
            self.claimed,
            self.measured_ns as f64 / 1e3,
            self.expected_ns as f64 / 1e3
        )?;
        match self.fits {
            Some(model) => write!(f, ", the period of {model}: if it is one, set lidar.model={model}"),
            None => write!(f, ": which model is it? Set lidar.model"),
        }
    }
}

/// Compares the steps between stamps with what the model would have.
///
/// Loss makes a step a whole multiple of the period, so the shortest step that comes again and again is either the
/// model's or another model's. (Periods that are multiples of each other, a VLP-16's of a VLP-32C's, cannot be told from
/// steady loss this way.) A single short step is a clock being set, or two sensors on one port, and no period.
#[derive(Clone, Copy, Debug, Default)]
pub struct PeriodCheck {
    steps_ns: [i64; STEPS],
    taken: usize,
    verdict: Option<PeriodMismatch>,
}

/// Steps looked at before a verdict: 20 ms of packets.
const STEPS: usize = 16;
/// So many of them must agree on a period.
const AGREEING: usize = 4;

impl PeriodCheck {
    /// Takes one step between the stamps of packets that arrived one after the other, and says once, when it is
    /// known, that the period is another model's.
    pub fn step(&mut self, step_ns: i64, model: Model, mode: ReturnMode) -> Option<PeriodMismatch> {
        if step_ns <= 0 {
            return None;
        }
        *self.steps_ns.get_mut(self.taken)? = step_ns;
        self.taken += 1;
        if self.taken < STEPS {
            return None;
        }
        let expected_ns = packet_period_ns(model, mode)?;
        let measured_ns = self.recurring_ns()?;
        let periods = ((measured_ns + expected_ns / 2) / expected_ns).max(1);
        if near(measured_ns, periods * expected_ns) {
            return None;
        }
        let fits = Model::ALL
            .into_iter()
            .filter(|other| *other != model)
            .find(|other| packet_period_ns(*other, mode).is_some_and(|period| near(measured_ns, period)));
        self.verdict = Some(PeriodMismatch { claimed: model, expected_ns, measured_ns, fits });
        self.verdict
    }

    /// The shortest step that enough others agree with.
    fn recurring_ns(&self) -> Option<i64> {
        let agreeing = |step: i64| self.steps_ns.iter().filter(|other| near(**other, step)).count();
        self.steps_ns.iter().copied().filter(|step| agreeing(*step) >= AGREEING).min()
    }

    /// The mismatch found, if there is one.
    pub fn mismatch(&self) -> Option<PeriodMismatch> {
        self.verdict
    }
}

/// Within 2 %: stamps jitter by 1 µs of 276 µs at least, and the models' periods are 17 % apart.
fn near(a: i64, b: i64) -> bool {
    (a - b).abs() * 50 < b
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn periods_are_the_manuals() {
        let period = |model| packet_period_ns(model, ReturnMode::Strongest);
        assert_eq!(period(Model::Vlp16), Some(1_327_104));
        assert_eq!(period(Model::Vlp32c), Some(663_552));
        assert_eq!(period(Model::Hdl32e), Some(552_960));
        assert_eq!(packet_period_ns(Model::Vlp16, ReturnMode::Dual), Some(663_552));
        assert_eq!(period(Model::Hdl64e), None);
    }

    #[test]
    fn an_old_vlp16_that_says_hdl32e_is_found_out_in_spite_of_loss() {
        let mut check = PeriodCheck::default();
        let mut verdict = None;
        for k in 0..16 {
            let step = if k % 3 == 0 { 2_654_000 } else { 1_327_000 };
            verdict = verdict.or(check.step(step, Model::Hdl32e, ReturnMode::Strongest));
        }
        let mismatch = verdict.expect("1327 µs is not 553 µs");
        assert_eq!((mismatch.measured_ns, mismatch.fits), (1_327_000, Some(Model::Vlp16)));
        assert!(mismatch.to_string().contains("lidar.model=vlp-16"), "{mismatch}");
    }

    #[test]
    fn one_short_step_is_no_period() {
        let mut check = PeriodCheck::default();
        for k in 0..16 {
            let step = if k == 8 { 263_552 } else { 663_552 };
            assert_eq!(check.step(step, Model::Vlp32c, ReturnMode::Strongest), None);
        }
        assert_eq!(check.mismatch(), None);
    }

    #[test]
    fn a_true_hdl32e_is_believed() {
        let mut check = PeriodCheck::default();
        for k in 0..100 {
            assert_eq!(check.step(552_000 + k % 2 * 1_000, Model::Hdl32e, ReturnMode::Strongest), None);
        }
    }
}

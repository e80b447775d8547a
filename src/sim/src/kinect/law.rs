//! The factory depth law, as the simulated device's.
//!
//! Its numbers are written here once more and not taken from the decoder: a decoder that had them wrong must not be
//! confirmed by its own simulator.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// z = 1 / (step · (pole − d)): depth is the reciprocal of an affine disparity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DepthLaw {
    /// The depth of one disparity step at 1 m, 1/m. Factory: 2.894444e-3.
    pub step_per_m: f64,
    /// The disparity of infinity. Factory: 1089.408.
    pub pole: f64,
}

impl Default for DepthLaw {
    /// The factory zero plane written out (b = 7.5 cm, Z₀ = 120 cm, p = 0.1042 cm, S = 200): p/(4·Z₀·b) per cm, and
    /// 4·(b/p + S + 0.375).
    fn default() -> Self {
        Self { step_per_m: 2.894_444e-3, pole: 1_089.408 }
    }
}

impl DepthLaw {
    /// The disparity, not rounded, of a depth in metres.
    pub fn disparity(&self, metres: f64) -> f64 {
        self.pole - 1.0 / (self.step_per_m * metres)
    }

    /// Depth in metres of a disparity; not positive at and past the pole.
    pub fn metres(&self, disparity: f64) -> f64 {
        1.0 / (self.step_per_m * (self.pole - disparity))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_law_is_the_factory_table() {
        // Rows of the published table, millimetres cut off.
        for (code, mm) in [(300.0, 437), (500.0, 586), (700.0, 887), (900.0, 1_824), (1_000.0, 3_864)] {
            assert_eq!((1e3 * DepthLaw::default().metres(code)) as u32, mm, "raw {code}");
        }
    }
}

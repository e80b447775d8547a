//! When a sensor measures, against a turntable's encoder.
//!
//! Sign: an offset is positive where the stamps are late, measurement time = stamp − offset. A state whose time is late by δ
//! shows the target where it was δ ago: φ = angle of the state − angle of the encoder = φ_0 − ω δ.
//!
//! * [`phase()`]: the mean of φ over whole turns at several rates, both ways; its slope over the rate is −δ;
//! * [`correlation`]: how a rate that changes appears in both.

pub mod correlation;
pub mod phase;
mod runs;

pub use correlation::{Correlated, NoCorrelation, correlate};
pub use phase::{NoPhase, Phase, PhaseRun, phase};

/// What a sensor's states and the encoder say of one time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedAngle {
    /// s, any zero.
    pub t_s: f64,
    /// The encoder's angle, rad, not wrapped.
    pub encoder_rad: f64,
    /// The state's angle about the stage's axis, in the encoder's sense, rad, any whole turns off.
    pub state_rad: f64,
}

/// What a standard deviation of a few degrees of freedom is multiplied by, so that three of it mean what they say: that of
/// Student's distribution; of two and fewer, which has none, that of three is doubled.
fn student(freedom: usize) -> f64 {
    match freedom {
        0..=2 => 2.0 * 3.0_f64.sqrt(),
        n => (n as f64 / (n as f64 - 2.0)).sqrt(),
    }
}

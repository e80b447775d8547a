//! The filter against seeded truths: whether its covariance can be believed, what it survives, how well it knows a spin.

mod chance;
mod consistency;
mod late;
mod robustness;
mod spin;
mod truth;

//! Calibrations of made views.

mod board;
mod made;
mod sphere;
mod turned;

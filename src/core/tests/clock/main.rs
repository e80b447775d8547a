//! The clock mapper against seeded clocks and delays whose truth is known.

mod accuracy;
mod capture;
mod generator;
mod incidents;
mod properties;
mod states;

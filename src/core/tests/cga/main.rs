//! Conformal geometric algebra against a general multivector product, and against ordinary geometry.

mod alignment;
mod anchored;
mod arbitrary;
mod motors;
mod multivector;
mod neighbourhoods;
mod table;

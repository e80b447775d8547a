//! Frames of a turning body registered to the model they make.

mod beams;
mod body;
mod chance;
mod fits;
mod revolution;

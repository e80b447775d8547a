//! The published method as we read it, and the methods it is compared with, on rendered views of one body.

mod default;
mod descriptor;
mod iterated;
mod paper;
mod scene;

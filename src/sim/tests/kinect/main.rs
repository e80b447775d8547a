//! The simulated Kinect, measured the way the real one was.

mod artefacts;
mod noise;
mod scenes;
mod sight;
mod stream;

//! Kinect v1 raw depth to metres and points and back.

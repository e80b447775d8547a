//! Velodyne packets to points and back.

//! A Kinect as a supervised source: what goes into the ledger, and how it ends, whatever happens to the device.
//!
//! Which USB library is loaded is decided when a program starts, so each test runs this binary again as a child, with the
//! environment that decides it: `recorded` on the player of recorded frames, `plugged` on the real libfreenect with a stand-in
//! for libusb under it. The child is the ignored test below.

mod child;
mod plugged;
mod recorded;

/// The part of the other tests that runs in a process of its own.
#[test]
#[ignore = "a part of the other tests"]
fn child() {
    child::run();
}

//! Which Kinect, and what of it.

use core::time::Duration;

/// Which Kinect to open, what to switch on besides its depth camera, and how long it may take.
#[derive(Clone, Debug, PartialEq)]
pub struct Options {
    /// The camera's serial number; `None`: the only Kinect there is. Models 1473 and Kinect for Windows report sixteen
    /// zeros there, and the library takes the serial number of their microphones instead.
    pub serial: Option<String>,
    /// How long opening may take; a healthy device takes less than a second.
    pub open_within: Duration,
    /// How long a running stream may be silent before it counts as failed.
    pub frame_within: Duration,
    /// Turn the tilt motor to this angle above the horizon, degrees, -31 to 31; `None` leaves the motor alone.
    pub tilt_deg: Option<f64>,
    /// Set the lamp; `None` leaves it alone.
    pub led: Option<Led>,
    /// Read the accelerometer this often; `None`: never. Each reading is a control transfer of a millisecond or more on the
    /// thread that receives the frames: once a second is plenty.
    pub accelerometer: Option<Duration>,
}

impl Default for Options {
    /// The only Kinect, its depth camera alone, 5 s to open, 2 s to the next frame.
    fn default() -> Self {
        Self {
            serial: None,
            open_within: Duration::from_secs(5),
            frame_within: Duration::from_secs(2),
            tilt_deg: None,
            led: None,
            accelerometer: None,
        }
    }
}

impl Options {
    /// Whether anything of the motor's USB device is asked for: tilt, lamp and accelerometer hang on it.
    pub fn wants_motor(&self) -> bool {
        self.tilt_deg.is_some() || self.led.is_some() || self.accelerometer.is_some()
    }
}

/// What the lamp shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Led {
    /// Dark.
    Off,
    /// Green.
    Green,
    /// Red.
    Red,
    /// Yellow.
    Yellow,
    /// Green, blinking.
    BlinkGreen,
    /// Red and yellow in turn.
    BlinkRedYellow,
}

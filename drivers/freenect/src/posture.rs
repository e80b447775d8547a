//! Tilt, lamp and accelerometer: only when configured.
//!
//! They hang on the motor's USB device (on model 1473 and Kinect for Windows on the microphones', which needs firmware that is
//! not here), so a rig that needs none of them does not open it.

use crate::library::Device;
use crate::options::{Led, Options};
use freenect_sys as ffi;

/// What the accelerometer read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Acceleration {
    /// Specific force along x, y, z of the Kinect's base, m/s²: at rest it points up, with 9.81.
    pub metres_per_s2: [f64; 3],
    /// The motor's angle above the horizon, degrees; `None` while it moves.
    pub tilt_deg: Option<f64>,
}

/// The reading of a motor that moves.
const MOVING: i8 = -128;

/// Sets what is configured; the step that failed, if one did.
pub(crate) fn apply(device: &Device<'_>, options: &Options) -> Option<&'static str> {
    let handle = device.handle();
    if let Some(degrees) = options.tilt_deg {
        let degrees = degrees.clamp(-31.0, 31.0);
        // SAFETY: the device is open, on the thread that owns it; the call takes a number.
        if unsafe { ffi::freenect_set_tilt_degs(handle, degrees) } < 0 {
            return Some("turning the tilt motor");
        }
    }
    if let Some(led) = options.led {
        // SAFETY: as above; the number is one of the header's.
        if unsafe { ffi::freenect_set_led(handle, code(led)) } < 0 {
            return Some("setting the lamp");
        }
    }
    if options.accelerometer.is_some() && read(device).is_none() {
        return Some("reading the accelerometer");
    }
    None
}

/// Asks the accelerometer; `None` when it does not answer. Takes a millisecond or more.
pub(crate) fn read(device: &Device<'_>) -> Option<Acceleration> {
    let handle = device.handle();
    // SAFETY: the device is open, on the thread that owns it.
    if unsafe { ffi::freenect_update_tilt_state(handle) } < 0 {
        return None;
    }
    // SAFETY: as above; the state it returns belongs to the open device.
    let state = unsafe { ffi::freenect_get_tilt_state(handle) };
    if state.is_null() {
        return None;
    }
    let [mut x, mut y, mut z] = [0.0; 3];
    // SAFETY: `state` is not null and belongs to the device, which stays open during these calls; the three places live here.
    let (angle, degrees) = unsafe {
        ffi::freenect_get_mks_accel(state, &mut x, &mut y, &mut z);
        ((*state).tilt_angle, ffi::freenect_get_tilt_degs(state))
    };
    Some(Acceleration { metres_per_s2: [x, y, z], tilt_deg: (angle != MOVING).then_some(degrees) })
}

fn code(led: Led) -> ffi::freenect_led_options {
    match led {
        Led::Off => ffi::freenect_led_options_LED_OFF,
        Led::Green => ffi::freenect_led_options_LED_GREEN,
        Led::Red => ffi::freenect_led_options_LED_RED,
        Led::Yellow => ffi::freenect_led_options_LED_YELLOW,
        Led::BlinkGreen => ffi::freenect_led_options_LED_BLINK_GREEN,
        Led::BlinkRedYellow => ffi::freenect_led_options_LED_BLINK_RED_YELLOW,
    }
}

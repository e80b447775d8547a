//! Opening devices, and holding their interfaces.

use std::ffi::{c_int, c_uchar, c_void};

use fake_libusb_control::script::Model;
use fake_libusb_control::{Audio, Busy};

use super::{guarded, in_world, key, pointer};
use crate::abi::error;
use crate::kinect::{Kinect, Part};
use crate::world::{World, lock, wake};

/// # Safety
/// As libusb's: `handle` may be written to.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn libusb_open(device: *mut c_void, handle: *mut *mut c_void) -> c_int {
    in_world(|world| {
        let device = key(device);
        let listed = world.devices.get(&device).ok_or(error::INVALID_PARAM)?;
        let (kinect, part, plug) = (listed.kinect, listed.part, listed.plug);
        if !world.is_there(kinect, plug) {
            return Err(error::NO_DEVICE);
        }
        if world.kinects.get(kinect).is_some_and(|kinect| kinect.is_forbidden) {
            world.journal("refuse", format_args!("device={kinect} what={part:?} open: no permission"));
            return Err(error::ACCESS);
        }
        let key = world.add_handle(device).map_err(|_no_descriptor| error::IO)?;
        world.journal("open", format_args!("device={kinect} what={part:?} handle={key:#x}"));
        // SAFETY: the caller's promise.
        unsafe { *handle = pointer(key) };
        Ok(0)
    })
}

/// Closes a device; transfers that are still in flight are an error of the caller.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn libusb_close(handle: *mut c_void) {
    in_world(|world| {
        let key = key(handle);
        let Some(closed) = world.handles.remove(&key) else {
            world.journal("error", format_args!("close of handle {key:#x}, which is not open"));
            return Ok(0);
        };
        let (kinect, part) = (closed.kinect, closed.part);
        let mut flying = 0;
        for (&transfer, allocated) in &mut world.transfers {
            if let Some((kinect, stream, owner)) = allocated.place
                && owner == key
                && let Some(kinect) = world.kinects.get_mut(kinect)
            {
                kinect.forget(stream, transfer);
                allocated.place = None;
                flying += 1;
            }
        }
        if flying > 0 {
            world.journal("error", format_args!("close of handle {key:#x} with {flying} transfers in flight"));
        }
        if !closed.claimed.is_empty() && world.is_there(kinect, closed.plug) {
            released(world, kinect, part);
        }
        world.journal("close", format_args!("device={kinect} what={part:?} handle={key:#x}"));
        world.unlist(closed.device);
        Ok(0)
    });
}

/// # Safety
/// As libusb's: `data` holds `length` bytes.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn libusb_get_string_descriptor_ascii(
    handle: *mut c_void,
    index: u8,
    data: *mut c_uchar,
    length: c_int,
) -> c_int {
    in_world(|world| {
        let (kinect, part, _) = world.behind(key(handle), "string descriptor").ok_or(error::NO_DEVICE)?;
        let text = match index {
            1 => "Microsoft".to_owned(),
            2 => format!("Xbox NUI {part:?}"),
            3 => serial(kinect, part),
            _ => return Err(error::INVALID_PARAM),
        };
        let room = usize::try_from(length).unwrap_or(0).checked_sub(1).ok_or(error::INVALID_PARAM)?;
        let length = text.len().min(room);
        // SAFETY: `length` and the zero after it are at most what the caller says there is room for.
        unsafe {
            std::ptr::copy_nonoverlapping(text.as_ptr(), data, length);
            *data.add(length) = 0;
        }
        c_int::try_from(length).map_err(|_overflow| error::OTHER)
    })
}

/// The later models' cameras have none of their own.
fn serial(kinect: &Kinect, part: Part) -> String {
    if part == Part::Camera && kinect.device.model != Model::Xbox1414 {
        return "0".repeat(16);
    }
    kinect.device.serial.clone()
}

/// How many interfaces a part has.
fn interfaces(kinect: &Kinect, part: Part) -> c_int {
    if part == Part::Audio && kinect.device.audio == Audio::Ready { 2 } else { 1 }
}

/// Claims an interface, unless a driver or another handle has it.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn libusb_claim_interface(handle: *mut c_void, number: c_int) -> c_int {
    in_world(|world| {
        let handle = key(handle);
        let (kinect, part, _) = world.behind(handle, "claim").ok_or(error::NO_DEVICE)?;
        let device = kinect.number;
        let refused = match kinect.busy.filter(|_| part == Part::Camera) {
            _ if number < 0 || number >= interfaces(kinect, part) => Some(error::NOT_FOUND),
            Some(Busy::Taken) => Some(error::BUSY),
            Some(Busy::NotFound) => Some(error::NOT_FOUND),
            None if part == Part::Camera && kinect.is_driven => Some(error::BUSY),
            None => None,
        };
        let plug = kinect.plug;
        let others = world
            .handles
            .iter()
            .filter(|(other, open)| **other != handle && (open.kinect, open.part, open.plug) == (device, part, plug));
        let taken = others.filter(|(_, open)| open.claimed.contains(&number)).count() > 0;
        if let Some(number) = refused.or(taken.then_some(error::BUSY)) {
            world.journal("refuse", format_args!("device={device} what={part:?} claim: {number}"));
            return Err(number);
        }
        if let Some(open) = world.handles.get_mut(&handle) {
            open.claimed.insert(number);
        }
        if part == Part::Camera
            && let Some(kinect) = world.kinects.get_mut(device)
        {
            kinect.reopened();
        }
        world.journal("claim", format_args!("device={device} what={part:?} interface={number} handle={handle:#x}"));
        Ok(0)
    })
}

/// Gives an interface back.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn libusb_release_interface(handle: *mut c_void, number: c_int) -> c_int {
    in_world(|world| {
        let handle = key(handle);
        let there = world.behind(handle, "release").map(|(kinect, part, _)| (kinect.number, part));
        let open = world.handles.get_mut(&handle).ok_or(error::NO_DEVICE)?;
        let was_claimed = open.claimed.remove(&number);
        let (device, part) = there.ok_or(error::NO_DEVICE)?;
        if !was_claimed {
            return Err(error::NOT_FOUND);
        }
        released(world, device, part);
        world.journal("release", format_args!("device={device} what={part:?} interface={number}"));
        Ok(0)
    })
}

/// The kernel chooses an interface's first setting again when nobody holds it.
fn released(world: &mut World, kinect: usize, part: Part) {
    if part == Part::Camera
        && let Some(kinect) = world.kinects.get_mut(kinect)
    {
        kinect.alternate = 0;
    }
}

/// Chooses a setting of a claimed interface.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn libusb_set_interface_alt_setting(handle: *mut c_void, number: c_int, setting: c_int) -> c_int {
    in_world(|world| {
        let key = key(handle);
        let claimed = world.handles.get(&key).is_some_and(|open| open.claimed.contains(&number));
        let (kinect, part, _) = world.behind(key, "alternate setting").ok_or(error::NO_DEVICE)?;
        let settings = if part == Part::Camera && kinect.device.model == Model::Windows { 2 } else { 1 };
        if !claimed || setting < 0 || setting >= settings {
            return Err(error::NOT_FOUND);
        }
        if part == Part::Camera {
            kinect.alternate = setting;
        }
        let device = kinect.number;
        world.journal("setting", format_args!("device={device} what={part:?} interface={number} setting={setting}"));
        Ok(0)
    })
}

/// Whether the kernel's driver holds the camera.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn libusb_kernel_driver_active(handle: *mut c_void, _number: c_int) -> c_int {
    in_world(|world| {
        let (kinect, part, _) = world.behind(key(handle), "kernel driver").ok_or(error::NO_DEVICE)?;
        Ok(c_int::from(part == Part::Camera && kinect.is_driven))
    })
}

/// Takes the camera from the kernel's driver.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn libusb_detach_kernel_driver(handle: *mut c_void, _number: c_int) -> c_int {
    drive(key(handle), false)
}

/// Gives the camera back to the kernel's driver.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn libusb_attach_kernel_driver(handle: *mut c_void, _number: c_int) -> c_int {
    drive(key(handle), true)
}

fn drive(handle: usize, attach: bool) -> c_int {
    in_world(|world| {
        let (kinect, part, _) = world.behind(handle, "kernel driver").ok_or(error::NO_DEVICE)?;
        if part != Part::Camera || !kinect.has_driver || kinect.is_driven == attach {
            return Err(error::NOT_FOUND);
        }
        kinect.is_driven = attach;
        let device = kinect.number;
        world.journal(if attach { "attach" } else { "detach" }, format_args!("device={device} what={part:?}"));
        Ok(0)
    })
}

/// Resets a device; the camera forgets its registers, and its firmware recovers.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn libusb_reset_device(handle: *mut c_void) -> c_int {
    let result = in_world(|world| {
        let (kinect, part, chronicle) = world.behind(key(handle), "reset").ok_or(error::NO_DEVICE)?;
        if part == Part::Camera {
            kinect.reset(chronicle);
        }
        let device = kinect.number;
        world.journal("reset", format_args!("device={device} what={part:?}"));
        Ok(0)
    });
    wake();
    result
}

/// The context of a handle.
pub(super) fn context_of(handle: *mut c_void) -> Option<usize> {
    guarded(None, || lock().as_ref().and_then(|world| world.handles.get(&key(handle)).map(|open| open.context)))
}

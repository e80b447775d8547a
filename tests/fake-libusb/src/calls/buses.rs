//! Contexts, the list of devices, and what devices say of themselves.

use std::ffi::{c_int, c_uchar, c_void};
use std::ptr::null_mut;

use fake_libusb_control::{Audio, script::Model};

use super::{guarded, in_world, key, pointer};
use crate::abi::{ConfigDescriptor, DeviceDescriptor, error};
use crate::kinect::{Kinect, Part};
use crate::world::{World, lock};

/// Begins with the first call: reads the script.
///
/// # Safety
/// As libusb's: `context` is null or may be written to.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn libusb_init(context: *mut *mut c_void) -> c_int {
    guarded(error::OTHER, || {
        let mut guard = lock();
        let world = match &mut *guard {
            Some(world) => world,
            empty => match World::create() {
                Ok(world) => empty.insert(world),
                Err(reason) => {
                    eprintln!("fake-libusb: {reason}");
                    return error::OTHER;
                }
            },
        };
        match begin(world, context.is_null()) {
            Ok(key) => {
                if !context.is_null() {
                    // SAFETY: the caller's promise.
                    unsafe { *context = pointer(key) };
                }
                0
            }
            Err(reason) => {
                eprintln!("fake-libusb: {reason}");
                error::OTHER
            }
        }
    })
}

/// Makes a context, or takes the default one once more.
fn begin(world: &mut World, default: bool) -> std::io::Result<usize> {
    if default && let Some((key, count)) = &mut world.default_context {
        *count += 1;
        return Ok(*key);
    }
    let key = world.add_context()?;
    if default {
        world.default_context = Some((key, 1));
    }
    world.journal("init", format_args!("context={key:#x}"));
    Ok(key)
}

/// Ends a context, and writes down what it left behind.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn libusb_exit(context: *mut c_void) {
    in_world(|world| {
        let key = world.context(key(context)).ok_or(0)?;
        if let Some((default, count)) = &mut world.default_context
            && *default == key
        {
            *count -= 1;
            if *count > 0 {
                return Ok(0);
            }
            world.default_context = None;
        }
        let status = world.status();
        world.journal("exit", format_args!("context={key:#x} {status}"));
        world.contexts.remove(&key);
        Ok(0)
    });
}

/// # Safety
/// As libusb's: `list` may be written to.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn libusb_get_device_list(
    context: *mut c_void,
    list: *mut *mut *mut c_void,
) -> libc::ssize_t {
    let count = in_world(|world| {
        let context = world.context(key(context)).ok_or(error::INVALID_PARAM)?;
        let found: Vec<_> = world.kinects.iter().map(|kinect| (kinect.number, kinect.plug, kinect.parts())).collect();
        let mut keys = Vec::new();
        for (kinect, plug, parts) in found {
            keys.extend(parts.into_iter().map(|part| world.list(context, kinect, part, plug)));
        }
        // SAFETY: calloc may be called with any sizes; the list ends with a null pointer.
        let memory = unsafe { libc::calloc(keys.len() + 1, size_of::<*mut c_void>()) }.cast::<*mut c_void>();
        if memory.is_null() {
            return Err(error::NO_MEM);
        }
        for (index, &key) in keys.iter().enumerate() {
            // SAFETY: the list holds one more pointer than there are keys.
            unsafe { *memory.add(index) = pointer(key) };
        }
        // SAFETY: the caller's promise.
        unsafe { *list = memory };
        c_int::try_from(keys.len()).map_err(|_overflow| error::OTHER)
    });
    count as libc::ssize_t
}

/// # Safety
/// As libusb's: `list` is null or came from `libusb_get_device_list` and was not freed.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn libusb_free_device_list(list: *mut *mut c_void, unref: c_int) {
    if list.is_null() {
        return;
    }
    in_world(|world| {
        let mut place = list;
        // SAFETY: the list ends with a null pointer.
        while unref != 0 && unsafe { !(*place).is_null() } {
            // SAFETY: as above.
            unsafe {
                world.unlist(key(*place));
                place = place.add(1);
            }
        }
        Ok(0)
    });
    // SAFETY: it was allocated by calloc.
    unsafe { libc::free(list.cast()) };
}

/// # Safety
/// As libusb's: `descriptor` may be written to.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn libusb_get_device_descriptor(
    device: *mut c_void,
    descriptor: *mut DeviceDescriptor,
) -> c_int {
    in_world(|world| {
        let listed = world.devices.get(&key(device)).ok_or(error::INVALID_PARAM)?;
        let kinect = world.kinects.get(listed.kinect).ok_or(error::INVALID_PARAM)?;
        let (vendor, product, release) = identity(kinect, listed.part);
        let filled = DeviceDescriptor {
            bLength: 18,
            bDescriptorType: 1,
            bcdUSB: 0x0200,
            bDeviceClass: if listed.part == Part::Hub { 9 } else { 0 },
            bDeviceSubClass: 0,
            bDeviceProtocol: 0,
            bMaxPacketSize0: 64,
            idVendor: vendor,
            idProduct: product,
            bcdDevice: release,
            iManufacturer: 1,
            iProduct: 2,
            iSerialNumber: if matches!(listed.part, Part::Camera | Part::Audio) { 3 } else { 0 },
            bNumConfigurations: 1,
        };
        // SAFETY: the caller's promise.
        unsafe { descriptor.write(filled) };
        Ok(0)
    })
}

/// Vendor, product and release of a part.
fn identity(kinect: &Kinect, part: Part) -> (u16, u16, u16) {
    const MICROSOFT: u16 = 0x045E;
    let windows = kinect.device.model == Model::Windows;
    match part {
        Part::Hub if kinect.device.model == Model::Xbox1414 => (0x0409, 0x005A, 0x0100),
        Part::Hub => (MICROSOFT, 0x02C2, 0x0100),
        Part::Camera if windows => (MICROSOFT, 0x02BF, 0x0110),
        // 267 is the first model; any other value is a later one.
        Part::Camera => (MICROSOFT, 0x02AE, if kinect.device.model == Model::Xbox1414 { 267 } else { 268 }),
        Part::Motor => (MICROSOFT, 0x02B0, 0x0105),
        Part::Audio => (MICROSOFT, if windows { 0x02BE } else { 0x02AD }, 0x0100),
    }
}

/// The device behind an open handle.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn libusb_get_device(handle: *mut c_void) -> *mut c_void {
    guarded(null_mut(), || {
        let guard = lock();
        let handle = guard.as_ref().and_then(|world| world.handles.get(&key(handle)));
        handle.map_or(null_mut(), |handle| pointer(handle.device))
    })
}

/// The hub within the Kinect, as long as it is listed.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn libusb_get_parent(device: *mut c_void) -> *mut c_void {
    guarded(null_mut(), || {
        let guard = lock();
        let Some(world) = guard.as_ref() else { return null_mut() };
        let Some(child) = world.devices.get(&key(device)).filter(|child| child.part != Part::Hub) else {
            return null_mut();
        };
        let hub = (child.context, child.kinect, Part::Hub, child.plug);
        let found = world.devices.iter().find(|(_, l)| (l.context, l.kinect, l.part, l.plug) == hub);
        found.map_or(null_mut(), |(&key, _)| pointer(key))
    })
}

/// One bus for all.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn libusb_get_bus_number(_device: *mut c_void) -> u8 {
    1
}

/// What the camera's endpoints are built for.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn libusb_get_max_iso_packet_size(device: *mut c_void, endpoint: c_uchar) -> c_int {
    in_world(|world| {
        let listed = world.devices.get(&key(device)).ok_or(error::INVALID_PARAM)?;
        let is_there = listed.part == Part::Camera && crate::kinect::Stream::of(endpoint).is_some();
        if is_there { Ok(1_920) } else { Err(error::NOT_FOUND) }
    })
}

/// # Safety
/// As libusb's: `config` may be written to.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn libusb_get_active_config_descriptor(
    device: *mut c_void,
    config: *mut *mut ConfigDescriptor,
) -> c_int {
    in_world(|world| {
        let listed = world.devices.get(&key(device)).ok_or(error::INVALID_PARAM)?;
        let kinect = world.kinects.get(listed.kinect).ok_or(error::INVALID_PARAM)?;
        let has_firmware = listed.part == Part::Audio && kinect.device.audio == Audio::Ready;
        // SAFETY: calloc may be called with any sizes.
        let memory = unsafe { libc::calloc(1, size_of::<ConfigDescriptor>()) }.cast::<ConfigDescriptor>();
        if memory.is_null() {
            return Err(error::NO_MEM);
        }
        // SAFETY: the memory is large enough, and zeros are a descriptor without interfaces and extras; the caller's
        // promise for `config`.
        unsafe {
            (*memory).bLength = 9;
            (*memory).bDescriptorType = 2;
            (*memory).bNumInterfaces = if has_firmware { 2 } else { 1 };
            (*memory).bConfigurationValue = 1;
            *config = memory;
        }
        Ok(0)
    })
}

/// # Safety
/// As libusb's: `config` is null or came from `libusb_get_active_config_descriptor`.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn libusb_free_config_descriptor(config: *mut ConfigDescriptor) {
    // SAFETY: it was allocated by calloc.
    unsafe { libc::free(config.cast()) };
}

/// The name of an error's number.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn libusb_error_name(number: c_int) -> *const std::ffi::c_char {
    let name = match number {
        0 => c"LIBUSB_SUCCESS",
        error::IO => c"LIBUSB_ERROR_IO",
        error::INVALID_PARAM => c"LIBUSB_ERROR_INVALID_PARAM",
        error::ACCESS => c"LIBUSB_ERROR_ACCESS",
        error::NO_DEVICE => c"LIBUSB_ERROR_NO_DEVICE",
        error::NOT_FOUND => c"LIBUSB_ERROR_NOT_FOUND",
        error::BUSY => c"LIBUSB_ERROR_BUSY",
        error::TIMEOUT => c"LIBUSB_ERROR_TIMEOUT",
        error::PIPE => c"LIBUSB_ERROR_PIPE",
        error::NO_MEM => c"LIBUSB_ERROR_NO_MEM",
        error::NOT_SUPPORTED => c"LIBUSB_ERROR_NOT_SUPPORTED",
        error::OTHER => c"LIBUSB_ERROR_OTHER",
        _ => c"**UNKNOWN**",
    };
    name.as_ptr()
}

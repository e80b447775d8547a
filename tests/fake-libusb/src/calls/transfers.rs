//! Transfers that are complete later.

use std::ffi::c_int;
use std::ptr::null_mut;

use super::{guarded, in_world, key};
use crate::abi::{ISOCHRONOUS, PacketDescriptor, Transfer, error};
use crate::isochronous::Submitted;
use crate::kinect::{Part, Stream};
use crate::world::{Allocated, World, lock, wake};

/// The most packets of one transfer, as in Linux.
const MAX_PACKETS: usize = 128;

/// A transfer with room for so many packets.
#[unsafe(no_mangle)]
pub(crate) extern "C" fn libusb_alloc_transfer(packets: c_int) -> *mut Transfer {
    guarded(null_mut(), || {
        let mut guard = lock();
        let Some(world) = guard.as_mut() else { return null_mut() };
        let Some(packets) = usize::try_from(packets).ok().filter(|&packets| packets <= MAX_PACKETS) else {
            return null_mut();
        };
        let size = size_of::<Transfer>() + packets * size_of::<PacketDescriptor>();
        // SAFETY: calloc may be called with any sizes.
        let transfer = unsafe { libc::calloc(1, size) }.cast::<Transfer>();
        if !transfer.is_null() {
            world.transfers.insert(transfer.expose_provenance(), Allocated { packets, place: None });
        }
        transfer
    })
}

/// # Safety
/// As libusb's: `transfer` is null or was allocated here and not freed.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn libusb_free_transfer(transfer: *mut Transfer) {
    if transfer.is_null() {
        return;
    }
    let known = in_world(|world| {
        let address = transfer.addr();
        let Some(freed) = world.transfers.remove(&address) else {
            world.journal("error", format_args!("free of {address:#x}, which is no transfer"));
            return Err(error::INVALID_PARAM);
        };
        if let Some((kinect, stream, _)) = freed.place
            && let Some(kinect) = world.kinects.get_mut(kinect)
        {
            kinect.forget(stream, address);
            world.journal("error", format_args!("free of transfer {address:#x}, which is in flight"));
        }
        Ok(0)
    });
    if known == 0 {
        // SAFETY: it was allocated by calloc, and is freed once.
        unsafe { libc::free(transfer.cast()) };
    }
}

/// # Safety
/// As libusb's: `transfer` was allocated here and filled.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn libusb_submit_transfer(transfer: *mut Transfer) -> c_int {
    let result = in_world(|world| {
        let allocated = world.transfers.get(&transfer.addr()).ok_or(error::INVALID_PARAM)?;
        // SAFETY: it was allocated here, and is its owner's until it is submitted.
        let (kind, endpoint, packets, handle) =
            unsafe { ((*transfer).kind, (*transfer).endpoint, (*transfer).num_iso_packets, (*transfer).dev_handle) };
        if allocated.place.is_some() {
            return Err(error::BUSY);
        }
        let capacity = allocated.packets;
        if !usize::try_from(packets).is_ok_and(|packets| (1..=capacity).contains(&packets)) {
            return Err(error::INVALID_PARAM);
        }
        if kind != ISOCHRONOUS {
            return Err(error::NOT_SUPPORTED);
        }
        // SAFETY: the caller's promise: what is submitted stays until it is complete.
        let submitted = unsafe { Submitted::new(transfer) };
        submit(world, submitted, endpoint, key(handle))
    });
    wake();
    result
}

fn submit(world: &mut World, transfer: Submitted, endpoint: u8, handle: usize) -> Result<c_int, c_int> {
    let context = world.handles.get(&handle).map(|open| open.context);
    let (kinect, part, _) = world.behind(handle, "submit").ok_or(error::NO_DEVICE)?;
    let context = context.ok_or(error::NO_DEVICE)?;
    let stream = Stream::of(endpoint).filter(|_| part == Part::Camera);
    // The kernel says ENOSPC for bandwidth and ENOENT for an endpoint; libusb makes an I/O error of both.
    let stream = stream.filter(|_| kinect.has_endpoints()).ok_or(error::IO)?;
    let device = kinect.number;
    if kinect.has_no_bandwidth {
        world.journal("refuse", format_args!("device={device} submit endpoint={endpoint:#x}: no bandwidth"));
        return Err(error::IO);
    }
    kinect.submit(stream, transfer, context);
    if let Some(allocated) = world.transfers.get_mut(&transfer.address()) {
        allocated.place = Some((device, stream, handle));
    }
    if world.handles.get_mut(&handle).is_some_and(|open| open.active.insert(endpoint)) {
        world.journal("submit", format_args!("device={device} endpoint={endpoint:#x}"));
    }
    Ok(0)
}

/// # Safety
/// As libusb's: `transfer` was allocated here.
#[unsafe(no_mangle)]
pub(crate) unsafe extern "C" fn libusb_cancel_transfer(transfer: *mut Transfer) -> c_int {
    let result = in_world(|world| {
        let address = transfer.addr();
        let allocated = world.transfers.get(&address).ok_or(error::NOT_FOUND)?;
        let (device, stream, handle) = allocated.place.ok_or(error::NOT_FOUND)?;
        let kinect = world.kinects.get_mut(device).ok_or(error::NOT_FOUND)?;
        if !kinect.cancel(stream, address) {
            return Err(error::NOT_FOUND);
        }
        let endpoint = if stream == Stream::Depth { 0x82 } else { 0x81 };
        if world.handles.get_mut(&handle).is_some_and(|open| open.active.remove(&endpoint)) {
            world.journal("cancel", format_args!("device={device} endpoint={endpoint:#x}"));
        }
        Ok(0)
    });
    wake();
    result
}

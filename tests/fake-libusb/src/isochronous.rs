//! Packets into transfers: an isochronous endpoint on the host's side.
//!
//! The host reserves slots of the bus ahead: each transfer takes as many as it has packets, after those of the one before.
//! When it submits too late its queue is empty, the slots in between belong to nobody, and what is sent in them is lost.

use std::collections::VecDeque;

use crate::abi::{PacketDescriptor, Transfer, status};

/// A transfer that the host gave away until it is complete.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Submitted(*mut Transfer);

// SAFETY: between submission and callback libusb alone may touch the transfer, from whatever thread; every use is
// made under the world's lock.
unsafe impl Send for Submitted {}

impl Submitted {
    /// # Safety
    /// `transfer` was allocated by `libusb_alloc_transfer` with at least its `num_iso_packets`, is not in flight, and its
    /// `buffer` holds `length` bytes; both stay so until it is complete.
    pub(crate) unsafe fn new(transfer: *mut Transfer) -> Self {
        Self(transfer)
    }

    /// What the transfer is known by.
    pub(crate) fn address(self) -> usize {
        self.0 as usize
    }

    fn packets(self) -> usize {
        // SAFETY: see `new`.
        usize::try_from(unsafe { (*self.0).num_iso_packets }).unwrap_or(0)
    }

    fn descriptor(self, index: usize) -> *mut PacketDescriptor {
        // SAFETY: callers stay below `packets`, and so many descriptors follow the transfer (see `new`).
        unsafe { (&raw mut (*self.0).iso_packet_desc).cast::<PacketDescriptor>().add(index) }
    }

    fn clear(self) {
        for index in 0..self.packets() {
            let descriptor = self.descriptor(index);
            // SAFETY: the descriptor lies within the transfer.
            unsafe {
                (*descriptor).actual_length = 0;
                (*descriptor).status = status::COMPLETED;
            }
        }
    }

    /// Writes a packet into its place; one longer than its place is cut, as a controller cuts babble.
    fn fill(self, index: usize, packet: &[u8]) {
        let place = |index| {
            // SAFETY: the descriptor lies within the transfer.
            unsafe { (*self.descriptor(index)).length as usize }
        };
        let start: usize = (0..index).map(place).sum();
        // SAFETY: see `new`.
        let (buffer, length) = unsafe { ((*self.0).buffer, (*self.0).length) };
        let room = usize::try_from(length).unwrap_or(0).saturating_sub(start).min(place(index));
        let written = packet.len().min(room);
        let descriptor = self.descriptor(index);
        // SAFETY: `start + written` is at most `length`, which the buffer holds; the packet lies in memory of our own.
        unsafe {
            std::ptr::copy_nonoverlapping(packet.as_ptr(), buffer.add(start), written);
            (*descriptor).actual_length = u32::try_from(written).unwrap_or(0);
            (*descriptor).status = if written < packet.len() { status::OVERFLOW } else { status::COMPLETED };
        }
    }

    fn finish(self, status: i32) {
        // SAFETY: see `new`.
        unsafe {
            (*self.0).status = status;
            (*self.0).actual_length = 0; // isochronous transfers count in their packets
        }
    }
}

/// A transfer that is complete and waits for its callback.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Complete {
    /// The transfer's address.
    pub(crate) transfer: usize,
    /// The context whose events it is among.
    pub(crate) context: usize,
}

#[derive(Debug)]
struct Reservation {
    transfer: Submitted,
    context: usize,
    first: u64,
    end: u64,
}

/// One endpoint and the transfers that wait for its packets.
#[derive(Debug)]
pub(crate) struct Endpoint {
    /// The slot after the last one reserved.
    reserved: u64,
    queue: VecDeque<Reservation>,
}

impl Endpoint {
    pub(crate) fn new() -> Self {
        Self { reserved: 0, queue: VecDeque::new() }
    }

    pub(crate) fn in_flight(&self) -> usize {
        self.queue.len()
    }

    /// Reserves slots, the first not before `slot`.
    pub(crate) fn submit(&mut self, transfer: Submitted, context: usize, slot: u64) {
        transfer.clear();
        let first = self.reserved.max(slot);
        let end = first + transfer.packets() as u64;
        self.reserved = end;
        self.queue.push_back(Reservation { transfer, context, first, end });
    }

    /// Passes one slot, with or without a packet; whether somebody took it, and the transfer that it completes.
    pub(crate) fn pass(&mut self, slot: u64, packet: Option<&[u8]>) -> (bool, Option<Complete>) {
        let Some(front) = self.queue.front().filter(|front| front.first <= slot) else {
            return (false, None);
        };
        if let Some(packet) = packet {
            front.transfer.fill((slot - front.first) as usize, packet);
        }
        let complete = if slot + 1 >= front.end { self.queue.pop_front() } else { None };
        (true, complete.map(|reservation| reservation.complete(status::COMPLETED)))
    }

    /// Takes a transfer back before its time.
    pub(crate) fn cancel(&mut self, address: usize) -> Option<Complete> {
        let index = self.queue.iter().position(|reservation| reservation.transfer.address() == address)?;
        self.queue.remove(index).map(|reservation| reservation.complete(status::CANCELLED))
    }

    /// The device has gone: every transfer comes back.
    pub(crate) fn disappear(&mut self) -> impl Iterator<Item = Complete> {
        self.reserved = 0;
        self.queue.drain(..).map(|reservation| reservation.complete(status::NO_DEVICE))
    }

    /// Forgets a transfer whose handle was closed under it.
    pub(crate) fn forget(&mut self, address: usize) {
        self.queue.retain(|reservation| reservation.transfer.address() != address);
    }

    /// The slot after which the next transfer of `context` is complete.
    pub(crate) fn next_end(&self, context: usize) -> Option<u64> {
        self.queue.iter().find(|reservation| reservation.context == context).map(|reservation| reservation.end)
    }
}

impl Reservation {
    fn complete(self, status: i32) -> Complete {
        self.transfer.finish(status);
        Complete { transfer: self.transfer.address(), context: self.context }
    }
}

//! libusb's structures and numbers, as its header has them.

use std::ffi::{c_int, c_uchar, c_uint, c_void};

/// `enum libusb_error`, as far as the kernel leads to it here.
pub(crate) mod error {
    use std::ffi::c_int;

    pub(crate) const IO: c_int = -1;
    pub(crate) const INVALID_PARAM: c_int = -2;
    pub(crate) const ACCESS: c_int = -3;
    pub(crate) const NO_DEVICE: c_int = -4;
    pub(crate) const NOT_FOUND: c_int = -5;
    pub(crate) const BUSY: c_int = -6;
    pub(crate) const TIMEOUT: c_int = -7;
    pub(crate) const PIPE: c_int = -9;
    pub(crate) const NO_MEM: c_int = -11;
    pub(crate) const NOT_SUPPORTED: c_int = -12;
    pub(crate) const OTHER: c_int = -99;
}

/// `enum libusb_transfer_status`.
pub(crate) mod status {
    use std::ffi::c_int;

    pub(crate) const COMPLETED: c_int = 0;
    pub(crate) const CANCELLED: c_int = 3;
    pub(crate) const NO_DEVICE: c_int = 5;
    pub(crate) const OVERFLOW: c_int = 6;
}

/// `LIBUSB_TRANSFER_TYPE_ISOCHRONOUS`.
pub(crate) const ISOCHRONOUS: c_uchar = 1;
/// `LIBUSB_TRANSFER_FREE_BUFFER`.
pub(crate) const FREE_BUFFER: u8 = 2;
/// `LIBUSB_TRANSFER_FREE_TRANSFER`.
pub(crate) const FREE_TRANSFER: u8 = 4;

/// `struct libusb_device_descriptor`.
#[repr(C)]
#[allow(non_snake_case, reason = "the names of the USB standard")]
pub(crate) struct DeviceDescriptor {
    pub(crate) bLength: u8,
    pub(crate) bDescriptorType: u8,
    pub(crate) bcdUSB: u16,
    pub(crate) bDeviceClass: u8,
    pub(crate) bDeviceSubClass: u8,
    pub(crate) bDeviceProtocol: u8,
    pub(crate) bMaxPacketSize0: u8,
    pub(crate) idVendor: u16,
    pub(crate) idProduct: u16,
    pub(crate) bcdDevice: u16,
    pub(crate) iManufacturer: u8,
    pub(crate) iProduct: u8,
    pub(crate) iSerialNumber: u8,
    pub(crate) bNumConfigurations: u8,
}

/// `struct libusb_config_descriptor`.
#[repr(C)]
#[allow(non_snake_case, reason = "the names of the USB standard")]
pub(crate) struct ConfigDescriptor {
    pub(crate) bLength: u8,
    pub(crate) bDescriptorType: u8,
    pub(crate) wTotalLength: u16,
    pub(crate) bNumInterfaces: u8,
    pub(crate) bConfigurationValue: u8,
    pub(crate) iConfiguration: u8,
    pub(crate) bmAttributes: u8,
    pub(crate) MaxPower: u8,
    pub(crate) interface: *const c_void,
    pub(crate) extra: *const c_uchar,
    pub(crate) extra_length: c_int,
}

/// `struct libusb_iso_packet_descriptor`.
#[repr(C)]
pub(crate) struct PacketDescriptor {
    pub(crate) length: c_uint,
    pub(crate) actual_length: c_uint,
    pub(crate) status: c_int,
}

/// What is called when a transfer is complete.
pub(crate) type Callback = extern "C" fn(*mut Transfer);

/// `struct libusb_transfer`; its packet descriptors follow it in memory.
#[repr(C)]
pub(crate) struct Transfer {
    pub(crate) dev_handle: *mut c_void,
    pub(crate) flags: u8,
    pub(crate) endpoint: c_uchar,
    pub(crate) kind: c_uchar,
    pub(crate) timeout: c_uint,
    pub(crate) status: c_int,
    pub(crate) length: c_int,
    pub(crate) actual_length: c_int,
    pub(crate) callback: Option<Callback>,
    pub(crate) user_data: *mut c_void,
    pub(crate) buffer: *mut c_uchar,
    pub(crate) num_iso_packets: c_int,
    pub(crate) iso_packet_desc: [PacketDescriptor; 0],
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::mem::{offset_of, size_of};

    /// The offsets a C compiler gives on a 64-bit machine.
    #[test]
    #[cfg(target_pointer_width = "64")]
    fn structures_lie_in_memory_as_in_the_header() {
        assert_eq!(size_of::<DeviceDescriptor>(), 18);
        assert_eq!(offset_of!(ConfigDescriptor, bNumInterfaces), 4);
        assert_eq!((offset_of!(ConfigDescriptor, interface), size_of::<ConfigDescriptor>()), (16, 40));
        assert_eq!((offset_of!(Transfer, timeout), offset_of!(Transfer, status)), (12, 16));
        assert_eq!((offset_of!(Transfer, callback), offset_of!(Transfer, buffer)), (32, 48));
        assert_eq!((offset_of!(Transfer, num_iso_packets), offset_of!(Transfer, iso_packet_desc)), (56, 60));
        assert_eq!(size_of::<PacketDescriptor>(), 12);
    }
}

//! A depth frame as the driver hands it over.

use core::ops::ControlFlow;
use tumbled_model::{DepthEncoding, KinectTicks, PacketMask};

/// Bytes of a frame of 640 × 480 pixels, packed: 11 bits a pixel.
pub const PACKED_BYTES: usize = 422_400;
/// Bytes of a frame with 16 bits a pixel.
pub const UNPACKED_BYTES: usize = 614_400;

/// One depth frame, valid while the sink looks at it.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// The device's stamp: that of the last packet of the frame that arrived.
    pub ticks: KinectTicks,
    /// How `bytes` is laid out: packed from a device, 16-bit from the player of recorded frames.
    pub encoding: DepthEncoding,
    /// USB packets that never arrived. Where they belong, `bytes` is all ones, which is "no data" in every pixel that lies
    /// wholly there: never the bytes of an earlier frame.
    pub lost_packets: PacketMask,
    /// Frames that the device stamped between the previous frame of this stream and this one, and that did not arrive.
    pub missing_before: u32,
    /// The payload: [`PACKED_BYTES`] or [`UNPACKED_BYTES`].
    pub bytes: &'a [u8],
}

/// Where frames go. Called on the usb thread, between two packets: it copies what it needs and returns within a few
/// milliseconds, since the bus holds 32 ms. `Break` ends the stream.
pub type FrameSink = Box<dyn FnMut(&Frame<'_>) -> ControlFlow<()> + Send>;

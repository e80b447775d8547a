//! Depth frames in a file or through a pipe.
//!
//! Eight bytes `TUSBDEP1`, then frame after frame: ticks (u32, 60 MHz, little-endian), length (u32, little-endian, always
//! 422 400) and so many bytes of the packed 11-bit stream.

use std::io::{self, Read, Write};

/// The first bytes.
pub const MAGIC: [u8; 8] = *b"TUSBDEP1";
/// Bytes of a packed 11-bit frame: 640 × 480 × 11 / 8.
pub const PACKED_BYTES: usize = 422_400;
/// Bytes before each frame's payload.
pub const FRAME_HEADER: usize = 8;
/// Ticks between frames at 30 Hz of a 60 MHz clock.
pub const FRAME_TICKS: u32 = 2_000_000;

/// One frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    /// The device's 60 MHz clock.
    pub ticks: u32,
    /// The packed 11-bit stream, 422 400 bytes.
    pub packed: Vec<u8>,
}

/// Writes frames.
pub struct FrameWriter<W> {
    to: W,
}

impl<W: Write> FrameWriter<W> {
    /// Begins with the magic.
    pub fn new(mut to: W) -> io::Result<Self> {
        to.write_all(&MAGIC)?;
        Ok(Self { to })
    }

    /// Writes one frame; an error if `packed` is not 422 400 bytes.
    pub fn write(&mut self, ticks: u32, packed: &[u8]) -> io::Result<()> {
        if packed.len() != PACKED_BYTES {
            return Err(io::Error::new(
                io::ErrorKind::InvalidInput,
                format!("a frame of {} bytes, expected {PACKED_BYTES} (packed 11-bit)", packed.len()),
            ));
        }
        let mut header = [0; FRAME_HEADER];
        header[..4].copy_from_slice(&ticks.to_le_bytes());
        header[4..].copy_from_slice(&(PACKED_BYTES as u32).to_le_bytes());
        self.to.write_all(&header)?;
        self.to.write_all(packed)
    }

    /// Flushes, and gives back what was written to.
    pub fn finish(mut self) -> io::Result<W> {
        self.to.flush()?;
        Ok(self.to)
    }
}

/// Reads frames.
pub struct FrameReader<R> {
    from: R,
}

impl<R: Read> FrameReader<R> {
    /// Expects the magic.
    pub fn new(mut from: R) -> io::Result<Self> {
        let mut magic = [0; 8];
        from.read_exact(&mut magic)?;
        if magic != MAGIC {
            let found = String::from_utf8_lossy(&magic).into_owned();
            return Err(invalid(format!("the file begins with `{found}`, expected `TUSBDEP1`")));
        }
        Ok(Self { from })
    }

    /// The next frame, or `None` at the end; a file that ends within a frame is an error.
    pub fn read(&mut self) -> io::Result<Option<Frame>> {
        let mut header = [0; FRAME_HEADER];
        let mut filled = 0;
        while filled < header.len() {
            match self.from.read(&mut header[filled..]) {
                Ok(0) if filled == 0 => return Ok(None),
                Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(read) => filled += read,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
        }
        let ticks = ticks_of(&header)?;
        let mut packed = vec![0; PACKED_BYTES];
        self.from.read_exact(&mut packed)?;
        Ok(Some(Frame { ticks, packed }))
    }
}

/// The ticks in a frame's header; an error if its length is not that of a frame.
pub fn ticks_of(header: &[u8; FRAME_HEADER]) -> io::Result<u32> {
    let [t0, t1, t2, t3, l0, l1, l2, l3] = *header;
    let length = u32::from_le_bytes([l0, l1, l2, l3]);
    if length as usize == PACKED_BYTES {
        Ok(u32::from_le_bytes([t0, t1, t2, t3]))
    } else {
        Err(invalid(format!("a frame of {length} bytes, expected {PACKED_BYTES} (packed 11-bit)")))
    }
}

fn invalid(reason: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, reason)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn what_is_written_is_read() {
        let mut writer = FrameWriter::new(Vec::new()).expect("writes");
        writer.write(7, &[1; PACKED_BYTES]).expect("writes");
        writer.write(u32::MAX, &[2; PACKED_BYTES]).expect("writes");
        let bytes = writer.finish().expect("flushes");
        assert_eq!(bytes.len(), 8 + 2 * (8 + 422_400));

        let mut reader = FrameReader::new(&bytes[..]).expect("begins");
        assert_eq!(reader.read().expect("reads"), Some(Frame { ticks: 7, packed: vec![1; PACKED_BYTES] }));
        assert_eq!(reader.read().expect("reads"), Some(Frame { ticks: u32::MAX, packed: vec![2; PACKED_BYTES] }));
        assert_eq!(reader.read().expect("reads"), None);

        let mut cut = FrameReader::new(&bytes[..bytes.len() - 1]).expect("begins");
        assert!(cut.read().is_ok());
        assert_eq!(cut.read().expect_err("is cut").kind(), io::ErrorKind::UnexpectedEof);
    }

    #[test]
    fn a_frame_of_another_size_is_refused() {
        let mut writer = FrameWriter::new(Vec::new()).expect("writes");
        let error = writer.write(0, &[0; 384_000]).expect_err("too short");
        assert_eq!(error.to_string(), "a frame of 384000 bytes, expected 422400 (packed 11-bit)");
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_or_refused(bytes in proptest::collection::vec(any::<u8>(), 0..64), magic: bool) {
            let bytes = if magic { [&MAGIC[..], &bytes].concat() } else { bytes };
            if let Ok(mut reader) = FrameReader::new(&bytes[..]) {
                // 64 bytes are never a whole frame.
                prop_assert!(matches!(reader.read(), Ok(None) | Err(_)));
            }
        }
    }
}

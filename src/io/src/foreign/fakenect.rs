//! Depth frames in a folder that fakenect plays.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use tumbled_model::{KinectTicks, UnixNs};

/// A dump: `INDEX.txt` and one file a frame.
#[derive(Debug)]
pub struct FakenectFolder {
    folder: PathBuf,
    index: BufWriter<File>,
}

impl FakenectFolder {
    /// Begins a dump in a folder, which is made if it is not there.
    ///
    /// # Errors
    /// What the system says.
    pub fn create(folder: &Path) -> io::Result<Self> {
        fs::create_dir_all(folder)?;
        let index = BufWriter::new(File::create(folder.join("INDEX.txt"))?);
        Ok(Self { folder: folder.to_owned(), index })
    }

    /// Adds a frame that the host had at `host`: the device's stamp, and 307 200 codes of 11 bits.
    ///
    /// # Errors
    /// What the system says.
    pub fn frame(&mut self, host: UnixNs, ticks: KinectTicks, codes: impl Iterator<Item = u16>) -> io::Result<()> {
        let (seconds, nanos) = (host.0.div_euclid(1_000_000_000), host.0.rem_euclid(1_000_000_000));
        let name = format!("d-{seconds}.{nanos:09}-{}.pgm", ticks.0);
        let mut file = BufWriter::new(File::create(self.folder.join(&name))?);
        file.write_all(b"P5 640 480 65535\n")?;
        for code in codes {
            // Little-endian, as the device's library hands it over, whatever the header's format says.
            file.write_all(&code.to_le_bytes())?;
        }
        file.flush()?;
        writeln!(self.index, "{name}")
    }

    /// Ends the dump.
    ///
    /// # Errors
    /// What the system says.
    pub fn finish(mut self) -> io::Result<()> {
        self.index.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::capture::{self, KinectRoute, Routing};
    use tumbled_model::{Body, DepthEncoding, Event, RigNs};

    #[test]
    fn what_is_written_is_read_as_a_dump_with_its_stamps() {
        let folder = tempfile::tempdir().expect("a folder");
        let dump = folder.path().join("kinect");
        let start = UnixNs(1_795_341_600_000_000_123);
        let codes = |frame: u16| (0..307_200).map(move |pixel| (pixel as u16 ^ frame) & 0x7FF);
        let mut writer = FakenectFolder::create(&dump).expect("creates");
        writer.frame(start, KinectTicks(5), codes(0)).expect("writes");
        writer.frame(UnixNs(start.0 + 33_333_333), KinectTicks(2_000_005), codes(1)).expect("writes");
        writer.finish().expect("ends");
        let routing = Routing { lidars: Vec::new(), kinects: vec![KinectRoute { id: "near".into(), topic: None }] };
        let merged = capture::merge(capture::open_all(&[&dump], &routing).expect("opens")).expect("merges");
        let events: Vec<Event> = merged.collect::<Result<_, _>>().expect("reads");
        let Body::DepthFrame { ticks, encoding, bytes, .. } = &events[1].body else { panic!("a frame") };
        assert_eq!((*ticks, *encoding), (Some(KinectTicks(2_000_005)), DepthEncoding::Raw11));
        assert_eq!(events[1].arrived, RigNs(33_333_333));
        let expected: Vec<u8> = codes(1).flat_map(u16::to_le_bytes).collect();
        assert!(bytes.as_ref() == expected.as_slice());
    }
}

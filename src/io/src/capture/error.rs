//! Why a capture cannot be read.

use super::depth_png::PngForm;
use super::summary::BrokenOff;
use crate::recording::ReadError;
use core::fmt;
use std::path::PathBuf;

/// Why a capture cannot be read: where, what was found, what was expected, what to do.
///
/// Damage that leaves a good part (a file broken off, a packet cut short) is no error: it is counted in the
/// summary and posted as a gap.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CaptureError {
    /// The system refused to read.
    #[error("cannot read {}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said. Part of the text, so not a `source()` that would be printed a second time.
        r#source: std::io::Error,
    },
    /// A pipe, socket or device: a capture is read more than once, and reading a pipe could wait for ever.
    #[error("{} is neither a file nor a folder: copy the data into a file first", path.display())]
    NotAFile {
        /// The path.
        path: PathBuf,
    },
    /// A compressed file.
    #[error("{} is compressed with {by}: unpack it first (`{command}`) and give the unpacked file", path.display())]
    Compressed {
        /// The file.
        path: PathBuf,
        /// The compressor.
        by: &'static str,
        /// The command that unpacks.
        command: &'static str,
    },
    /// A format that is known but not read.
    #[error("{} is {found}: {remedy}", path.display())]
    ForeignFormat {
        /// The file.
        path: PathBuf,
        /// What it is.
        found: &'static str,
        /// How to get something that is read.
        remedy: &'static str,
    },
    /// A recording of this program that cannot be read.
    #[error(transparent)]
    Recording(#[from] ReadError),
    /// Nothing this program knows.
    #[error(
        "{} begins with {found:02x?}, which is no capture: expected .pcap, .pcapng, a recording (.mcap), \
         a ROS 2 bag (.mcap, .db3), a 16-bit depth .png or a fakenect .pgm", path.display()
    )]
    UnknownFormat {
        /// The file.
        path: PathBuf,
        /// Its first bytes, at most 8.
        found: Vec<u8>,
    },
    /// A folder without anything to read.
    #[error(
        "the folder {} holds no capture: expected INDEX.txt (fakenect), .mcap or .db3 (ROS 2 bag) or .png (depth frames)",
        path.display()
    )]
    EmptyFolder {
        /// The folder.
        path: PathBuf,
    },
    /// A file that ends within its own header.
    #[error("{} ends after {length} bytes, within its header: it holds no data", path.display())]
    TooShort {
        /// The file.
        path: PathBuf,
        /// Its length in bytes.
        length: u64,
    },
    /// A header that contradicts its magic number.
    #[error("{}, byte {offset}: {found} where {expected} was expected: the file is damaged", path.display())]
    BadHeader {
        /// The file.
        path: PathBuf,
        /// Offset of the field, bytes.
        offset: u64,
        /// The field's value.
        found: u64,
        /// What it should be.
        expected: &'static str,
    },
    /// A pcap whose frames are of a kind that cannot hold UDP, or not known.
    #[error(
        "{}, byte 20: link type {number} is not read; expected Ethernet (1), Linux cooked (113, 276), raw IP (101, 228, 229) \
         or loopback (0, 108): capture on the network interface the sensor is connected to", path.display()
    )]
    LinkType {
        /// The file.
        path: PathBuf,
        /// The link type found (tcpdump.org/linktypes.html).
        number: u16,
    },
    /// A sensor kind that the routing does not have.
    #[error("{} holds Kinect frames, but the config has no Kinect: add a [[kinect]]", path.display())]
    NoKinect {
        /// The folder or file.
        path: PathBuf,
    },
    /// A line of `INDEX.txt` that is no dump file's name.
    #[error(
        "{}, line {line}: `{found}` is no fakenect file name: expected TYPE-SECONDS-TICKS.ext, e.g. d-1332333.250000-60000.pgm, \
         in the same folder", path.display()
    )]
    IndexLine {
        /// The `INDEX.txt`.
        path: PathBuf,
        /// Counted from 1.
        line: usize,
        /// The line, shortened to 80 characters.
        found: String,
    },
    /// A line of `times.txt` that is no time.
    #[error(
        "{}, line {line}: `{found}` is no time: expected seconds as a decimal number, 0 to 9223372035, e.g. 1332333.250000",
        path.display()
    )]
    TimesLine {
        /// The `times.txt`.
        path: PathBuf,
        /// Counted from 1.
        line: usize,
        /// The line, shortened to 80 characters.
        found: String,
    },
    /// `times.txt` is not about these frames.
    #[error(
        "{} has {times} lines for {frames} frames: one line per PNG, in name order; without times.txt 30 Hz is assumed",
        path.display()
    )]
    TimesCount {
        /// The `times.txt`.
        path: PathBuf,
        /// Lines in it.
        times: usize,
        /// PNGs in the folder.
        frames: usize,
    },
    /// A list file (INDEX.txt, times.txt) beyond any recording's size, or not text.
    #[error("{} is not a list of lines of text of at most {limit} bytes", path.display())]
    NotAList {
        /// The file.
        path: PathBuf,
        /// The limit in bytes.
        limit: u64,
    },
    /// A PNG that is no depth frame.
    #[error(
        "{} is {found}; expected 640x480, 16-bit greyscale, millimetres (a colour image beside the depth frames? \
         put the depth frames into a folder of their own)", path.display()
    )]
    NotDepthPng {
        /// The file.
        path: PathBuf,
        /// What it is.
        found: PngForm,
    },
    /// Named or starting like a PNG, without a PNG header.
    #[error("{} has no PNG header: it is damaged or no PNG", path.display())]
    NotPng {
        /// The file.
        path: PathBuf,
    },
    /// A PGM whose bytes are in the order that the PGM standard asks for, not in fakenect's.
    #[error(
        "{} holds big-endian samples (a standard PGM, not a fakenect dump, which is little-endian): convert it to a 16-bit \
         PNG with `raw11` in its name", path.display()
    )]
    BigEndianPgm {
        /// The file.
        path: PathBuf,
    },
    /// A bag without anything for the configured sensors.
    #[error(
        "{} has no usable topic: expected velodyne_msgs/msg/VelodyneScan or a 640x480 sensor_msgs/msg/Image \
         with encoding 16UC1 or mono16, serialised as cdr, and a [[lidar]] or [[kinect]] for it; found {}",
        path.display(), TopicList(topics, broken.as_deref())
    )]
    NoUsableTopic {
        /// The bag.
        path: PathBuf,
        /// What is there.
        topics: Vec<TopicFound>,
        /// Where the bag stops being readable, if it does.
        broken: Option<Box<BrokenOff>>,
    },
    /// SQLite cannot read a `.db3`.
    #[error("cannot read the bag {}: {source} (an interrupted recording can be repaired with `sqlite3 FILE .recover`)", path.display())]
    Database {
        /// The file.
        path: PathBuf,
        /// What SQLite said. Part of the text, so not a `source()` that would be printed a second time.
        r#source: Box<rusqlite::Error>,
    },
    /// An SQLite file that is no bag.
    #[error("{} is an SQLite database but no ROS 2 bag: it has no ordinary table `{table}`", path.display())]
    NotABag {
        /// The file.
        path: PathBuf,
        /// The table that is missing.
        table: &'static str,
    },
    /// Inputs whose times have nothing to do with each other.
    #[error(
        "{} has no times of its own (frames are numbered at 30 Hz) and cannot be merged by time with {}: \
         give it a times.txt, or use the inputs one by one", synthetic.display(), real.display()
    )]
    UnrelatedTimes {
        /// The input without times.
        synthetic: PathBuf,
        /// An input with times.
        real: PathBuf,
    },
}

/// A topic of a bag, as an error lists it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TopicFound {
    /// Topic name.
    pub name: String,
    /// Message type, e.g. `sensor_msgs/msg/Imu`.
    pub type_name: String,
    /// Serialisation, e.g. `cdr`.
    pub serialisation: String,
    /// Encoding and size of the topic's first image.
    pub image: Option<String>,
}

struct TopicList<'a>(&'a [TopicFound], Option<&'a BrokenOff>);

impl fmt::Display for TopicList<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.0.is_empty() {
            f.write_str("no topics")?;
        }
        for (n, topic) in self.0.iter().enumerate() {
            let separator = if n == 0 { "" } else { ", " };
            write!(f, "{separator}{} ({}", topic.name, topic.type_name)?;
            if let Some(image) = &topic.image {
                write!(f, " {image}")?;
            }
            if topic.serialisation != "cdr" {
                write!(f, ", serialised as {:?}", topic.serialisation)?;
            }
            f.write_str(")")?;
        }
        match self.1 {
            Some(broken) => write!(f, "; {broken}"),
            None => Ok(()),
        }
    }
}

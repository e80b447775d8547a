//! Opening files and telling from their first bytes what they are.

use super::CaptureError;
use crate::recording::reader::begins_recording;
use std::cmp::Ordering;
use std::fs::{self, File};
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

/// Read-ahead for streams: large enough that system calls do not show, small beside everything else.
const BUFFER_BYTES: usize = 1 << 18;

/// First bytes that tell every kind of file.
const HEAD_BYTES: usize = 32;

/// `INDEX.txt` and `times.txt`: an hour of depth and colour at 30 Hz is 216 000 lines of about 32 bytes, 7 MB.
const LIST_LIMIT: u64 = 64 << 20;

/// What a path turned out to be.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Sniffed {
    Pcap,
    PcapNg,
    /// One or several parts of a recording of this program.
    Recording {
        parts: Vec<PathBuf>,
    },
    /// One or several parts in the order they were written.
    Bag {
        parts: Vec<PathBuf>,
    },
    FakenectFolder,
    /// Frames in name order.
    PngFolder {
        frames: Vec<PathBuf>,
    },
    Png,
    Pgm,
}

/// What a bag's part is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PartKind {
    Mcap,
    Sqlite,
}

pub(crate) const PNG_MAGIC: [u8; 8] = *b"\x89PNG\r\n\x1a\n";
pub(crate) const MCAP_MAGIC: [u8; 8] = *b"\x89MCAP0\r\n";
const SQLITE_MAGIC: &[u8] = b"SQLite format 3\0";

pub(crate) fn io_error(path: &Path) -> impl FnOnce(std::io::Error) -> CaptureError {
    move |source| CaptureError::Io { path: path.to_owned(), source }
}

/// Opens a regular file; anything else (a pipe would wait for its writer) is refused.
pub(crate) fn open_regular(path: &Path) -> Result<File, CaptureError> {
    let metadata = fs::metadata(path).map_err(io_error(path))?;
    if !metadata.is_file() {
        return Err(CaptureError::NotAFile { path: path.to_owned() });
    }
    File::open(path).map_err(io_error(path))
}

/// [`open_regular`] with a read-ahead.
pub(crate) fn open_buffered(path: &Path) -> Result<BufReader<File>, CaptureError> {
    Ok(BufReader::with_capacity(BUFFER_BYTES, open_regular(path)?))
}

/// At most `limit` first bytes of a regular file.
pub(crate) fn read_head(path: &Path, limit: usize) -> Result<Vec<u8>, CaptureError> {
    let mut head = Vec::new();
    open_regular(path)?.take(limit as u64).read_to_end(&mut head).map_err(io_error(path))?;
    Ok(head)
}

/// The lines of a small text file with their numbers from 1; blank lines and trailing blanks are left out.
pub(crate) fn read_lines(path: &Path) -> Result<Vec<(usize, String)>, CaptureError> {
    let not_a_list = || CaptureError::NotAList { path: path.to_owned(), limit: LIST_LIMIT };
    let mut bytes = Vec::new();
    open_regular(path)?.take(LIST_LIMIT + 1).read_to_end(&mut bytes).map_err(io_error(path))?;
    if bytes.len() as u64 > LIST_LIMIT {
        return Err(not_a_list());
    }
    let Ok(text) = String::from_utf8(bytes) else {
        return Err(not_a_list());
    };
    let numbered = text.lines().enumerate().map(|(n, line)| (n + 1, line.trim().to_owned()));
    Ok(numbered.filter(|(_, line)| !line.is_empty()).collect())
}

/// A line for an error message: control characters out, at most 80 characters.
pub(crate) fn excerpt(line: &str) -> String {
    line.chars().filter(|c| !c.is_control()).take(80).collect()
}

/// Tells what a path is, from its content.
pub(crate) fn sniff(path: &Path) -> Result<Sniffed, CaptureError> {
    if fs::metadata(path).map_err(io_error(path))?.is_dir() {
        return sniff_folder(path);
    }
    let head = read_head(path, HEAD_BYTES)?;
    if head.is_empty() {
        return Err(CaptureError::TooShort { path: path.to_owned(), length: 0 });
    }
    if let Some(refusal) = refusal(path, &head) {
        return Err(refusal);
    }
    if let Some(magic) = head.first_chunk::<4>() {
        match u32::from_be_bytes(*magic) {
            0xa1b2_c3d4 | 0xd4c3_b2a1 | 0xa1b2_3c4d | 0x4d3c_b2a1 => return Ok(Sniffed::Pcap),
            0x0a0d_0d0a => return Ok(Sniffed::PcapNg),
            _ => {}
        }
    }
    if begins_recording(&head) {
        return Ok(Sniffed::Recording { parts: vec![path.to_owned()] });
    }
    if part_kind_of(&head).is_some() {
        return Ok(Sniffed::Bag { parts: vec![path.to_owned()] });
    }
    if head.starts_with(&PNG_MAGIC) {
        return Ok(Sniffed::Png);
    }
    if head.starts_with(b"P5") {
        return Ok(Sniffed::Pgm);
    }
    Err(CaptureError::UnknownFormat { path: path.to_owned(), found: head.into_iter().take(8).collect() })
}

/// What a bag's part is, from its content.
pub(crate) fn part_kind(path: &Path) -> Result<PartKind, CaptureError> {
    let head = read_head(path, 16)?;
    if let Some(refusal) = refusal(path, &head) {
        return Err(refusal);
    }
    part_kind_of(&head)
        .ok_or_else(|| CaptureError::UnknownFormat { path: path.to_owned(), found: head.into_iter().take(8).collect() })
}

fn part_kind_of(head: &[u8]) -> Option<PartKind> {
    if head.starts_with(&MCAP_MAGIC) {
        Some(PartKind::Mcap)
    } else if head.starts_with(SQLITE_MAGIC) {
        Some(PartKind::Sqlite)
    } else {
        None
    }
}

/// Compressed files and relatives of what is read, refused with the way out.
fn refusal(path: &Path, head: &[u8]) -> Option<CaptureError> {
    let compressed = [
        (&b"\x1f\x8b"[..], "gzip", "gunzip -k FILE"),
        (b"\x28\xb5\x2f\xfd", "zstd", "zstd -d FILE"),
        (b"\xfd7zXZ\0", "xz", "unxz -k FILE"),
        (b"BZh", "bzip2", "bunzip2 -k FILE"),
        (b"\x04\x22\x4d\x18", "lz4", "unlz4 FILE"),
        (b"PK\x03\x04", "zip", "unzip FILE"),
    ];
    for (magic, by, command) in compressed {
        if head.starts_with(magic) {
            return Some(CaptureError::Compressed { path: path.to_owned(), by, command });
        }
    }
    let foreign = [
        (&b"#ROSBAG V"[..], "a ROS 1 bag", "convert it with `rosbags-convert --src IN.bag --dst OUT`"),
        (b"\xa1\xb2\xcd\x34", "a Kuznetzov-modified pcap", "convert it with `editcap -F pcap IN OUT.pcap`"),
        (b"\x34\xcd\xb2\xa1", "a Kuznetzov-modified pcap", "convert it with `editcap -F pcap IN OUT.pcap`"),
        (b"snoop\0\0\0", "a snoop capture", "convert it with `editcap -F pcap IN OUT.pcap`"),
    ];
    for (magic, found, remedy) in foreign {
        if head.starts_with(magic) {
            return Some(CaptureError::ForeignFormat { path: path.to_owned(), found, remedy });
        }
    }
    None
}

/// A folder is a fakenect dump if it has an `INDEX.txt`, else a recording or a bag if it has parts, else depth PNGs.
fn sniff_folder(path: &Path) -> Result<Sniffed, CaptureError> {
    let mut parts = Vec::new();
    let mut frames = Vec::new();
    let mut packed = None;
    for entry in fs::read_dir(path).map_err(io_error(path))? {
        let entry = entry.map_err(io_error(path))?.path();
        let name = entry.file_name().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        if name == "index.txt" && entry.file_name().is_some_and(|name| name == "INDEX.txt") {
            return Ok(Sniffed::FakenectFolder);
        } else if name.starts_with('.') {
            // Hidden files: editors' and file managers' leavings.
        } else if name.ends_with(".mcap") || name.ends_with(".db3") {
            parts.push(entry);
        } else if name.ends_with(".mcap.zstd") || name.ends_with(".db3.zstd") {
            packed = Some(entry);
        } else if name.ends_with(".png") {
            frames.push(entry);
        }
    }
    parts.sort_by(|a, b| name_order(a, b));
    frames.sort_by(|a, b| name_order(a, b));
    let recorded = parts.first().map(|part| read_head(part, HEAD_BYTES)).transpose()?;
    if recorded.is_some_and(|head| begins_recording(&head)) {
        Ok(Sniffed::Recording { parts })
    } else if !parts.is_empty() {
        Ok(Sniffed::Bag { parts })
    } else if let Some(path) = packed {
        Err(CaptureError::Compressed { path, by: "zstd", command: "zstd -d FILE" })
    } else if !frames.is_empty() {
        Ok(Sniffed::PngFolder { frames })
    } else {
        Err(CaptureError::EmptyFolder { path: path.to_owned() })
    }
}

/// Order of file names in which runs of digits count as numbers: `bag_2` before `bag_10`.
///
/// Names with equally long numbers sort as their bytes do; equal numbers (`1`, `01`) fall back to bytes.
fn name_order(a: &Path, b: &Path) -> Ordering {
    let a = a.file_name().unwrap_or_default().as_encoded_bytes();
    let b = b.file_name().unwrap_or_default().as_encoded_bytes();
    let (mut x, mut y) = (a, b);
    loop {
        let (x_digits, y_digits) = (leading_digits(x), leading_digits(y));
        if !x_digits.is_empty() && !y_digits.is_empty() {
            let (m, n) = (without_zeros(x_digits), without_zeros(y_digits));
            let order = m.len().cmp(&n.len()).then_with(|| m.cmp(n));
            if order != Ordering::Equal {
                return order;
            }
            x = x.get(x_digits.len()..).unwrap_or_default();
            y = y.get(y_digits.len()..).unwrap_or_default();
            continue;
        }
        match (x.split_first(), y.split_first()) {
            (Some((p, x_rest)), Some((q, y_rest))) if p == q => (x, y) = (x_rest, y_rest),
            (Some((p, _)), Some((q, _))) => return p.cmp(q),
            _ => return x.len().cmp(&y.len()).then_with(|| a.cmp(b)),
        }
    }
}

fn leading_digits(bytes: &[u8]) -> &[u8] {
    let end = bytes.iter().position(|byte| !byte.is_ascii_digit()).unwrap_or(bytes.len());
    bytes.get(..end).unwrap_or_default()
}

fn without_zeros(digits: &[u8]) -> &[u8] {
    let start = digits.iter().position(|&digit| digit != b'0').unwrap_or(digits.len());
    digits.get(start..).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn write(folder: &Path, name: &str, content: &[u8]) -> PathBuf {
        let path = folder.join(name);
        fs::write(&path, content).unwrap();
        path
    }

    #[test]
    fn kind_follows_the_content_and_not_the_extension() {
        let folder = tempfile::tempdir().unwrap();
        let disguised = write(folder.path(), "capture.png", &[0x4d, 0x3c, 0xb2, 0xa1, 0, 0]);
        assert_eq!(sniff(&disguised).unwrap(), Sniffed::Pcap);
        let pgm = write(folder.path(), "frame", b"P5 640 480 65535\n");
        assert_eq!(sniff(&pgm).unwrap(), Sniffed::Pgm);
    }

    #[test]
    fn compressed_and_foreign_files_are_refused_with_the_way_out() {
        let folder = tempfile::tempdir().unwrap();
        for (magic, remedy) in [
            (&b"\x1f\x8b\x08\0"[..], "gunzip -k FILE"),
            (b"\x28\xb5\x2f\xfd....", "zstd -d FILE"),
            (b"#ROSBAG V2.0\n", "rosbags-convert"),
            (b"\x34\xcd\xb2\xa1", "editcap"),
            (b"hello, world", "expected .pcap"),
            (b"", "holds no data"),
        ] {
            let path = write(folder.path(), "capture.pcap", magic);
            let message = sniff(&path).unwrap_err().to_string();
            assert!(message.contains(remedy), "{message}");
            assert!(message.contains("capture.pcap"), "{message}");
        }
    }

    #[test]
    fn folders_are_told_apart_by_what_they_hold() {
        let folder = tempfile::tempdir().unwrap();
        assert!(matches!(sniff(folder.path()), Err(CaptureError::EmptyFolder { .. })));
        let b = write(folder.path(), "f10.png", b"");
        let a = write(folder.path(), "f9.png", b"");
        write(folder.path(), "notes.txt", b"");
        assert_eq!(sniff(folder.path()).unwrap(), Sniffed::PngFolder { frames: vec![a, b] });
        let part = write(folder.path(), "bag_0.db3", b"");
        assert_eq!(sniff(folder.path()).unwrap(), Sniffed::Bag { parts: vec![part] });
        write(folder.path(), "INDEX.txt", b"");
        assert_eq!(sniff(folder.path()).unwrap(), Sniffed::FakenectFolder);
    }

    #[test]
    fn numbers_in_names_count_as_numbers() {
        let mut names = ["b_10", "b_9", "b_", "a", "b_09", "b_1", "b_1a"].map(PathBuf::from);
        names.sort_by(|a, b| name_order(a, b));
        assert_eq!(names, ["a", "b_", "b_1", "b_1a", "b_09", "b_9", "b_10"].map(PathBuf::from));
    }

    proptest! {
        #[test]
        fn name_order_is_an_order(a in "[0a_1]{0,6}", b in "[0a_1]{0,6}", c in "[0a_1]{0,6}") {
            let (a, b, c) = (PathBuf::from(a), PathBuf::from(b), PathBuf::from(c));
            prop_assert_eq!(name_order(&a, &b), name_order(&b, &a).reverse());
            prop_assert_eq!(name_order(&a, &b) == Ordering::Equal, a == b);
            if name_order(&a, &b).is_le() && name_order(&b, &c).is_le() {
                prop_assert!(name_order(&a, &c).is_le());
            }
        }
    }
}

//! The real captures, found beside the workspace when they are there.

use std::path::PathBuf;

fn path(relative: &str) -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")).join(relative)
}

/// A capture's bytes; `None`, and a printed line, when it is not there.
pub(crate) fn read(relative: &str) -> Option<Vec<u8>> {
    match std::fs::read(path(relative)) {
        Ok(bytes) => Some(bytes),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            println!("skipped: ../shared/data/{relative} is not there");
            None
        }
        Err(error) => panic!("../shared/data/{relative}: {error}"),
    }
}

/// A text file of the captures.
pub(crate) fn read_text(relative: &str) -> Option<String> {
    read(relative).map(|bytes| String::from_utf8(bytes).expect("text"))
}

/// The pixels of a 640 × 480 grey image of 16 bits.
pub(crate) fn grey16(relative: &str) -> Option<Vec<u16>> {
    let bytes = read(relative)?;
    let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().expect("a PNG");
    let mut pixels = vec![0; reader.output_buffer_size().expect("small")];
    let info = reader.next_frame(&mut pixels).expect("a whole PNG");
    assert_eq!((info.width, info.height), (640, 480));
    assert_eq!((info.color_type, info.bit_depth), (png::ColorType::Grayscale, png::BitDepth::Sixteen));
    Some(pixels.as_chunks::<2>().0.iter().map(|pixel| u16::from_be_bytes(*pixel)).collect())
}

/// The rows of a table of two whole numbers, read without the crate's own parser.
pub(crate) fn csv_pairs(text: &str) -> Vec<(u16, u16)> {
    let row = |row: &str| {
        let (left, right) = row.split_once(',').expect("two fields");
        (left.parse().expect("a code"), right.parse().expect("millimetres"))
    };
    text.lines().skip(1).map(row).collect()
}

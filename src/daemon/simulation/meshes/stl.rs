//! `.stl`, text or binary, by `stl_io`.

use std::collections::BTreeMap;
use std::io::{self, Cursor, Read, Seek, SeekFrom};

use super::Polygons;
use crate::geometry_file::Wrong;

/// Before the triangles of a binary file: 80 bytes that mean nothing, and their number.
const HEADER: usize = 84;
/// Of a triangle in a binary file: normal, three corners, two bytes that mean nothing.
const TRIANGLE: usize = 50;

/// Vertices and faces of an STL. Its length says whether it is binary: many binary files begin like text.
pub(super) fn parse(bytes: &[u8]) -> Result<Polygons, Wrong> {
    let count = bytes.get(80..HEADER).and_then(|count| count.try_into().ok()).map(u32::from_le_bytes);
    let whole = count.and_then(|count| (count as usize).checked_mul(TRIANGLE)?.checked_add(HEADER));
    if whole.is_some_and(|whole| whole == bytes.len()) {
        return binary(bytes);
    }
    if bytes.trim_ascii_start().get(..5).is_some_and(|word| word.eq_ignore_ascii_case(b"solid")) {
        return text(bytes);
    }
    let problem = match (count, whole) {
        (Some(count), Some(whole)) => {
            format!(
                "{} bytes: a binary STL of the {count} triangles it speaks of has {whole}; text begins with `solid`",
                bytes.len()
            )
        }
        _ => format!("{} bytes: an STL has at least {HEADER}, or is text that begins with `solid`", bytes.len()),
    };
    Err(Wrong::new(problem))
}

fn binary(bytes: &[u8]) -> Result<Polygons, Wrong> {
    let mut bytes = bytes.to_vec();
    // The library takes what begins with `solid` for text.
    bytes.iter_mut().take(5).for_each(|byte| *byte = 0);
    let mut solids = Solids::default();
    let triangles = stl_io::create_stl_reader(&mut Cursor::new(bytes))
        .and_then(|mut triangles| triangles.try_for_each(|triangle| triangle.map(|triangle| solids.add(&triangle))));
    triangles.map_err(|error| Wrong::new(error.to_string()))?;
    Ok(solids.polygons)
}

/// Every solid of a text: from `solid` to `endsolid`, in any case.
fn text(bytes: &[u8]) -> Result<Polygons, Wrong> {
    let text = String::from_utf8_lossy(bytes).to_ascii_lowercase();
    let mut solids = Solids::default();
    let mut lines = text.split_inclusive('\n').zip(1..).filter(|(line, _)| !line.trim().is_empty()).peekable();
    while let Some((line, number)) = lines.next() {
        if line.split_whitespace().next() != Some("solid") {
            let problem = format!("`solid` expected, {:?} found", line.trim());
            return Err(Wrong { line: Some(number), problem });
        }
        // The library wants a name after the word.
        let mut solid = vec![("solid -\n", number)];
        for (line, number) in lines.by_ref() {
            solid.push((line, number));
            if line.split_whitespace().next() == Some("endsolid") {
                break;
            }
        }
        let mut reader = LineByLine { lines: &solid, next: 0, into: 0 };
        let read = stl_io::create_stl_reader(&mut reader).and_then(|mut triangles| {
            triangles.try_for_each(|triangle| triangle.map(|triangle| solids.add(&triangle)))
        });
        read.map_err(|error| Wrong { line: reader.line(), problem: error.to_string() })?;
    }
    Ok(solids.polygons)
}

/// Lines that are handed out one at a time, so that it is known how far a reader that reads ahead has come.
struct LineByLine<'a> {
    lines: &'a [(&'a str, usize)],
    next: usize,
    /// Bytes of the next line that have been handed out: a line may be longer than the reader's buffer.
    into: usize,
}

impl LineByLine<'_> {
    /// The number of the line handed out last.
    fn line(&self) -> Option<usize> {
        let last = if self.into > 0 { self.next } else { self.next.saturating_sub(1) };
        self.lines.get(last).map(|(_, number)| *number)
    }
}

impl Read for LineByLine<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let left = self.lines.get(self.next).and_then(|(line, _)| line.as_bytes().get(self.into..)).unwrap_or_default();
        let taken = left.iter().zip(buffer).map(|(from, to)| *to = *from).count();
        self.into += taken;
        if taken == left.len() {
            (self.next, self.into) = (self.next + 1, 0);
        }
        Ok(taken)
    }
}

impl Seek for LineByLine<'_> {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        if to != SeekFrom::Start(0) {
            return Err(io::ErrorKind::Unsupported.into());
        }
        (self.next, self.into) = (0, 0);
        Ok(0)
    }
}

/// Triangles as they come, their corners found again by their bits.
#[derive(Default)]
struct Solids {
    polygons: Polygons,
    known: BTreeMap<[u32; 3], u32>,
}

impl Solids {
    fn add(&mut self, triangle: &stl_io::Triangle) {
        let Self { polygons, known } = self;
        let corner = |vertex: &stl_io::Vertex| {
            *known.entry(vertex.0.map(f32::to_bits)).or_insert_with(|| {
                polygons.vertices.push(vertex.0.map(f64::from));
                polygons.vertices.len() as u32 - 1
            })
        };
        let face = triangle.vertices.iter().map(corner).collect();
        polygons.faces.push(face);
    }
}

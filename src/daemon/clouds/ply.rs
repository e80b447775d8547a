//! Points of a Stanford `.ply`, by `ply-rs-bw`.

use std::borrow::Cow;
use std::io::ErrorKind;

use ply_rs_bw::parser::{ParseError, Parser, Reader};

use crate::geometry_file::Wrong;
use crate::simulation::meshes::ply::{Other, Vertex, fits, has_places};

/// The vertices of a PLY; other elements before them are passed over, those after them are not looked at.
pub(super) fn parse(bytes: &[u8]) -> Result<Vec<[f32; 3]>, Wrong> {
    let bytes = numbers_alone(bytes);
    let mut reader = Reader::new(bytes.as_ref());
    let header = Parser::<Other>::new().read_header(&mut reader).map_err(wrong)?;
    for (name, element) in &header.elements {
        fits(name, element, bytes.len())?;
        if name != "vertex" {
            let _others: Vec<Other> =
                Parser::new().read_payload_for_element(&mut reader, element, &header).map_err(wrong)?;
            continue;
        }
        has_places(element)?;
        let vertices: Vec<Vertex> =
            Parser::new().read_payload_for_element(&mut reader, element, &header).map_err(wrong)?;
        return Ok(vertices.into_iter().map(|vertex| vertex.0.map(|coordinate| coordinate as f32)).collect());
    }
    Err(Wrong::new("no element `vertex`: a PLY of points has one with x, y and z"))
}

/// A text PLY in which `nan` and `inf`, which other programs write for points without a return, are a number too large for
/// a float: the library knows none of these words. Lines stay where they are.
fn numbers_alone(bytes: &[u8]) -> Cow<'_, [u8]> {
    const END: &[u8] = b"end_header";
    let header = bytes.windows(END.len()).position(|window| window == END).and_then(|end| bytes.get(..end));
    let is_text = |header: &[u8]| header.split(|byte| *byte == b'\n').any(|line| line.starts_with(b"format ascii"));
    let Some(header) = header.filter(|header| is_text(header)) else { return Cow::Borrowed(bytes) };
    let body = bytes.get(header.len() + END.len()..).unwrap_or_default();
    let is_none = |word: &[u8]| {
        let name = word.strip_prefix(b"-").or_else(|| word.strip_prefix(b"+")).unwrap_or(word);
        [b"nan".as_slice(), b"inf", b"infinity"].iter().any(|known| name.eq_ignore_ascii_case(known))
    };
    if !body.split(u8::is_ascii_whitespace).any(is_none) {
        return Cow::Borrowed(bytes);
    }
    let mut rewritten = [header, END].concat();
    for piece in body.split_inclusive(u8::is_ascii_whitespace) {
        let (word, space) =
            piece.split_at(piece.len() - usize::from(piece.last().is_some_and(u8::is_ascii_whitespace)));
        rewritten.extend_from_slice(if is_none(word) { b"1e39" } else { word });
        rewritten.extend_from_slice(space);
    }
    Cow::Owned(rewritten)
}

fn wrong(error: ParseError) -> Wrong {
    let told: Vec<String> = error.to_string().lines().map(|line| line.trim().to_owned()).collect();
    let problem = match error.kind() {
        ErrorKind::UnexpectedEof => format!("the file ends too early: {}", told.join(" ")),
        _ => told.join(" "),
    };
    Wrong { line: error.line(), problem }
}

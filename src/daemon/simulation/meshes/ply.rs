//! Stanford `.ply`, text or binary, by `ply-rs-bw`.

use std::io::ErrorKind;

use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Property, PropertyAccess, PropertyAccessResult};

use super::Polygons;
use crate::geometry_file::Wrong;

/// Vertices and faces of a PLY.
pub(super) fn parse(bytes: &[u8]) -> Result<Polygons, Wrong> {
    let mut reader = Reader::new(bytes);
    let header = Parser::<Other>::new().read_header(&mut reader).map_err(wrong)?;
    let mut polygons = Polygons::default();
    for (name, element) in &header.elements {
        fits(name, element, bytes.len())?;
        match name.as_str() {
            "vertex" => {
                has_places(element)?;
                let vertices: Vec<Vertex> =
                    Parser::new().read_payload_for_element(&mut reader, element, &header).map_err(wrong)?;
                polygons.vertices = vertices.into_iter().map(|vertex| vertex.0).collect();
            }
            "face" => {
                let faces: Vec<Face> =
                    Parser::new().read_payload_for_element(&mut reader, element, &header).map_err(wrong)?;
                polygons.faces = faces.into_iter().map(|face| face.0).collect();
            }
            _ => {
                let _others: Vec<Other> =
                    Parser::new().read_payload_for_element(&mut reader, element, &header).map_err(wrong)?;
            }
        }
    }
    Ok(polygons)
}

/// Whether so many elements can be there: every one takes a byte at least, and more would be counted through for nothing.
pub(crate) fn fits(name: &str, element: &ElementDef, bytes: usize) -> Result<(), Wrong> {
    if element.count > bytes {
        return Err(Wrong::new(format!("{} elements `{name}` in {bytes} bytes", element.count)));
    }
    Ok(())
}

/// Whether the vertices have x, y and z.
pub(crate) fn has_places(vertex: &ElementDef) -> Result<(), Wrong> {
    match ["x", "y", "z"].into_iter().find(|axis| !vertex.properties.contains_key(*axis)) {
        Some(axis) => Err(Wrong::new(format!("`vertex` has no property `{axis}`: x, y and z expected"))),
        None => Ok(()),
    }
}

fn wrong(error: ParseError) -> Wrong {
    let problem = match error.kind() {
        ErrorKind::UnexpectedEof => format!("the file ends too early: {error}"),
        _ => error.to_string(),
    };
    Wrong { line: error.line(), problem }
}

/// Coordinates; other properties are passed over.
#[derive(Clone, Copy)]
pub(crate) struct Vertex(pub(crate) [f64; 3]);

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self([0.0; 3])
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let [x, y, z] = &mut self.0;
        let coordinate = match name {
            "x" => x,
            "y" => y,
            "z" => z,
            _ => return PropertyAccessResult::Ignored,
        };
        *coordinate = match property {
            Property::Float(value) => f64::from(value),
            Property::Double(value) => value,
            Property::Char(value) => f64::from(value),
            Property::UChar(value) => f64::from(value),
            Property::Short(value) => f64::from(value),
            Property::UShort(value) => f64::from(value),
            Property::Int(value) => f64::from(value),
            Property::UInt(value) => f64::from(value),
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// Places in the list of vertices.
struct Face(Vec<u32>);

impl PropertyAccess for Face {
    fn new() -> Self {
        Self(Vec::new())
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if !matches!(name, "vertex_indices" | "vertex_index") {
            return PropertyAccessResult::Ignored;
        }
        match property.to_u32_list() {
            Some(corners) => {
                self.0 = corners;
                PropertyAccessResult::Set
            }
            None => PropertyAccessResult::UnsupportedType,
        }
    }
}

/// What is not used: edges, materials.
pub(crate) struct Other;

impl PropertyAccess for Other {
    fn new() -> Self {
        Self
    }
}

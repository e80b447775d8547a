//! Points as a table of typed columns, written as CSV, PLY or PCD.
//!
//! The number of points stands in the header of PLY and PCD files and is known only at the end. The header is padded
//! by a comment to a length that does not depend on it, written first without the number, and over again at the end.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::Format;
use super::outfile::OutFile;
use super::protected::Protected;
use crate::cli::Failure;

/// A column: its name as other programs know it, and its type.
pub(super) struct Column {
    pub(super) name: &'static str,
    pub(super) kind: Kind,
}

/// Column types; each has a name in PLY and in PCD.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    F32,
    I32,
    U32,
    U16,
    U8,
}

impl Kind {
    const fn bytes(self) -> usize {
        match self {
            Self::F32 | Self::I32 | Self::U32 => 4,
            Self::U16 => 2,
            Self::U8 => 1,
        }
    }

    const fn ply(self) -> &'static str {
        match self {
            Self::F32 => "float",
            Self::I32 => "int",
            Self::U32 => "uint",
            Self::U16 => "ushort",
            Self::U8 => "uchar",
        }
    }

    const fn pcd(self) -> char {
        match self {
            Self::F32 => 'F',
            Self::I32 => 'I',
            Self::U32 | Self::U16 | Self::U8 => 'U',
        }
    }
}

/// One value of a row; must be of its column's kind.
#[derive(Clone, Copy, Debug)]
pub(super) enum Value {
    F32(f32),
    I32(i32),
    U32(u32),
    U16(u16),
    U8(u8),
}

impl Value {
    const fn kind(self) -> Kind {
        match self {
            Self::F32(_) => Kind::F32,
            Self::I32(_) => Kind::I32,
            Self::U32(_) => Kind::U32,
            Self::U16(_) => Kind::U16,
            Self::U8(_) => Kind::U8,
        }
    }
}

/// A table file being written.
pub(super) struct TableFile {
    file: OutFile,
    format: Format,
    columns: &'static [Column],
    comments: Vec<String>,
    rows: u64,
    line: Vec<u8>,
    text: String,
}

impl TableFile {
    /// Begins a file of the given columns; `comments` (units, frame) go into its header where the format has room.
    pub(super) fn create(
        path: &Path,
        format: Format,
        columns: &'static [Column],
        comments: Vec<String>,
        protected: &Protected,
    ) -> Result<Self, Failure> {
        let file = OutFile::create(path, format != Format::Csv, protected)?;
        let mut table = Self { file, format, columns, comments, rows: 0, line: Vec::new(), text: String::new() };
        let header = table.header();
        table.file.write(header.as_bytes())?;
        Ok(table)
    }

    /// Appends one row.
    pub(super) fn row(&mut self, values: &[Value]) -> Result<(), Failure> {
        debug_assert!(values.iter().map(|value| value.kind()).eq(self.columns.iter().map(|column| column.kind)));
        self.rows += 1;
        if self.format == Format::Csv {
            self.text.clear();
            for (index, value) in values.iter().enumerate() {
                let comma = if index == 0 { "" } else { "," };
                // Writing to a String does not fail. `{}` of an f32 is the shortest text that reads back the same.
                match value {
                    Value::F32(v) => write!(self.text, "{comma}{v}"),
                    Value::I32(v) => write!(self.text, "{comma}{v}"),
                    Value::U32(v) => write!(self.text, "{comma}{v}"),
                    Value::U16(v) => write!(self.text, "{comma}{v}"),
                    Value::U8(v) => write!(self.text, "{comma}{v}"),
                }
                .unwrap_or_default();
            }
            self.text.push('\n');
            return self.file.write(self.text.as_bytes());
        }
        self.line.clear();
        for value in values {
            match value {
                Value::F32(v) => self.line.extend(v.to_le_bytes()),
                Value::I32(v) => self.line.extend(v.to_le_bytes()),
                Value::U32(v) => self.line.extend(v.to_le_bytes()),
                Value::U16(v) => self.line.extend(v.to_le_bytes()),
                Value::U8(v) => self.line.push(*v),
            }
        }
        self.file.write(&self.line)
    }

    /// Completes the header and puts the file in its place.
    pub(super) fn finish(self) -> Result<PathBuf, Failure> {
        let header = if self.format == Format::Csv { String::new() } else { self.header() };
        self.file.finish(header.as_bytes())
    }

    fn header(&self) -> String {
        match self.format {
            Format::Ply => self.ply_header(),
            Format::Pcd => self.pcd_header(),
            _ => {
                let names: Vec<&str> = self.columns.iter().map(|column| column.name).collect();
                format!("{}\n", names.join(","))
            }
        }
    }

    fn ply_header(&self) -> String {
        let mut text = String::from("ply\nformat binary_little_endian 1.0\n");
        for comment in &self.comments {
            text.push_str(&format!("comment {comment}\n"));
        }
        text.push_str(&format!("comment {}\nelement vertex {}\n", self.padding(1), self.rows));
        for Column { name, kind } in self.columns {
            text.push_str(&format!("property {} {name}\n", kind.ply()));
        }
        text.push_str("end_header\n");
        text
    }

    fn pcd_header(&self) -> String {
        let mut text = String::from("# .PCD v0.7 - Point Cloud Data file format\n");
        for comment in &self.comments {
            text.push_str(&format!("# {comment}\n"));
        }
        // The number of points stands twice.
        text.push_str(&format!("# {}\nVERSION 0.7\n", self.padding(2)));
        let list = |item: &dyn Fn(&Column) -> String| self.columns.iter().map(item).collect::<Vec<_>>().join(" ");
        text.push_str(&format!("FIELDS {}\n", list(&|column| column.name.to_owned())));
        text.push_str(&format!("SIZE {}\n", list(&|column| column.kind.bytes().to_string())));
        text.push_str(&format!("TYPE {}\n", list(&|column| column.kind.pcd().to_string())));
        text.push_str(&format!("COUNT {}\n", list(&|_| "1".to_owned())));
        text.push_str(&format!("WIDTH {0}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {0}\nDATA binary\n", self.rows));
        text
    }

    /// Dots that make up for the digits of the number of rows, wherever it stands `times` times.
    fn padding(&self, times: usize) -> String {
        const LONGEST: usize = 20; // digits of u64::MAX
        ".".repeat((LONGEST - self.rows.to_string().len()) * times)
    }
}

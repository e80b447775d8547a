//! A device's own depth table, as text.
//!
//! ```text
//! raw11,depth_mm
//! 658,801
//! 659,803.5
//! ```
//!
//! The first line is the heading. Then one line per code: the code, ascending, and its depth in millimetres, with a
//! fraction if there is one. Codes left out have no depth. Empty lines and lines that begin with `#` are passed over.

use crate::frame::{FIRST_INVALID_RAW, RAW_CODES, RawDisparity};
use crate::table::DepthTable;
use core::str::FromStr;

/// The first line of a table.
pub const HEADING: &str = "raw11,depth_mm";

/// Why a text is not a depth table. Lines count from 1.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum TableCsvError {
    /// The heading is missing, or another.
    #[error("line {line}: expected the heading `raw11,depth_mm`: write it as the first line")]
    Heading {
        /// Where.
        line: usize,
    },
    /// Not two fields.
    #[error("line {line}: {found} fields, expected 2: a code and its depth in mm, as in `658,801`")]
    Fields {
        /// Where.
        line: usize,
        /// Fields found.
        found: usize,
    },
    /// The first field is not a code.
    #[error("line {line}: the first field is not a raw disparity: write a whole number, 0 to 2047")]
    Code {
        /// Where.
        line: usize,
    },
    /// The second field is not a depth.
    #[error("line {line}: the second field is not a depth: write millimetres, 0 to 65535")]
    Depth {
        /// Where.
        line: usize,
    },
    /// A code that is not above the one before it.
    #[error("line {line}: raw11 {found} after {before}: sort the rows by raw11 and keep one of each")]
    Order {
        /// Where.
        line: usize,
        /// The code of this line.
        found: u16,
        /// The code of the line before.
        before: u16,
    },
    /// A depth below the one before it.
    #[error(
        "line {line}: {found} mm after {before} mm: depth never falls as raw11 rises; is a row wrong or are the columns swapped?"
    )]
    Falling {
        /// Where.
        line: usize,
        /// The depth of this line, mm.
        found: f64,
        /// The depth of the line before, mm.
        before: f64,
    },
    /// No row gives a depth.
    #[error("no row gives a depth: expected codes below 1055 with 1 to 9999 mm")]
    Empty,
}

impl FromStr for DepthTable {
    type Err = TableCsvError;

    /// Reads a per-device table. Codes of 1055 and more and depths of 0 or of 10 000 mm and more are allowed and stand
    /// for no data; so the whole table libfreenect builds can be given, its overflowed end included.
    fn from_str(text: &str) -> Result<Self, TableCsvError> {
        let text = text.strip_prefix('\u{FEFF}').unwrap_or(text); // a spreadsheet's byte order mark
        let mut rows = text
            .lines()
            .enumerate()
            .map(|(i, row)| (i + 1, row.trim()))
            .filter(|(_, row)| !row.is_empty() && !row.starts_with('#'));
        match rows.next() {
            Some((_, HEADING)) => {}
            Some((line, _)) => return Err(TableCsvError::Heading { line }),
            None => return Err(TableCsvError::Heading { line: 1 }),
        }
        let mut table = Self::empty();
        let mut code_before: Option<u16> = None;
        let mut mm_before = 0.0;
        for (line, row) in rows {
            let (code, mm) = parse_row(line, row)?;
            if let Some(before) = code_before.replace(code).filter(|&before| code <= before) {
                return Err(TableCsvError::Order { line, found: code, before });
            }
            // 0 says "none" anywhere, and past the last real code a table may hold anything.
            if mm > 0.0 && code < FIRST_INVALID_RAW {
                if mm < mm_before {
                    return Err(TableCsvError::Falling { line, found: mm, before: mm_before });
                }
                mm_before = mm;
            }
            table.set(RawDisparity(code), mm / 1_000.0, mm.round() as u16);
        }
        if table.depths() == 0 { Err(TableCsvError::Empty) } else { Ok(table) }
    }
}

fn parse_row(line: usize, row: &str) -> Result<(u16, f64), TableCsvError> {
    let found = row.split(',').count();
    let (2, Some((code, mm))) = (found, row.split_once(',')) else {
        return Err(TableCsvError::Fields { line, found });
    };
    let code = code.trim().parse::<u16>().ok().filter(|&code| usize::from(code) < RAW_CODES);
    let code = code.ok_or(TableCsvError::Code { line })?;
    let mm = mm.trim().parse::<f64>().ok().filter(|mm| (0.0..=f64::from(u16::MAX)).contains(mm)); // NaN is in no range
    Ok((code, mm.ok_or(TableCsvError::Depth { line })?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn rows_give_depths_and_missing_rows_give_none() {
        let table: DepthTable = "raw11,depth_mm\n658,801\n\n# a remark\n660,806.25\r\n".parse().expect("a table");
        assert_eq!((table.mm()[658], table.mm()[659], table.mm()[660]), (801, 0, 806));
        assert_eq!((table.metres()[658], table.metres()[659], table.metres()[660]), (0.801, 0.0, 0.806_25));
        assert_eq!(table.depths(), 2);
    }

    #[test]
    fn rows_that_cannot_be_depths_are_read_and_stand_for_none() {
        let table: DepthTable =
            "raw11,depth_mm\n0,0\n1,317\n2,0\n1054,10000\n1060,300\n2047,0".parse().expect("a table");
        assert_eq!(table.depths(), 1);
    }

    #[test]
    fn errors_name_the_line() {
        let expected = [
            ("", TableCsvError::Heading { line: 1 }),
            ("\n658,801", TableCsvError::Heading { line: 2 }),
            ("raw11,depth_mm\n658", TableCsvError::Fields { line: 2, found: 1 }),
            ("raw11,depth_mm\n658,801,7", TableCsvError::Fields { line: 2, found: 3 }),
            ("raw11,depth_mm\n#\n2048,801", TableCsvError::Code { line: 3 }),
            ("raw11,depth_mm\n-1,801", TableCsvError::Code { line: 2 }),
            ("raw11,depth_mm\n5,NaN", TableCsvError::Depth { line: 2 }),
            ("raw11,depth_mm\n5,-1", TableCsvError::Depth { line: 2 }),
            ("raw11,depth_mm\n5,70000", TableCsvError::Depth { line: 2 }),
            ("raw11,depth_mm\n5,400\n5,401", TableCsvError::Order { line: 3, found: 5, before: 5 }),
            ("raw11,depth_mm\n5,400\n6,399", TableCsvError::Falling { line: 3, found: 399.0, before: 400.0 }),
            ("raw11,depth_mm\n", TableCsvError::Empty),
        ];
        for (text, error) in expected {
            assert_eq!(text.parse::<DepthTable>(), Err(error), "{text:?}");
        }
    }

    #[test]
    fn whole_millimetres_are_the_same_metres_by_table_and_by_division() {
        // A frame in millimetres is divided by 1000 in f32; the same depth by table must be the same number.
        for mm in 1..10_000_u16 {
            let table: DepthTable = format!("{HEADING}\n7,{mm}").parse().expect("one row");
            assert_eq!(table.metres()[7], f32::from(mm) / 1_000.0);
        }
    }

    proptest! {
        #[test]
        fn arbitrary_text_is_a_table_or_an_error(text in prop_oneof![
            ".{0,200}",
            "(raw11,depth_mm\n)?([0-9.,#\n -]{0,80})",
            "raw11,depth_mm\n([0-9]{1,4},[0-9]{1,5}\n){0,12}",
            proptest::collection::vec(any::<u8>(), 0..200).prop_map(|bytes| String::from_utf8_lossy(&bytes).into_owned()),
        ]) {
            if let Ok(table) = text.parse::<DepthTable>() {
                prop_assert!(table.depths() > 0);
                prop_assert!(table.mm().iter().all(|&mm| mm < 10_000));
            }
        }
    }
}

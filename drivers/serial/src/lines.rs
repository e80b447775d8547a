//! A stream of bytes cut into lines of text, whatever the reads cut it into.

use tumbled_model::RigNs;

/// Cuts bytes into lines. Holds one unfinished line, never more than its limit.
///
/// A line ends with CR, LF or both; empty lines are none. Only printable ASCII is text: a line with any other byte in
/// it, or longer than the limit, is given up as a whole, so that damage never reaches past the next line end.
#[derive(Clone, Debug)]
pub struct Lines {
    line: String,
    limit: usize,
    /// When the unfinished line's first byte was there.
    begun: Option<RigNs>,
    fault: Option<LineFault>,
}

/// A line, or what took its place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Line<'a> {
    /// When its first byte was there: the instant given with the chunk that held it.
    pub begun: RigNs,
    /// The text without its end, or why there is none.
    pub text: Result<&'a str, LineFault>,
}

/// Why a line was given up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, thiserror::Error)]
pub enum LineFault {
    /// It holds a byte that is not printable ASCII.
    #[error("a byte that is not printable ASCII")]
    NotText,
    /// It is longer than any line may be.
    #[error("longer than a line may be")]
    TooLong,
}

impl Lines {
    /// Lines of at most `limit` bytes, their ends not counted.
    pub fn new(limit: usize) -> Self {
        Self { line: String::with_capacity(limit), limit, begun: None, fault: None }
    }

    /// Takes the bytes one read gave at `at`, and hands over each line that ends in them.
    pub fn push(&mut self, at: RigNs, bytes: &[u8], mut each: impl FnMut(Line<'_>)) {
        for &byte in bytes {
            if matches!(byte, b'\r' | b'\n') {
                if let Some(begun) = self.begun.take() {
                    let text = match self.fault.take() {
                        Some(fault) => Err(fault),
                        None => Ok(self.line.as_str()),
                    };
                    each(Line { begun, text });
                }
                self.line.clear();
                continue;
            }
            self.begun.get_or_insert(at);
            if self.fault.is_some() {
                continue;
            }
            if !matches!(byte, b' '..=b'~') {
                self.fault = Some(LineFault::NotText);
            } else if self.line.len() == self.limit {
                self.fault = Some(LineFault::TooLong);
            } else {
                self.line.push(char::from(byte));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn read(chunks: &[(i64, &[u8])]) -> Vec<(i64, Result<String, LineFault>)> {
        let mut lines = Lines::new(8);
        let mut found = Vec::new();
        for (at, bytes) in chunks {
            lines.push(RigNs(*at), bytes, |line| found.push((line.begun.0, line.text.map(str::to_owned))));
        }
        found
    }

    #[test]
    fn a_line_has_the_time_of_its_first_byte_however_the_reads_fall() {
        let found = read(&[(1, b"ab"), (2, b"c\r"), (3, b"\n"), (4, b"d\re\nf")]);
        let line = |text: &str| Ok(text.to_owned());
        // CR and LF in two reads make no empty line; "f" has not ended.
        assert_eq!(found, [(1, line("abc")), (4, line("d")), (4, line("e"))]);
    }

    #[test]
    fn damage_ends_with_the_line() {
        let found = read(&[(1, b"ab\x80cd\nok\n123456789\n12345678\n")]);
        assert_eq!(
            found,
            [
                (1, Err(LineFault::NotText)),
                (1, Ok("ok".to_owned())),
                (1, Err(LineFault::TooLong)),
                (1, Ok("12345678".to_owned()))
            ]
        );
    }

    proptest! {
        #[test]
        fn any_cut_of_any_bytes_gives_the_same_lines(
            bytes in prop::collection::vec(prop_oneof![any::<u8>(), Just(b'\n'), b'0'..=b'9'], 0..200),
            cut in 1usize..20,
        ) {
            let cuts: Vec<(i64, &[u8])> = bytes.chunks(cut).map(|chunk| (0, chunk)).collect();
            let whole = read(&[(0, &bytes)]);
            prop_assert_eq!(&read(&cuts), &whole);
            prop_assert!(whole.iter().flat_map(|(_, text)| text).all(|text| (1..=8).contains(&text.len())));
        }
    }
}

//! What the library under test did, line by line: `SECONDS EVENT DETAILS`.

use std::path::Path;
use std::{fs, io};

/// One line.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Seconds after the host's first `libusb_init`.
    pub seconds: f64,
    /// What happened, one word; `error` is a use of libusb that is never right.
    pub event: String,
    /// The details, `name=value` and so on.
    pub details: String,
}

impl Entry {
    /// The value of `name=value` among the details.
    pub fn value(&self, name: &str) -> Option<&str> {
        self.details.split(' ').find_map(|word| word.strip_prefix(name)?.strip_prefix('='))
    }
}

/// The whole file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Journal {
    /// Its lines, in order.
    pub entries: Vec<Entry>,
}

impl Journal {
    /// Reads a journal; what is being written may be read.
    pub fn read(path: &Path) -> io::Result<Self> {
        let text = fs::read_to_string(path)?;
        let whole = text.rfind('\n').map_or("", |end| &text[..end]);
        let entries: Option<Vec<Entry>> = whole.lines().map(entry).collect();
        let entries =
            entries.ok_or_else(|| io::Error::new(io::ErrorKind::InvalidData, "a line without time or event"))?;
        Ok(Self { entries })
    }

    /// The lines of one event.
    pub fn of<'a>(&'a self, event: &'a str) -> impl Iterator<Item = &'a Entry> {
        self.entries.iter().filter(move |entry| entry.event == event)
    }

    /// How often it happened.
    pub fn count(&self, event: &str) -> usize {
        self.of(event).count()
    }
}

fn entry(line: &str) -> Option<Entry> {
    let (seconds, rest) = line.split_once(' ')?;
    let (event, details) = rest.split_once(' ').unwrap_or((rest, ""));
    Some(Entry { seconds: seconds.parse().ok()?, event: event.to_owned(), details: details.to_owned() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn details_are_found_by_their_whole_name() {
        let entry = entry("0.250000 open device=0 what=camera handle=3").expect("a line");
        assert_eq!((entry.seconds, entry.event.as_str()), (0.25, "open"));
        assert_eq!(entry.value("what"), Some("camera"));
        assert_eq!(entry.value("hand"), None);
        assert_eq!(entry.value("port"), None);
    }
}

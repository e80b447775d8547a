//! What the devices sent, and what of it was lost.
//!
//! The stand-in writes a line as each thing happens; `DEVICE` and `FRAME` count from 0, `FRAME` over the stand-in's life:
//!
//! ```text
//! frame DEVICE FRAME TICKS SECONDS PACKETS   begun, SECONDS after the first libusb_init
//! lost DEVICE FRAME PACKET                   dropped by the script
//! late DEVICE FRAME PACKET                   sent when no transfer was there to take it
//! corrupt DEVICE FRAME PACKET KIND           damaged by the script
//! end DEVICE FRAME SENT                      SENT < PACKETS: cut by an unplug or a stop
//! ```

use std::collections::BTreeMap;
use std::path::Path;
use std::{fs, io};

/// One frame as it was sent.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameTruth {
    /// Its number, from 0 over the stand-in's life.
    pub number: u64,
    /// The device's 60 MHz clock.
    pub ticks: u32,
    /// When it was begun, in seconds after the host's first `libusb_init`.
    pub seconds: f64,
    /// Packets it consists of: 242, or 220 of ten bits.
    pub packets: u16,
    /// Packets the script dropped, ascending.
    pub lost: Vec<u16>,
    /// Packets for which the host had no transfer ready, ascending.
    pub late: Vec<u16>,
    /// Packets the script damaged, ascending, and how.
    pub corrupt: Vec<(u16, String)>,
    /// How many of its packets were sent, lost ones included; `None` while it is being sent.
    pub sent: Option<u16>,
}

impl FrameTruth {
    /// Whether every packet reached the host undamaged.
    pub fn is_whole(&self) -> bool {
        self.sent == Some(self.packets) && self.lost.is_empty() && self.late.is_empty() && self.corrupt.is_empty()
    }

    /// The packets that did not reach the host, ascending.
    pub fn missing(&self) -> Vec<u16> {
        let mut missing: Vec<u16> = self.lost.iter().chain(&self.late).copied().collect();
        missing.extend(self.sent.unwrap_or(self.packets)..self.packets);
        missing.sort_unstable();
        missing
    }
}

/// A truth file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Truth {
    devices: BTreeMap<usize, BTreeMap<u64, FrameTruth>>,
}

impl Truth {
    /// Reads a truth file; what is being written may be read.
    pub fn read(path: &Path) -> io::Result<Self> {
        Self::parse(&fs::read_to_string(path)?)
            .map_err(|line| io::Error::new(io::ErrorKind::InvalidData, format!("`{line}` is no line of a truth file")))
    }

    /// Reads a truth file's text; the error is the line that is none. A last line without its end is left out.
    pub fn parse(text: &str) -> Result<Self, String> {
        let mut truth = Self::default();
        let whole = text.rfind('\n').map_or("", |end| &text[..end]);
        for line in whole.lines() {
            truth.line(line).ok_or_else(|| line.to_owned())?;
        }
        Ok(truth)
    }

    /// The frames of one device, in the order in which they were sent.
    pub fn frames(&self, device: usize) -> impl Iterator<Item = &FrameTruth> {
        self.devices.get(&device).into_iter().flat_map(BTreeMap::values)
    }

    fn line(&mut self, line: &str) -> Option<()> {
        let mut words = line.split(' ');
        let name = words.next()?;
        let frames = self.devices.entry(words.next()?.parse().ok()?).or_default();
        let number = words.next()?.parse().ok()?;
        let frame = frames.entry(number).or_insert_with(|| FrameTruth { number, ..FrameTruth::default() });
        match name {
            "frame" => {
                frame.ticks = words.next()?.parse().ok()?;
                frame.seconds = words.next()?.parse().ok()?;
                frame.packets = words.next()?.parse().ok()?;
            }
            "lost" => frame.lost.push(words.next()?.parse().ok()?),
            "late" => frame.late.push(words.next()?.parse().ok()?),
            "corrupt" => frame.corrupt.push((words.next()?.parse().ok()?, words.next()?.to_owned())),
            "end" => frame.sent = Some(words.next()?.parse().ok()?),
            _ => return None,
        }
        words.next().is_none().then_some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn frames_are_put_together_from_their_lines() {
        let text = "frame 0 0 7 1.5 242\nlost 0 0 17\nlate 0 0 3\nend 0 0 242\n\
                    frame 0 1 9 1.6 242\ncorrupt 0 1 5 short\nend 0 1 240\nframe 1 0 7 1.5 242\nframe 1 1 7";
        let truth = Truth::parse(text).expect("a truth");
        let frames: Vec<_> = truth.frames(0).collect();
        assert_eq!((frames[0].ticks, frames[0].seconds, frames[0].sent), (7, 1.5, Some(242)));
        assert_eq!(frames[0].missing(), [3, 17]);
        assert_eq!(frames[1].missing(), [240, 241]); // cut
        assert_eq!(frames[1].corrupt, [(5, "short".to_owned())]);
        assert!(!frames[0].is_whole() && !frames[1].is_whole());
        // The last line is still being written.
        assert_eq!(truth.frames(1).map(|frame| frame.sent).collect::<Vec<_>>(), [None]);
        assert_eq!(Truth::parse("sent 0 0 1\n"), Err("sent 0 0 1".to_owned()));
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in "((frame|lost|late|end|corrupt) [0-9. ]{0,20}\n){0,4}") {
            if let Err(line) = Truth::parse(&text) {
                prop_assert!(text.contains(&line));
            }
        }
    }
}

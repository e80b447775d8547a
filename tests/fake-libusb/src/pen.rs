//! A file that is written to by a thread of its own.
//!
//! The bus must not wait for a disk: a write to a busy one may take longer than the 32 ms that the host has transfers for.

use std::fs::File;
use std::io::{self, Write};
use std::path::Path;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

/// Lines between the two threads: a minute of losses at their worst.
const WAITING: usize = 65_536;

/// A way to a file.
#[derive(Debug)]
pub(crate) struct Pen {
    orders: SyncSender<Order>,
}

#[derive(Debug)]
enum Order {
    Line(String),
    /// Answered when everything before it is in the file.
    Flush(SyncSender<()>),
}

impl Pen {
    pub(crate) fn create(path: &Path) -> io::Result<Self> {
        let file = File::create(path)?;
        let (orders, taken) = sync_channel(WAITING);
        thread::Builder::new().name("usb-pen".into()).spawn(move || write(file, &taken))?;
        Ok(Self { orders })
    }

    /// Writes a line soon.
    pub(crate) fn line(&self, line: String) {
        // A file that could not be written to was given up, and said so.
        drop(self.orders.send(Order::Line(line)));
    }

    /// Waits until every line is in the file.
    pub(crate) fn flush(&self) {
        let (done, wait) = sync_channel(1);
        if self.orders.send(Order::Flush(done)).is_ok() {
            // An error means that the file was given up: nothing is waited for.
            wait.recv().unwrap_or(());
        }
    }
}

/// One write per line, so that a test may read on while the child runs.
fn write(mut file: File, orders: &Receiver<Order>) {
    for order in orders {
        match order {
            Order::Line(line) => {
                if let Err(error) = file.write_all(line.as_bytes()) {
                    eprintln!("fake-libusb: cannot write: {error}");
                    return;
                }
            }
            Order::Flush(done) => done.send(()).unwrap_or(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_written_is_in_the_file_after_a_flush() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("truth");
        let pen = Pen::create(&path).expect("creates");
        let expected: String = (0..1_000).map(|n| format!("frame {n}\n")).collect();
        expected.split_inclusive('\n').for_each(|line| pen.line(line.to_owned()));
        pen.flush();
        assert_eq!(std::fs::read_to_string(&path).expect("reads"), expected);
    }
}

//! A client of the stream whose connection another server of the daemon holds: it is admitted, bounded and counted as the
//! stream's own clients are.

use std::time::{Duration, Instant};

use tokio::time::sleep_until;

use super::class::Class;
use super::hub::Admitted;
use super::queue::Next;

/// Such a client. It has left when this is dropped.
#[derive(Debug)]
pub struct Subscriber {
    client: Admitted,
    seq: u64,
    /// Dropped since the last line that was kept.
    dropped: u64,
}

impl Subscriber {
    pub(super) fn new(client: Admitted) -> Self {
        Self { client, seq: 0, dropped: 0 }
    }

    /// Waits for the next line that `keep` keeps: it is shown the class and the line without its last keys. A line that it
    /// leaves out has no number and is not counted as dropped. `None`: all is said, or too much waits; close the connection.
    /// Nothing is lost if the waiting is given up.
    pub async fn next(&mut self, mut keep: impl FnMut(Class, &[u8]) -> bool) -> Option<String> {
        loop {
            let queue = &self.client.queue;
            match queue.next(Instant::now()) {
                Next::Line { frame, dropped } => {
                    self.dropped += dropped;
                    if !keep(frame.class, frame.stem()) {
                        continue;
                    }
                    let tail = frame.tail(self.seq, std::mem::take(&mut self.dropped));
                    self.seq += 1;
                    // A frame is made of a text.
                    let mut line = String::from_utf8_lossy(frame.stem()).into_owned();
                    line.push_str(tail.trim_end());
                    return Some(line);
                }
                Next::Wait(due) => {
                    let due = due.unwrap_or_else(|| Instant::now() + Duration::from_secs(60));
                    tokio::select! {
                        () = queue.ready() => {}
                        () = queue.cut() => {
                            self.count_cut_off();
                            return None;
                        }
                        () = sleep_until(due.into()) => {}
                    }
                }
                Next::End => return None,
            }
        }
    }

    /// How long it may take to take a line before it is to be cut off.
    pub fn lag(&self) -> Duration {
        self.client.hub.limits.lag
    }

    /// It was cut off: it did not read.
    pub fn count_cut_off(&self) {
        self.client.hub.count_cut_off();
    }
}

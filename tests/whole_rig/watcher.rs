//! A client that reads every state, and what the daemon's process takes of the machine meanwhile.

use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpStream};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use serde_json::Value;

/// Reads until the daemon ends.
pub(crate) struct Watcher {
    states: JoinHandle<Seen>,
    processor: JoinHandle<Option<f64>>,
}

/// What came.
#[derive(Debug, Default)]
pub(crate) struct Seen {
    /// Of each state of a frame and of a crossing: from its last byte to the line, waiting and computing, ms.
    pub(crate) after_last_byte_ms: [Vec<f64>; 2],
    /// Of each state of an epoch: from the middle of its exposure or crossing to the line, ms.
    pub(crate) total_ms: Vec<f64>,
    /// States of epochs that were tracked.
    pub(crate) tracked: usize,
    /// Predicted states.
    pub(crate) predicted: usize,
    /// Processors that the daemon kept busy, from 5 s after its start to its end.
    pub(crate) processors: Option<f64>,
}

impl Watcher {
    /// Watches the process `id`, whose states come from `stream`.
    pub(crate) fn start(stream: SocketAddr, id: u32) -> Self {
        let mut client = TcpStream::connect(stream).expect("connects");
        client.write_all(b"{\"subscribe\":[\"STATE\"]}\n").expect("sends");
        let states = std::thread::spawn(move || {
            let mut seen = Seen::default();
            for line in BufReader::new(client).lines().map_while(Result::ok) {
                let Ok(line) = serde_json::from_str::<Value>(&line) else { break };
                if line["class"] == "STATE" {
                    seen.take(&line);
                }
            }
            seen
        });
        Self { states, processor: std::thread::spawn(move || processors(id)) }
    }

    /// What came, once the daemon has ended.
    pub(crate) fn seen(self) -> Seen {
        let mut seen = self.states.join().expect("no panic");
        seen.processors = self.processor.join().expect("no panic");
        seen
    }
}

impl Seen {
    fn take(&mut self, state: &Value) {
        if state["kind"] == "predicted" {
            self.predicted += 1;
            return;
        }
        self.tracked += usize::from(state["mode"] == "tracking");
        // The states that a session's end lets out say nothing of their delivery.
        let ms = |key: &str| state["delivery"]["latency_ms"][key].as_f64();
        if let (Some(wait), Some(compute), Some(total)) = (ms("wait"), ms("compute"), ms("total")) {
            let [frames, crossings] = &mut self.after_last_byte_ms;
            if state["inputs"]["sensor"] == "kinect" { frames } else { crossings }.push(wait + compute);
            self.total_ms.push(total);
        }
    }
}

/// The share of `values` that is not above the result; 0 of none.
pub(crate) fn percentile(values: &[f64], share: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = (share * (sorted.len().saturating_sub(1)) as f64).round() as usize;
    sorted.get(at).copied().unwrap_or(0.0)
}

/// Processor seconds a second of the process `id`, looked at until it is gone.
fn processors(id: u32) -> Option<f64> {
    std::thread::sleep(Duration::from_secs(5));
    let (begun, first) = (Instant::now(), processor_seconds(id)?);
    let (mut until, mut last) = (begun, first);
    while let Some(now) = processor_seconds(id) {
        (until, last) = (Instant::now(), now);
        std::thread::sleep(Duration::from_millis(500));
    }
    let over = until.saturating_duration_since(begun).as_secs_f64();
    (over > 0.0).then(|| (last - first) / over)
}

/// User and system time of a process and its threads (proc(5): fields 14 and 15 of `stat`, in hundredths of a second).
fn processor_seconds(id: u32) -> Option<f64> {
    let text = std::fs::read_to_string(format!("/proc/{id}/stat")).ok()?;
    // The second field, the name in parentheses, may hold blanks; a zombie has no threads left that could run.
    let fields: Vec<&str> = text.get(text.rfind(')')? + 2..)?.split(' ').collect();
    let ticks = |n: usize| fields.get(n - 3)?.parse::<f64>().ok();
    if *fields.first()? == "Z" { None } else { Some((ticks(14)? + ticks(15)?) / 100.0) }
}

//! Recordings that an operator orders while a session runs: from now on, or of the newest events.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use tumbled_io::live::{SessionClock, StopToken};
use tumbled_io::recording::{
    Excerpt, MidSession, Plan, RecorderDesk, RecorderOptions, RecordingHeader, RecordingSummary, Witness,
};
use tumbled_model::CivilTime;

use super::run_info::SharedRunInfo;
use super::witness::EventWitness;

/// The longest file name that is taken, bytes: rotation adds to it.
const MOST_NAME_BYTES: usize = 200;

/// Where recordings are ordered. Clones share it.
#[derive(Clone, Debug)]
pub struct Recordings {
    desk: RecorderDesk,
    /// What the session's own recording says, as the session began.
    header: RecordingHeader,
    options: RecorderOptions,
    info: SharedRunInfo,
    clock: SessionClock,
    stop: StopToken,
    /// One snapshot at a time: each holds its events until they are written.
    snapshot: Arc<Mutex<()>>,
}

/// What was written.
#[derive(Clone, Debug, PartialEq)]
pub struct Written {
    /// The first part.
    pub file: PathBuf,
    /// Events in it.
    pub events: u64,
    /// Its size, all parts.
    pub bytes: u64,
    /// How much of the session it covers, s.
    pub covers_s: f64,
}

impl Recordings {
    /// Of a session whose own recording has, or would have, this header. Nothing is ever replaced.
    pub fn new(
        desk: RecorderDesk,
        (header, options): (RecordingHeader, RecorderOptions),
        info: SharedRunInfo,
        (clock, stop): (SessionClock, StopToken),
    ) -> Self {
        let options = RecorderOptions { replace: false, ..options };
        Self { desk, header, options, info, clock, stop, snapshot: Arc::default() }
    }

    /// What is said of the run.
    pub fn info(&self) -> &SharedRunInfo {
        &self.info
    }

    /// The file that is being recorded, and what is in it so far; `None`: nothing is recorded.
    pub fn recording(&self) -> Option<Written> {
        let status = self.desk.status();
        let file = status.path?;
        Some(Written { file, events: status.recorded, bytes: status.file_bytes, covers_s: 0.0 })
    }

    /// Records from now on. `name`: a file in the daemon's folder; without it, one by the date.
    ///
    /// # Errors
    /// Why it cannot, in words.
    pub fn start(&self, name: Option<&str>) -> Result<PathBuf, String> {
        let path = self.path(name)?;
        self.desk.begin(self.plan(path.clone())).map_err(|error| error.to_string())?;
        Ok(path)
    }

    /// Ends the recording.
    ///
    /// # Errors
    /// Why it cannot, in words.
    pub fn stop(&self) -> Result<Written, String> {
        let file = self.desk.status().path.unwrap_or_default();
        let summary = self.desk.end().map_err(|error| error.to_string())?;
        match &summary.stopped {
            Some(reason) => Err(format!("{} had stopped by itself: {reason}", file.display())),
            None => Ok(written(file, &summary)),
        }
    }

    /// Writes the newest events to a recording of their own, and waits until it is written.
    ///
    /// # Errors
    /// Why it cannot, in words.
    pub fn snapshot(&self, name: Option<&str>) -> Result<Written, String> {
        let path = self.path(name)?;
        let _one = self.snapshot.try_lock().map_err(|_busy| "a snapshot is being written: wait for it".to_owned())?;
        let excerpt = self.desk.excerpt().map_err(|error| error.to_string())?;
        if excerpt.events.is_empty() {
            return Err("nothing of the past is kept: [record] pretrigger says how much, e.g. \"30s\"".to_owned());
        }
        let covers_s = excerpt.span().0 as f64 * 1e-9;
        let mut file = MidSession::begin(self.plan(path.clone()), &excerpt).map_err(|error| error.to_string())?;
        for event in &excerpt.events {
            if self.stop.is_stopped() || !file.write(event) {
                break; // what is written stays; the summary tells
            }
        }
        let summary = file.finish();
        if let Some(reason) = &summary.stopped {
            return Err(format!("{} is not whole: {reason}", path.display()));
        }
        if summary.counters.events < excerpt.events.len() as u64 {
            return Err(format!("{} is not whole: the session ended meanwhile", path.display()));
        }
        Ok(Written { covers_s, ..written(path, &summary) })
    }

    fn plan(&self, path: PathBuf) -> Plan {
        let (mut header, info) = (self.header.clone(), self.info.get());
        info.add_to(&mut header.notes);
        Plan {
            path,
            options: self.options.clone(),
            header: Box::new(move |excerpt| of_excerpt(header, excerpt)),
            witness: Box::new(|header| -> Box<dyn Witness> { Box::new(EventWitness::of(header)) }),
        }
    }

    /// Orders come over sockets: they name a file in the daemon's own folder and no other place.
    fn path(&self, name: Option<&str>) -> Result<PathBuf, String> {
        let Some(name) = name else {
            let CivilTime { year, month, day, hour, minute, second, nanosecond } =
                CivilTime::from_unix(self.clock.now().wall);
            let millis = nanosecond / 1_000_000;
            let name = format!("tumbled-{year:04}{month:02}{day:02}T{hour:02}{minute:02}{second:02}.{millis:03}Z.mcap");
            return Ok(PathBuf::from(name));
        };
        let is_plain = Path::new(name).file_name().is_some_and(|file| file == name);
        let is_fit = name.len() <= MOST_NAME_BYTES && !name.starts_with('.') && !name.chars().any(char::is_control);
        if is_plain && is_fit && Path::new(name).extension().is_some_and(|extension| extension == "mcap") {
            Ok(PathBuf::from(name))
        } else {
            Err(format!("{name:?} is no file name such as spin-7.mcap: recordings lie in the daemon's own folder"))
        }
    }
}

fn written(file: PathBuf, summary: &RecordingSummary) -> Written {
    let counters = &summary.counters;
    let first = counters.channels.values().filter_map(|channel| channel.first).min();
    let covers_s = first.zip(counters.last_arrived).map_or(0.0, |(first, last)| (last - first).0 as f64 * 1e-9);
    Written { file, events: counters.events, bytes: summary.file_bytes, covers_s }
}

/// A replay that begins in the middle would take the target for the empty room where that is learned at the start.
fn of_excerpt(mut header: RecordingHeader, excerpt: &Excerpt) -> RecordingHeader {
    if let Some(config) = &excerpt.config {
        header.config = config.to_string();
    }
    let Some(first) = excerpt.events.first().filter(|_| !excerpt.from_start) else { return header };
    let mut note = |key: &str, text: String| header.notes.insert(key.to_owned(), text);
    note("begun_at_s", format!("{:.3}", first.arrived.0 as f64 * 1e-9));
    if let Some(config) = without_learning(&header.config) {
        header.config = config;
        let text = "target.background was \"start\": the room that was learned is not in this recording";
        header.notes.insert("background".to_owned(), text.to_owned());
    }
    header
}

/// The config with `target.background = "none"`; `None`: it learns nothing at the start.
fn without_learning(config: &str) -> Option<String> {
    let mut table: toml::Table = config.parse().ok()?;
    let background = table.get_mut("target")?.get_mut("background")?;
    if background.as_str() != Some("start") {
        return None;
    }
    *background = toml::Value::from("none");
    toml::to_string(&table).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{self, Recorded, show};
    use tumbled_model::{Body, Event, RigNs};

    #[test]
    fn a_recording_from_the_middle_learns_no_room_and_says_so() {
        let loaded = config::load(None, &["target.background=start".to_owned()]).expect("a config");
        let header = RecordingHeader { config: show::text(&loaded.tree, false), ..RecordingHeader::default() };
        let tick = Event { seq: 70, arrived: RigNs(7_000_000_000), body: Body::Tick };
        let excerpt = Excerpt { config: None, events: vec![tick], from_start: false };
        let middle = of_excerpt(header.clone(), &excerpt);
        assert_eq!(middle.notes["begun_at_s"], "7.000");
        assert!(middle.notes["background"].contains("not in this recording"));
        let read = config::load_recorded(Recorded { path: "run.mcap".into(), header: middle }, &[]).expect("a config");
        assert_eq!(read.config.target.background, config::BackgroundName::None);
        let whole = of_excerpt(header.clone(), &Excerpt { from_start: true, ..excerpt });
        assert_eq!(whole, header, "from the start nothing is missing");
    }
}

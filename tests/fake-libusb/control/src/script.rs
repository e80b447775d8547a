//! The script: which devices there are, what they send, how fast, and what happens when.

use std::path::{Path, PathBuf};

use crate::fault::Fault;

/// The environment variable that names the script.
pub const VARIABLE: &str = "TUMBLED_FAKE_USB";

/// The most devices a script may name.
const MAX_DEVICES: usize = 8;

/// A whole script.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Script {
    /// The devices, in the order in which they are enumerated.
    pub devices: Vec<Device>,
    /// How time passes.
    pub pace: Pace,
    /// Where the socket for live control is made.
    pub control: Option<PathBuf>,
    /// Where what the library did is written down.
    pub log: Option<PathBuf>,
    /// Where what was sent is written down.
    pub truth: Option<PathBuf>,
    /// What happens, in the order of the script.
    pub faults: Vec<Timed>,
}

/// One Kinect.
#[derive(Clone, Debug, PartialEq)]
pub struct Device {
    /// What it is.
    pub model: Model,
    /// The serial number it is opened by: the camera's (1414), the audio device's (1473, Kinect for Windows, whose
    /// cameras say sixteen zeros).
    pub serial: String,
    /// The port its hub is plugged into.
    pub port: u8,
    /// Its audio device.
    pub audio: Audio,
    /// What it sends.
    pub frames: Option<Frames>,
    /// Counts of the accelerometer, 819 to the g: x, y, z.
    pub accelerometer: [i16; 3],
}

/// What a device is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// Xbox 360, first model: camera 02ae with bcdDevice 267, motor 02b0.
    Xbox1414,
    /// Xbox 360, second model: camera 02ae, motor and LED behind the audio device 02ad.
    Xbox1473,
    /// Kinect for Windows: camera 02bf, which streams on alternate setting 1 alone, audio 02be.
    Windows,
}

/// What an audio device is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Audio {
    /// None on the bus.
    None,
    /// One that waits for its firmware: one interface.
    Loader,
    /// One with firmware: two interfaces, answers for motor and LED.
    Ready,
}

/// Where frames come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Frames {
    /// A file of frames.
    File {
        /// Its path.
        path: PathBuf,
        /// Whether nothing is sent after its last frame; else it begins again.
        once: bool,
        /// Whether it goes on by the clock while nothing streams, as a scene does; else it waits.
        follow: bool,
    },
    /// A FIFO that is there, or a Unix socket that is made: another process writes the frames.
    Feed(PathBuf),
}

/// How time passes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pace {
    /// As on a bus: 30 frames a second.
    #[default]
    Real,
    /// As fast as the host takes the packets; none is late.
    Fast,
}

/// Something that happens at a time.
#[derive(Clone, Debug, PartialEq)]
pub struct Timed {
    /// When.
    pub when: When,
    /// To which device, from 0.
    pub device: usize,
    /// What.
    pub fault: Fault,
}

/// When something happens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum When {
    /// Before the host's first look.
    Start,
    /// This many seconds after the host's first `libusb_init`.
    At(f64),
    /// Just before the device begins the frame of this number, from 0.
    Frame(u64),
}

/// A script that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("line {line}: {reason}")]
pub struct ScriptError {
    /// The line, from 1.
    pub line: usize,
    /// What was found and expected.
    pub reason: String,
}

impl Script {
    /// Reads a script; relative paths in it start from `folder`.
    pub fn parse(text: &str, folder: &Path) -> Result<Self, ScriptError> {
        let mut script = Self::default();
        for (index, line) in text.lines().enumerate() {
            let line = line.split_once('#').map_or(line, |(before, _)| before).trim();
            if !line.is_empty() {
                script.line(line, folder).map_err(|reason| ScriptError { line: index + 1, reason })?;
            }
        }
        let last = script.faults.iter().map(|timed| timed.device).max();
        match last.filter(|&device| device >= script.devices.len()) {
            None => Ok(script),
            Some(device) => {
                let reason = format!("a fault of device {device}, but there are {} devices", script.devices.len());
                Err(ScriptError { line: text.lines().count().max(1), reason })
            }
        }
    }

    fn line(&mut self, line: &str, folder: &Path) -> Result<(), String> {
        let (name, rest) = cut(line);
        match name {
            "kinect" if self.devices.len() == MAX_DEVICES => Err(format!("more than {MAX_DEVICES} devices")),
            "kinect" => device(rest, self.devices.len()).map(|device| self.devices.push(device)),
            "frames" => file(rest, folder).and_then(|frames| self.sends(frames)),
            "feed" => path(rest, folder).and_then(|path| self.sends(Frames::Feed(path))),
            "accelerometer" => self.accelerometer(rest),
            "pace" => pace(rest).map(|pace| self.pace = pace),
            "control" => path(rest, folder).map(|path| self.control = Some(path)),
            "log" => path(rest, folder).map(|path| self.log = Some(path)),
            "truth" => path(rest, folder).map(|path| self.truth = Some(path)),
            _ => timed(line).map(|timed| self.faults.push(timed)),
        }
    }

    fn last(&mut self, what: &str) -> Result<&mut Device, String> {
        self.devices.last_mut().ok_or_else(|| format!("`{what}` belongs after the `kinect` it is of"))
    }

    fn sends(&mut self, frames: Frames) -> Result<(), String> {
        self.last("frames").map(|device| device.frames = Some(frames))
    }

    fn accelerometer(&mut self, rest: &str) -> Result<(), String> {
        let counts: Option<Vec<i16>> = rest.split_whitespace().map(|word| word.parse().ok()).collect();
        let counts = counts.and_then(|counts| <[i16; 3]>::try_from(counts).ok());
        let counts = counts.ok_or_else(|| format!("found `{rest}`, expected three counts"))?;
        self.last("accelerometer").map(|device| device.accelerometer = counts)
    }
}

/// The first word, and what follows it.
fn cut(line: &str) -> (&str, &str) {
    line.split_once(char::is_whitespace).map_or((line, ""), |(word, rest)| (word, rest.trim()))
}

/// Reads `[on N] FAULT`, which a script and a control connection share.
pub fn fault_of_device(line: &str) -> Result<(usize, Fault), String> {
    let (name, rest) = cut(line.trim());
    if name != "on" {
        return Fault::parse(line).map(|fault| (0, fault));
    }
    let (device, fault) = cut(rest);
    let device = device.parse().ok().ok_or_else(|| format!("found `{device}`, expected a device's number, from 0"))?;
    Fault::parse(fault).map(|fault| (device, fault))
}

fn timed(line: &str) -> Result<Timed, String> {
    let (name, rest) = cut(line);
    let (time, fault) = cut(rest);
    let (when, fault) = match name {
        "at" => {
            let seconds = time.parse().ok().filter(|seconds: &f64| (0.0..=1e6).contains(seconds));
            let seconds = seconds.ok_or_else(|| format!("found `{time}`, expected seconds, 0..=1000000"))?;
            (When::At(seconds), fault)
        }
        "frame" => {
            let number = time.parse().ok().ok_or_else(|| format!("found `{time}`, expected a frame's number"))?;
            (When::Frame(number), fault)
        }
        _ => (When::Start, line),
    };
    fault_of_device(fault).map(|(device, fault)| Timed { when, device, fault })
}

fn device(rest: &str, number: usize) -> Result<Device, String> {
    let (model, mut rest) = cut(rest);
    let (model, audio) = match model {
        "1414" => (Model::Xbox1414, Audio::None),
        "1473" => (Model::Xbox1473, Audio::Ready),
        "k4w" => (Model::Windows, Audio::Ready),
        other => return Err(format!("found model `{other}`, expected 1414, 1473 or k4w")),
    };
    let port = u8::try_from(number + 1).unwrap_or(u8::MAX);
    let serial = format!("A{number:015}");
    let mut device = Device { model, serial, port, audio, frames: None, accelerometer: [0, 819, 0] };
    while !rest.is_empty() {
        let (option, after) = cut(rest);
        let (value, after) = cut(after);
        rest = after;
        match option {
            "serial" if !value.is_empty() && value.len() <= 64 && value.is_ascii() => device.serial = value.to_owned(),
            "port" => {
                device.port = value.parse().ok().ok_or_else(|| format!("found `{value}`, expected a port, 0..=255"))?;
            }
            "audio" => device.audio = audio_state(value)?,
            _ => return Err(format!("found `{option} {value}`, expected serial, port or audio with its value")),
        }
    }
    Ok(device)
}

fn audio_state(word: &str) -> Result<Audio, String> {
    match word {
        "none" => Ok(Audio::None),
        "loader" => Ok(Audio::Loader),
        "ready" => Ok(Audio::Ready),
        _ => Err(format!("found `{word}`, expected none, loader or ready")),
    }
}

fn file(rest: &str, folder: &Path) -> Result<Frames, String> {
    let mut words = rest.split_whitespace();
    let path = path(words.next().unwrap_or_default(), folder)?;
    let (mut once, mut follow) = (false, false);
    for word in words {
        match word {
            "once" => once = true,
            "follow" => follow = true,
            _ => return Err(format!("found `{word}`, expected once or follow")),
        }
    }
    Ok(Frames::File { path, once, follow })
}

fn path(rest: &str, folder: &Path) -> Result<PathBuf, String> {
    if rest.is_empty() { Err("expected a path, found the end of the line".to_owned()) } else { Ok(folder.join(rest)) }
}

fn pace(rest: &str) -> Result<Pace, String> {
    match rest {
        "real" => Ok(Pace::Real),
        "fast" => Ok(Pace::Fast),
        _ => Err(format!("found `{rest}`, expected real or fast")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fault::StallEnd;
    use proptest::prelude::*;

    fn parse(text: &str) -> Result<Script, ScriptError> {
        Script::parse(text, Path::new("/rig"))
    }

    #[test]
    fn a_script_reads_as_it_is_documented() {
        let script = parse(
            "# two devices\n\
             kinect 1414 serial A7 port 3\n\
             frames scene.frames once   # relative to the script\n\
             accelerometer 1 -2 3\n\
             kinect k4w audio loader\n\
             feed /tmp/feed\n\
             pace fast\n\
             at 5.0 drop 17\n\
             frame 30 on 1 stall 2\n\
             mute\n",
        )
        .expect("a script");
        let first = Device {
            model: Model::Xbox1414,
            serial: "A7".into(),
            port: 3,
            audio: Audio::None,
            frames: Some(Frames::File { path: "/rig/scene.frames".into(), once: true, follow: false }),
            accelerometer: [1, -2, 3],
        };
        assert_eq!(script.devices[0], first);
        assert_eq!((script.devices[1].port, script.devices[1].audio), (2, Audio::Loader));
        assert_eq!(script.devices[1].frames, Some(Frames::Feed("/tmp/feed".into())));
        assert_eq!(script.pace, Pace::Fast);
        let timed = |when, device, fault| Timed { when, device, fault };
        let faults = [
            timed(When::At(5.0), 0, Fault::Drop(vec![17])),
            timed(When::Frame(30), 1, Fault::Stall(StallEnd::After(2.0))),
            timed(When::Start, 0, Fault::Mute(true)),
        ];
        assert_eq!(script.faults, faults);
    }

    #[test]
    fn errors_name_the_line() {
        let error = |text: &str| parse(text).expect_err("no script").to_string();
        assert_eq!(error("\nkinect 1515"), "line 2: found model `1515`, expected 1414, 1473 or k4w");
        assert_eq!(error("frames a"), "line 1: `frames` belongs after the `kinect` it is of");
        assert_eq!(error("kinect 1414\nat soon unplug"), "line 2: found `soon`, expected seconds, 0..=1000000");
        assert_eq!(error("kinect 1414\non 1 unplug"), "line 2: a fault of device 1, but there are 1 devices");
        assert_eq!(error("pace slow"), "line 1: found `slow`, expected real or fast");
    }

    proptest! {
        #[test]
        fn any_text_is_read_or_refused(text in "\\PC{0,40}(\n\\PC{0,40}){0,3}") {
            if let Err(error) = parse(&text) {
                prop_assert!(error.line >= 1 && error.line <= text.lines().count().max(1));
            }
        }
    }
}

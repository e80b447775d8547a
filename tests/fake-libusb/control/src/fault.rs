//! What can happen to a device.

use core::fmt;
use core::str::SplitWhitespace;

/// The most packets a depth frame has.
const PACKETS: u16 = 242;

/// One thing that happens to a device.
#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    /// These packets of the next frame are lost on the bus.
    Drop(Vec<u16>),
    /// From now on every packet is lost with this probability (0..=1), by a generator with this seed; 0 ends it.
    DropRandom {
        /// Probability of each packet, 0..=1.
        probability: f64,
        /// Start of the generator.
        seed: u64,
    },
    /// These packets of the next frame arrive damaged.
    Corrupt(Corruption, Vec<u16>),
    /// From the next frame on nothing is sent, until something ends it.
    Stall(StallEnd),
    /// Camera, motor and audio leave the bus at once.
    Unplug,
    /// They come back, at another port if one is given.
    Replug(Option<u8>),
    /// Whether every request for a reply of the camera is answered with no bytes.
    Mute(bool),
    /// Whether the host has no bandwidth left for isochronous transfers.
    RefuseBandwidth(bool),
    /// What claiming the camera's interface meets.
    Busy(Option<Busy>),
    /// Whether a kernel driver holds the camera until it is detached.
    KernelDriver(bool),
    /// Whether the device nodes may not be opened.
    NoPermission(bool),
    /// Whether the same bytes are sent for ever, under ticks that go on.
    Freeze(bool),
    /// The next frame's ticks are these; later ones keep their distances.
    Clock(u32),
}

/// How a packet is damaged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Corruption {
    /// The header's magic is wrong: the packet is not one.
    Magic,
    /// The header's flag belongs to no packet of the stream.
    Flag,
    /// The header's sequence number is 100 ahead.
    Sequence,
    /// Half of the payload is missing.
    Short,
    /// 100 bytes follow the payload.
    Long,
    /// Every bit of the payload is inverted: nothing tells.
    Payload,
}

/// What ends a stall (a replug always does).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum StallEnd {
    /// After this many seconds.
    After(f64),
    /// When the host starts the stream anew.
    Restart,
    /// When the host opens the camera anew.
    Reopen,
    /// When the host resets the camera.
    Reset,
}

/// Why an interface cannot be claimed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Busy {
    /// Somebody else has it: `LIBUSB_ERROR_BUSY`.
    Taken,
    /// It is gone since a process was killed: `LIBUSB_ERROR_NOT_FOUND`.
    NotFound,
}

impl Fault {
    /// Reads `drop 17 40`, `stall 3.0` and so on; the error says what was expected.
    pub fn parse(line: &str) -> Result<Self, String> {
        let mut words = line.split_whitespace();
        let name = words.next().ok_or("a fault is missing")?;
        let fault = match name {
            "drop" => Self::Drop(packets(&mut words)?),
            "drop-random" => Self::drop_random(&mut words)?,
            "corrupt" => Self::Corrupt(corruption(&mut words)?, packets(&mut words)?),
            "stall" => Self::Stall(stall_end(&mut words)?),
            "unplug" => Self::Unplug,
            "replug" => Self::Replug(port(&mut words)?),
            "mute" => Self::Mute(on(&mut words)?),
            "mute-from-start" => Self::Mute(true),
            "refuse-bandwidth" => Self::RefuseBandwidth(on(&mut words)?),
            "busy" => Self::Busy(busy(&mut words)?),
            "kernel-driver" => Self::KernelDriver(on(&mut words)?),
            "no-permission" => Self::NoPermission(on(&mut words)?),
            "freeze" => Self::Freeze(on(&mut words)?),
            "clock" => Self::Clock(number(&mut words, "ticks of 60 MHz, 0..=4294967295")?),
            other => return Err(format!("`{other}` is no fault")),
        };
        match words.next() {
            None => Ok(fault),
            Some(word) => Err(format!("`{word}` is too much after `{name}`")),
        }
    }

    fn drop_random(words: &mut SplitWhitespace<'_>) -> Result<Self, String> {
        let probability: f64 = number(words, "a probability, 0..=1")?;
        if !(0.0..=1.0).contains(&probability) {
            return Err(format!("found probability {probability}, expected 0..=1"));
        }
        Ok(Self::DropRandom { probability, seed: number(words, "a seed, a whole number")? })
    }
}

fn number<T: core::str::FromStr>(words: &mut SplitWhitespace<'_>, expected: &str) -> Result<T, String> {
    let word = words.next().ok_or_else(|| format!("expected {expected}, found the end of the line"))?;
    word.parse().ok().ok_or_else(|| format!("found `{word}`, expected {expected}"))
}

fn packets(words: &mut SplitWhitespace<'_>) -> Result<Vec<u16>, String> {
    let mut packets = Vec::new();
    for word in words.by_ref() {
        match word.parse() {
            Ok(packet) if packet < PACKETS => packets.push(packet),
            _ => return Err(format!("found `{word}`, expected a packet number, 0..=241")),
        }
    }
    packets.sort_unstable();
    packets.dedup();
    if packets.is_empty() { Err("expected packet numbers, found the end of the line".to_owned()) } else { Ok(packets) }
}

fn corruption(words: &mut SplitWhitespace<'_>) -> Result<Corruption, String> {
    let mut ahead = words.clone();
    let kind = match ahead.next() {
        Some("magic") => Corruption::Magic,
        Some("flag") => Corruption::Flag,
        Some("sequence") => Corruption::Sequence,
        Some("short") => Corruption::Short,
        Some("long") => Corruption::Long,
        Some("payload") => Corruption::Payload,
        // `corrupt 17 40` alone destroys the magic.
        Some(word) if word.parse::<u16>().is_ok() => return Ok(Corruption::Magic),
        found => {
            let found = found.unwrap_or("the end of the line");
            return Err(format!("found `{found}`, expected magic, flag, sequence, short, long or payload"));
        }
    };
    *words = ahead;
    Ok(kind)
}

fn stall_end(words: &mut SplitWhitespace<'_>) -> Result<StallEnd, String> {
    let mut ahead = words.clone();
    if ahead.next() == Some("until") {
        let end = match ahead.next() {
            Some("restart") => StallEnd::Restart,
            Some("reopen") => StallEnd::Reopen,
            Some("reset") => StallEnd::Reset,
            found => {
                let found = found.unwrap_or("the end of the line");
                return Err(format!("found `{found}`, expected restart, reopen or reset"));
            }
        };
        *words = ahead;
        return Ok(end);
    }
    let seconds: f64 = number(words, "seconds, or `until restart`, `until reopen`, `until reset`")?;
    if seconds.is_finite() && (0.0..=1e6).contains(&seconds) {
        Ok(StallEnd::After(seconds))
    } else {
        Err(format!("found {seconds} s, expected 0..=1000000"))
    }
}

fn port(words: &mut SplitWhitespace<'_>) -> Result<Option<u8>, String> {
    match words.next() {
        None => Ok(None),
        Some("port") => number(words, "a port, 1..=255").map(Some),
        Some(word) => Err(format!("found `{word}`, expected `port` and its number")),
    }
}

fn on(words: &mut SplitWhitespace<'_>) -> Result<bool, String> {
    match words.next() {
        None | Some("on") => Ok(true),
        Some("off") => Ok(false),
        Some(word) => Err(format!("found `{word}`, expected on or off")),
    }
}

fn busy(words: &mut SplitWhitespace<'_>) -> Result<Option<Busy>, String> {
    match words.next() {
        None | Some("on" | "taken") => Ok(Some(Busy::Taken)),
        Some("not-found") => Ok(Some(Busy::NotFound)),
        Some("off") => Ok(None),
        Some(word) => Err(format!("found `{word}`, expected taken, not-found or off")),
    }
}

impl fmt::Display for Corruption {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Magic => "magic",
            Self::Flag => "flag",
            Self::Sequence => "sequence",
            Self::Short => "short",
            Self::Long => "long",
            Self::Payload => "payload",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn faults_read_as_they_are_documented() {
        let reads = |line: &str| Fault::parse(line).expect("a fault");
        assert_eq!(reads("drop 40 17 40"), Fault::Drop(vec![17, 40])); // ascending, each once
        assert_eq!(reads("drop-random 0.01 7"), Fault::DropRandom { probability: 0.01, seed: 7 });
        assert_eq!(reads("corrupt 3"), Fault::Corrupt(Corruption::Magic, vec![3]));
        assert_eq!(reads("corrupt short 0 241"), Fault::Corrupt(Corruption::Short, vec![0, 241]));
        assert_eq!(reads("stall 3.0"), Fault::Stall(StallEnd::After(3.0)));
        assert_eq!(reads("stall until reopen"), Fault::Stall(StallEnd::Reopen));
        assert_eq!(reads("replug"), Fault::Replug(None));
        assert_eq!(reads("replug port 2"), Fault::Replug(Some(2)));
        assert_eq!(reads("mute off"), Fault::Mute(false));
        assert_eq!(reads("mute-from-start"), Fault::Mute(true));
        assert_eq!(reads("busy not-found"), Fault::Busy(Some(Busy::NotFound)));
        assert_eq!(reads("clock 4294967295"), Fault::Clock(u32::MAX));
    }

    #[test]
    fn errors_say_what_was_found_and_expected() {
        let error = |line: &str| Fault::parse(line).expect_err("no fault");
        assert_eq!(error("drop 242"), "found `242`, expected a packet number, 0..=241");
        assert_eq!(error("drop"), "expected packet numbers, found the end of the line");
        assert_eq!(error("drop-random 2 1"), "found probability 2, expected 0..=1");
        assert_eq!(error("stall NaN"), "found NaN s, expected 0..=1000000");
        assert_eq!(error("unplug now"), "`now` is too much after `unplug`");
        assert_eq!(error("explode"), "`explode` is no fault");
    }

    proptest! {
        #[test]
        fn any_line_is_read_or_refused(line in "\\PC{0,60}") {
            if let Err(text) = Fault::parse(&line) {
                prop_assert!(!text.is_empty());
            }
        }
    }
}

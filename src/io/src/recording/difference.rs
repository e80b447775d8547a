//! Where two events differ: the first field that does, and its two values.

use core::fmt;
use tumbled_model::{Body, Command, Event};

use super::layout::ChannelKey;

/// The first field in which two events differ.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// The field: `seq`, `arrived_ns`, `channel`, `kind` or one of the body.
    pub field: &'static str,
    /// Its value in the first event.
    pub a: String,
    /// Its value in the second.
    pub b: String,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {} | {}", self.field, self.a, self.b)
    }
}

/// The first field in which two events differ; `None`: they are equal.
pub fn compare(a: &Event, b: &Event) -> Option<Difference> {
    if a == b {
        return None;
    }
    let of = |event: &Event| ChannelKey::of(&event.body).map_or_else(|| "none".to_owned(), |key| key.to_string());
    field("seq", a.seq, b.seq)
        .or_else(|| field("arrived_ns", a.arrived.0, b.arrived.0))
        .or_else(|| field("channel", of(a), of(b)))
        .or_else(|| body(&a.body, &b.body))
        // Kinds of events this comparison has no fields for.
        .or_else(|| Some(Difference { field: "event", a: format!("{a:?}"), b: format!("{b:?}") }))
}

fn field<T: PartialEq + fmt::Display>(field: &'static str, a: T, b: T) -> Option<Difference> {
    (a != b).then(|| Difference { field, a: a.to_string(), b: b.to_string() })
}

fn body(a: &Body, b: &Body) -> Option<Difference> {
    match (a, b) {
        (Body::LidarPacket { bytes: a, .. }, Body::LidarPacket { bytes: b, .. })
        | (Body::SerialChunk { bytes: a, .. }, Body::SerialChunk { bytes: b, .. })
        | (Body::DeviceTables { bytes: a, .. }, Body::DeviceTables { bytes: b, .. }) => bytes(a, b),
        (
            Body::DepthFrame { ticks: ticks_a, encoding: encoding_a, lost_packets: lost_a, bytes: a, .. },
            Body::DepthFrame { ticks: ticks_b, encoding: encoding_b, lost_packets: lost_b, bytes: b, .. },
        ) => {
            let ticks = |ticks: &Option<_>| {
                ticks.map_or_else(|| "none".to_owned(), |tumbled_model::KinectTicks(ticks)| ticks.to_string())
            };
            let list = |mask: &tumbled_model::PacketMask| format!("{:?}", mask.iter().collect::<Vec<_>>());
            field("ticks", ticks(ticks_a), ticks(ticks_b))
                .or_else(|| field("encoding", format!("{encoding_a:?}"), format!("{encoding_b:?}")))
                .or_else(|| field("lost_packets", list(lost_a), list(lost_b)))
                .or_else(|| bytes(a, b))
        }
        (Body::SensorState { sensor: a, state: x }, Body::SensorState { sensor: b, state: y }) => {
            field("sensor", a, b).or_else(|| field("state", format!("{x:?}"), format!("{y:?}")))
        }
        (Body::Skip { sensor: a, scans: x }, Body::Skip { sensor: b, scans: y }) => {
            field("sensor", a, b).or_else(|| field("scans", x, y))
        }
        (Body::Gap { sensor: a, lost: x, place: p }, Body::Gap { sensor: b, lost: y, place: q }) => {
            field("sensor", a, b)
                .or_else(|| field("lost", x, y))
                .or_else(|| field("place", format!("{p:?}"), format!("{q:?}")))
        }
        (Body::Anchor { unix: a }, Body::Anchor { unix: b }) => field("unix_ns", a.0, b.0),
        (Body::Command(Command::Marker { text: a }), Body::Command(Command::Marker { text: b })) => field("text", a, b),
        (
            Body::Command(Command::LearnBackground { lasts_ms: a }),
            Body::Command(Command::LearnBackground { lasts_ms: b }),
        ) => field("lasts_ms", a, b),
        (Body::Config { toml: a }, Body::Config { toml: b }) => lines(a, b),
        _ => field("kind", kind(a), kind(b)),
    }
}

fn kind(body: &Body) -> &'static str {
    match body {
        Body::LidarPacket { .. } => "LiDAR packet",
        Body::DepthFrame { .. } => "depth frame",
        Body::SerialChunk { .. } => "serial chunk",
        Body::DeviceTables { .. } => "device tables",
        Body::SensorState { .. } => "sensor state",
        Body::Skip { .. } => "skip",
        Body::Anchor { .. } => "anchor",
        Body::Tick => "tick",
        Body::Gap { .. } => "gap",
        Body::Command(Command::Marker { .. }) => "marker",
        Body::Command(Command::LearnBackground { .. }) => "order to learn the background",
        Body::Command(Command::ForgetBackground) => "order to forget the background",
        Body::Command(Command::ResetFilter) => "order to reset the filter",
        Body::Config { .. } => "config",
        _ => "event of another kind",
    }
}

/// The first line in which two configs differ; where one ends, `end`.
fn lines(a: &str, b: &str) -> Option<Difference> {
    // `split` and not `lines`: a newline more at the end is a difference too.
    let (mut of_a, mut of_b) = (a.split('\n'), b.split('\n'));
    for number in 1_u64.. {
        let (a, b) = (of_a.next(), of_b.next());
        if a.is_none() && b.is_none() {
            break;
        }
        if a != b {
            let shown = |line: Option<&str>| format!("line {number}: {}", line.unwrap_or("end"));
            return field("config", shown(a), shown(b));
        }
    }
    None
}

/// Where two payloads differ: their lengths, else the first byte that does.
fn bytes(a: &[u8], b: &[u8]) -> Option<Difference> {
    if a.len() != b.len() {
        return field("length", a.len(), b.len());
    }
    let at = a.iter().zip(b).position(|(a, b)| a != b)?;
    let show = |bytes: &[u8]| format!("{:#04x} at byte {at}", bytes.get(at).copied().unwrap_or_default());
    Some(Difference { field: "bytes", a: show(a), b: show(b) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use tumbled_model::RigNs;

    fn difference(a: Body, b: Body) -> Option<(&'static str, String, String)> {
        let event = |body| Event { seq: 3, arrived: RigNs(7), body };
        compare(&event(a), &event(b)).map(|difference| (difference.field, difference.a, difference.b))
    }

    fn config(toml: &str) -> Body {
        Body::Config { toml: toml.into() }
    }

    fn marker(text: &str) -> Body {
        Body::Command(Command::Marker { text: text.into() })
    }

    #[test]
    fn configs_differ_in_a_line_and_markers_in_their_text() {
        let lines = |a: &str, b: &str| Some(("config", a.to_owned(), b.to_owned()));
        assert_eq!(difference(config("a\nb\nc"), config("a\nx\nc")), lines("line 2: b", "line 2: x"));
        // A newline at the end opens one more, empty line.
        assert_eq!(difference(config("a\n"), config("a")), lines("line 2: ", "line 2: end"));
        assert_eq!(difference(config("a"), config("a")), None);
        assert_eq!(difference(marker("in"), marker("out")), Some(("text", "in".to_owned(), "out".to_owned())));
        assert_eq!(
            difference(marker("in"), config("in")).map(|(field, a, b)| (field, a + "|" + &b)),
            Some(("kind", "marker|config".to_owned()))
        );
    }
}

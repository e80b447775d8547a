//! EVENT: something that happened once.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::{Gravity, Notice};
use tumbled_model::{RigNs, SensorId, UnixNs};

use super::class::Class;
use super::hello::StreamOrigin;

/// Something that happened once, e.g. a sensor that was lost, a clock that was reset.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "tumbled stream: EVENT")]
pub struct EventLine {
    /// EVENT.
    pub class: Class,
    /// Where the data come from.
    pub origin: StreamOrigin,
    /// When, ns on the session's timeline.
    pub t_ns: i64,
    /// The same as wall time, ns since 1970-01-01 UTC as a decimal string.
    pub unix_ns: String,
    /// Whose event; null: the session's.
    pub sensor: Option<String>,
    /// A word for programs: those of the core's notices, e.g. `clock_reset`, and the daemon's own.
    pub kind: String,
    /// How grave it is.
    pub level: Gravity,
    /// A sentence for people.
    pub message: String,
}

impl EventLine {
    /// What the core noticed; `unix` is the wall time at the notice's.
    pub fn of_notice(origin: StreamOrigin, notice: &Notice, unix: UnixNs) -> Self {
        let kind = notice.kind.name();
        Self::new(origin, (notice.t, unix), notice.sensor.as_ref(), kind, notice.gravity, &notice.message)
    }

    /// Of something that happened at `t`, wall time `unix`, to `sensor` or to the session.
    pub fn new(
        origin: StreamOrigin,
        (t, unix): (RigNs, UnixNs),
        sensor: Option<&SensorId>,
        kind: &str,
        level: Gravity,
        message: &str,
    ) -> Self {
        Self {
            class: Class::Event,
            origin,
            t_ns: t.0,
            unix_ns: unix.0.to_string(),
            sensor: sensor.map(ToString::to_string),
            kind: kind.to_owned(),
            level,
            message: message.to_owned(),
        }
    }
}

#[cfg(test)]
mod tests {
    use tumbled_core::NoticeKind;

    use super::*;

    #[test]
    fn a_notice_becomes_a_line_with_its_kind_as_a_word() {
        let notice = Notice {
            t: RigNs(7),
            sensor: Some(SensorId::from("front")),
            gravity: Gravity::Warn,
            kind: NoticeKind::ClockReset,
            message: "the clock began anew".to_owned(),
        };
        let line = EventLine::of_notice(StreamOrigin::Live, &notice, UnixNs(9));
        assert_eq!(
            serde_json::to_string(&line).expect("JSON"),
            r#"{"class":"EVENT","origin":"live","t_ns":7,"unix_ns":"9","sensor":"front","kind":"clock_reset","#
                .to_owned()
                + r#""level":"warn","message":"the clock began anew"}"#
        );
    }
}

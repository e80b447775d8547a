//! What is to go wrong, when, and with whom: the text of a fault file, as types.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_model::RigNs;

/// The longest delay and silence, s: items wait in memory.
const LONGEST_S: f64 = 60.0;
/// The most items that one may fall behind.
const DEEPEST: u32 = 1_000;
/// The latest instant and the widest step, s: 30 years.
const LAST_S: f64 = 1e9;
/// The longest payload that resizing makes, bytes: beyond every datagram.
const LARGEST: u32 = 65_535;

/// A fault file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
#[schemars(title = "tumbled fault file")]
pub struct FaultScript {
    /// Decides every chance.
    pub seed: u64,
    /// The faults. An item passes them in this order.
    pub fault: Vec<Fault>,
}

/// One fault.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Fault {
    /// Whose items; absent: everybody's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sensor: Option<String>,
    /// From when, by arrival on the session's timeline, s.
    #[serde(default)]
    pub from_s: f64,
    /// Until when, s; absent: to the end.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub until_s: Option<f64>,
    /// What goes wrong.
    pub action: Action,
}

/// What goes wrong with items: LiDAR packets, depth frames, serial chunks.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Action {
    /// Items do not come, each by itself.
    Loss {
        /// How likely.
        probability: f64,
    },
    /// Items do not come, many in a row.
    Burst {
        /// How likely each item is to begin a burst.
        probability: f64,
        /// How many are lost then.
        items: u32,
    },
    /// Items come twice.
    Duplicate {
        /// How likely.
        probability: f64,
    },
    /// Items are overtaken.
    Reorder {
        /// How likely.
        probability: f64,
        /// By at most so many later ones of the same sensor.
        depth: u32,
    },
    /// Bytes are changed.
    Corrupt {
        /// How likely.
        probability: f64,
        /// How many bytes of an item.
        bytes: u32,
    },
    /// Payloads have a wrong length.
    Resize {
        /// How likely.
        probability: f64,
        /// Which, bytes; what is missing is 0.
        bytes: u32,
    },
    /// Somebody else's payload comes after an item.
    Spoof {
        /// How likely.
        probability: f64,
        /// What it is.
        payload: Payload,
    },
    /// Items come late; their order is kept where the jitter is 0.
    Delay {
        /// By so much, s.
        delay_s: f64,
        /// And by up to so much more, evenly, s.
        #[serde(default)]
        jitter_s: f64,
    },
    /// The device restarts: nothing for a while, then its clock counts from a second on. (The end of the time window
    /// means nothing here.)
    Reboot {
        /// How long it is silent, s.
        silent_s: f64,
    },
    /// Nothing comes. Where the host notices, as with USB and serial ports, the source is `lost` and then `opened`.
    Unplug,
    /// The first payload of the window comes again and again. A frame keeps its own stamp.
    Freeze,
    /// What position packets say of the pulse.
    Pps {
        /// Its state.
        state: Pulse,
    },
    /// The device's counter is ahead of what it was, as when a pulse sets it.
    ClockStep {
        /// By so much, s; negative: behind.
        step_s: f64,
    },
    /// The host's wall clock is ahead of what it was: the anchors say so. (A sensor's name means nothing here.)
    WallStep {
        /// By so much, s; negative: behind.
        step_s: f64,
    },
}

/// A payload that is not the sensor's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Payload {
    /// Random bytes, as many as the item has.
    Noise,
    /// A LiDAR packet with the product byte of a VLS-128.
    OtherProduct,
    /// A LiDAR packet of a second sensor: its clock is 777 s ahead.
    OtherSensor,
}

/// What a LiDAR says of its pulse.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Pulse {
    /// None.
    Absent,
    /// Being looked for.
    Synchronising,
    /// The counter follows it.
    Locked,
    /// Irregular.
    Error,
}

/// A number no fault can have.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("fault {number}: {name} is {found}; {expected} expected")]
pub struct FaultError {
    /// Which fault, from 1.
    pub number: usize,
    /// Which setting.
    pub name: &'static str,
    /// What it is.
    pub found: f64,
    /// What it could be.
    pub expected: &'static str,
}

impl FaultScript {
    /// Looks for numbers that mean nothing.
    ///
    /// # Errors
    /// [`FaultError`]: the first one.
    pub fn check(&self) -> Result<(), FaultError> {
        for (fault, number) in self.fault.iter().zip(1..) {
            for Number { name, found, bounds: (low, high), expected } in fault.numbers() {
                if !(low..=high).contains(&found) {
                    return Err(FaultError { number, name, found, expected });
                }
            }
        }
        Ok(())
    }
}

impl Fault {
    /// Whether an item that arrives then falls into the window.
    pub(super) fn covers(&self, arrived: RigNs) -> bool {
        let endless = matches!(self.action, Action::Reboot { .. });
        arrived >= ns(self.from_s) && (endless || self.until_s.is_none_or(|until_s| arrived < ns(until_s)))
    }

    fn numbers(&self) -> impl Iterator<Item = Number> {
        let chance = |found| Some(Number { name: "probability", found, bounds: (0.0, 1.0), expected: "0 to 1" });
        let wait = |name, found| Some(Number { name, found, bounds: (0.0, LONGEST_S), expected: "0 to 60 s" });
        let count = |name, found: u32, low: u32, high: u32, expected| {
            Some(Number { name, found: found.into(), bounds: (low.into(), high.into()), expected })
        };
        let step = |found| {
            let expected = "a number of seconds within 30 years";
            Some(Number { name: "step_s", found, bounds: (-LAST_S, LAST_S), expected })
        };
        let action = match self.action {
            Action::Loss { probability } | Action::Duplicate { probability } | Action::Spoof { probability, .. } => {
                [chance(probability), None]
            }
            Action::Burst { probability, items } => {
                [chance(probability), count("items", items, 1, u32::MAX, "at least 1")]
            }
            Action::Reorder { probability, depth } => {
                [chance(probability), count("depth", depth, 1, DEEPEST, "1 to 1000")]
            }
            Action::Corrupt { probability, bytes } => {
                [chance(probability), count("bytes", bytes, 1, LARGEST, "1 to 65535")]
            }
            Action::Resize { probability, bytes } => {
                [chance(probability), count("bytes", bytes, 0, LARGEST, "0 to 65535")]
            }
            Action::Delay { delay_s, jitter_s } => [wait("delay_s", delay_s), wait("jitter_s", jitter_s)],
            Action::Reboot { silent_s } => [wait("silent_s", silent_s), None],
            Action::ClockStep { step_s } | Action::WallStep { step_s } => [step(step_s), None],
            Action::Unplug | Action::Freeze | Action::Pps { .. } => [None, None],
        };
        let expected = "0 s or later, and the end not before the beginning";
        let from = Number { name: "from_s", found: self.from_s, bounds: (0.0, LAST_S), expected };
        let until =
            self.until_s.map(|found| Number { name: "until_s", found, bounds: (self.from_s, LAST_S), expected });
        [Some(from), until].into_iter().chain(action).flatten()
    }
}

/// A setting that is a number.
struct Number {
    name: &'static str,
    found: f64,
    bounds: (f64, f64),
    /// The bounds in words.
    expected: &'static str,
}

/// Seconds to the timeline.
pub(super) fn ns(seconds: f64) -> RigNs {
    RigNs(libm::round(seconds * 1e9) as i64)
}

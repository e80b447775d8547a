//! The classes of lines, and sets of them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What a line of the stream is: the value of its first key, `class`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "UPPERCASE")]
pub enum Class {
    /// The server's first line.
    Hello,
    /// The target's pose and motion.
    State,
    /// How sensors, clocks, queues and recorder are doing.
    Health,
    /// Measured points, thinned out.
    Cloud,
    /// The motion of named points of the target.
    Point,
    /// Where the uncertainty of the target's pose comes from.
    Sigma,
    /// The target's surface as it is known so far, thinned out.
    Model,
    /// The edges of that surface.
    Contour,
    /// Where a simulated target truly is.
    Truth,
    /// Something that happened once.
    Event,
    /// What the server has to say about a client's connection.
    Error,
}

impl Class {
    /// All of them, in the order they are listed to people.
    pub const ALL: [Self; 11] = [
        Self::Hello,
        Self::State,
        Self::Health,
        Self::Cloud,
        Self::Point,
        Self::Sigma,
        Self::Model,
        Self::Contour,
        Self::Truth,
        Self::Event,
        Self::Error,
    ];

    /// The word on the wire.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Hello => "HELLO",
            Self::State => "STATE",
            Self::Health => "HEALTH",
            Self::Cloud => "CLOUD",
            Self::Point => "POINT",
            Self::Sigma => "SIGMA",
            Self::Model => "MODEL",
            Self::Contour => "CONTOUR",
            Self::Truth => "TRUTH",
            Self::Event => "EVENT",
            Self::Error => "ERROR",
        }
    }

    /// The class of a word on the wire.
    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|class| class.name() == name)
    }

    /// Control lines are never dropped. Of the others a newer one makes up for an older one.
    pub const fn is_control(self) -> bool {
        matches!(self, Self::Hello | Self::Event | Self::Error)
    }

    /// Whether a client's `max_hz` thins it out.
    pub const fn is_rated(self) -> bool {
        matches!(self, Self::State | Self::Cloud)
    }

    const fn bit(self) -> u16 {
        1 << self as u8
    }
}

/// A set of classes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Classes(u16);

impl Classes {
    /// What a client gets that does not ask: STATE and HEALTH.
    pub const UNASKED: Self = Self(Class::State.bit() | Class::Health.bit());

    /// Whether the class is one of them.
    pub const fn contains(self, class: Class) -> bool {
        self.0 & class.bit() != 0
    }

    /// The set as bits, for an atomic.
    pub(super) const fn bits(self) -> u16 {
        self.0
    }

    /// The set of bits that [`Classes::bits`] gave.
    pub(super) const fn of_bits(bits: u16) -> Self {
        Self(bits)
    }
}

impl FromIterator<Class> for Classes {
    fn from_iter<I: IntoIterator<Item = Class>>(classes: I) -> Self {
        Self(classes.into_iter().fold(0, |bits, class| bits | class.bit()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_word_on_the_wire_is_the_one_serde_writes() {
        for class in Class::ALL {
            assert_eq!(serde_json::to_string(&class).expect("JSON"), format!("\"{}\"", class.name()));
            assert_eq!(Class::of_name(class.name()), Some(class));
        }
        assert_eq!(Class::of_name("health"), None);
    }

    #[test]
    fn a_set_holds_what_was_put_in_and_nothing_else() {
        let set: Classes = [Class::Cloud, Class::Event, Class::Cloud].into_iter().collect();
        let held: Vec<Class> = Class::ALL.into_iter().filter(|class| set.contains(*class)).collect();
        assert_eq!(held, [Class::Cloud, Class::Event]);
        assert_eq!(Classes::of_bits(set.bits()), set);
    }
}

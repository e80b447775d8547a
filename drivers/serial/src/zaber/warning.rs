//! The two letters by which a Zaber device says that something is wrong.

use core::fmt;

/// A reply's warning flag: the most urgent one that is up (Zaber ASCII protocol manual, "warning flags").
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Warning([u8; 2]);

/// How bad a [`Warning`] is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Severity {
    /// `--`: nothing is wrong.
    Clear,
    /// Something of interest (`N…`): the angle may be believed.
    Note,
    /// Something to look at (`W…`): the angle may be believed, its zero perhaps not.
    Warning,
    /// The device failed (`F…`): the angle is no truth from here on.
    Fault,
}

impl Warning {
    /// Nothing is wrong.
    pub const NONE: Self = Self(*b"--");
    /// Fault: stalled and stopped.
    pub const STALLED: Self = Self(*b"FS");
    /// Fault: encoder error.
    pub const ENCODER_ERROR: Self = Self(*b"FQ");
    /// Fault: the driver is off.
    pub const DRIVER_OFF: Self = Self(*b"FD");
    /// Fault: a limit was hit or missed.
    pub const LIMIT_ERROR: Self = Self(*b"FE");
    /// Warning: no reference position: the counts' zero means nothing.
    pub const NO_REFERENCE: Self = Self(*b"WR");
    /// Warning: not homed since power-up.
    pub const NOT_HOMED: Self = Self(*b"WH");
    /// Warning: moved by a force while idle.
    pub const MOVED_WHILE_IDLE: Self = Self(*b"WM");
    /// Note: a move was interrupted.
    pub const MOVE_INTERRUPTED: Self = Self(*b"NI");
    /// Note: under manual control.
    pub const MANUAL_CONTROL: Self = Self(*b"NC");
    /// Note: a setting is being brought up to date.
    pub const SETTING_UPDATE: Self = Self(*b"NU");

    /// From the two characters of a reply; `None` when they are not two.
    pub fn parse(text: &str) -> Option<Self> {
        text.as_bytes().try_into().ok().map(Self)
    }

    /// How bad it is. An unknown `F…` is a fault, any other unknown flag a warning.
    pub fn severity(self) -> Severity {
        match self {
            Self::NONE => Severity::Clear,
            Self::MOVE_INTERRUPTED | Self::MANUAL_CONTROL | Self::SETTING_UPDATE => Severity::Note,
            Self([b'F', _]) => Severity::Fault,
            _ => Severity::Warning,
        }
    }

    /// Whether the counts are referred to the stage's zero. A more urgent flag hides the two that say they are not, so
    /// this is an answer only where [`Self::severity`] is no fault.
    pub fn referenced(self) -> bool {
        !matches!(self, Self::NO_REFERENCE | Self::NOT_HOMED)
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [first, second] = self.0;
        write!(f, "{}{}", char::from(first), char::from(second))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flags_are_as_bad_as_their_first_letter_says_and_unknown_ones_are_not_trusted() {
        let severity = |text| Warning::parse(text).map(Warning::severity);
        assert_eq!(severity("--"), Some(Severity::Clear));
        assert_eq!(severity("NI"), Some(Severity::Note));
        assert_eq!(severity("WR"), Some(Severity::Warning));
        assert_eq!(severity("FS"), Some(Severity::Fault));
        assert_eq!(
            (severity("FZ"), severity("NZ"), severity("?!")),
            (Some(Severity::Fault), Some(Severity::Warning), Some(Severity::Warning))
        );
        assert_eq!((severity("F"), severity("FSX")), (None, None));
        assert_eq!(Warning::STALLED.to_string(), "FS");
    }
}

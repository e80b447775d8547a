//! What a Zaber stage is asked and told.

use core::fmt;

/// A command: everything this program sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Command {
    /// No word at all: only status and warning flag are wanted.
    Status,
    /// Look for the reference position.
    Home,
    /// Go to a position, counts.
    MoveAbs(i64),
    /// Go on by so many counts.
    MoveRel(i64),
    /// Turn until told otherwise; velocity data, see [`super::Scale::velocity_data`].
    MoveVel(i64),
    /// Slow down and stand.
    Stop,
    /// Stand at once, without slowing down.
    EStop,
    /// What is a setting's value?
    Get(Setting),
    /// Switch something on or off.
    Set(Switch, bool),
}

/// A setting that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Setting {
    /// The product's number.
    DeviceId,
    /// The device's serial number.
    SystemSerial,
    /// The firmware, `major.minor`.
    Version,
    /// Where the stage was told to be, counts.
    Pos,
    /// Where the encoder says it is, counts.
    EncoderPos,
    /// How far the encoder is from where the stage was told to be, counts.
    EncoderPosError,
    /// How fast the encoder turns, velocity data; firmware 7.29 and later.
    EncoderVel,
    /// The fastest a move goes, velocity data.
    MaxSpeed,
    /// Counts of a full turn; unsigned.
    LimitCycleDist,
}

/// A setting that is switched.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Switch {
    /// Alerts at the end of moves.
    Alerts,
    /// A checksum on every line, alerts too.
    Checksums,
}

/// Whom a command may be sent to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scope {
    /// The device as a whole: with an axis it is refused.
    Device,
    /// An axis.
    Axis,
}

/// Why a device refuses a command: the data word of an `RJ` reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Rejection {
    /// `BADCOMMAND`: no such command or setting, or not in this firmware.
    BadCommand,
    /// `BADDATA`: a number is missing, out of range or none.
    BadData,
    /// `BADAXIS`: no such axis.
    BadAxis,
    /// `BADMESSAGEID`: an id that is none.
    BadMessageId,
    /// `DEVICEONLY`: not for an axis.
    DeviceOnly,
    /// `STATUSBUSY`: not while it moves.
    StatusBusy,
    /// `PARKED`: not while parked.
    Parked,
    /// `DRIVERDISABLED`: not while the driver is off.
    DriverDisabled,
    /// `FULL`: no room for more.
    Full,
    /// A word this program does not know.
    Unknown,
}

const SETTINGS: [(Setting, &str); 9] = [
    (Setting::DeviceId, "device.id"),
    (Setting::SystemSerial, "system.serial"),
    (Setting::Version, "version"),
    (Setting::Pos, "pos"),
    (Setting::EncoderPos, "encoder.pos"),
    (Setting::EncoderPosError, "encoder.pos.error"),
    (Setting::EncoderVel, "encoder.vel"),
    (Setting::MaxSpeed, "maxspeed"),
    (Setting::LimitCycleDist, "limit.cycle.dist"),
];

const SWITCHES: [(Switch, &str); 2] = [(Switch::Alerts, "comm.alert"), (Switch::Checksums, "comm.checksum")];

const REJECTIONS: [(Rejection, &str); 9] = [
    (Rejection::BadCommand, "BADCOMMAND"),
    (Rejection::BadData, "BADDATA"),
    (Rejection::BadAxis, "BADAXIS"),
    (Rejection::BadMessageId, "BADMESSAGEID"),
    (Rejection::DeviceOnly, "DEVICEONLY"),
    (Rejection::StatusBusy, "STATUSBUSY"),
    (Rejection::Parked, "PARKED"),
    (Rejection::DriverDisabled, "DRIVERDISABLED"),
    (Rejection::Full, "FULL"),
];

/// A thing's name in a table that has them all.
fn name<T: PartialEq>(table: &[(T, &'static str)], thing: &T) -> &'static str {
    table.iter().find(|(other, _)| other == thing).map_or("", |(_, name)| name)
}

fn named<T: Copy>(table: &[(T, &'static str)], name: &str) -> Option<T> {
    table.iter().find(|(_, other)| *other == name).map(|(thing, _)| *thing)
}

impl Command {
    /// What a driver asks before it polls: who is there, how many counts a turn has; and lines that can be checked.
    pub const OPENING: [Self; 6] = [
        Self::Set(Switch::Checksums, true),
        Self::Set(Switch::Alerts, true),
        Self::Get(Setting::DeviceId),
        Self::Get(Setting::SystemSerial),
        Self::Get(Setting::Version),
        Self::Get(Setting::LimitCycleDist),
    ];

    /// Whom it may be sent to.
    pub fn scope(self) -> Scope {
        match self {
            Self::Set(..) | Self::Get(Setting::DeviceId | Setting::SystemSerial | Setting::Version) => Scope::Device,
            _ => Scope::Axis,
        }
    }

    /// It sets the stage in motion.
    pub fn moves(self) -> bool {
        matches!(self, Self::Home | Self::MoveAbs(_) | Self::MoveRel(_) | Self::MoveVel(_))
    }

    /// It brings the stage to rest.
    pub fn stops(self) -> bool {
        matches!(self, Self::Stop | Self::EStop)
    }

    /// Reads the words of a command line.
    ///
    /// # Errors
    /// What a device would answer: [`Rejection::BadCommand`] or [`Rejection::BadData`].
    pub fn parse(words: &str) -> Result<Self, Rejection> {
        let words: Vec<&str> = words.split(' ').filter(|word| !word.is_empty()).take(4).collect();
        let number = |text: &str| text.parse::<i64>().map_err(|_not_a_number| Rejection::BadData);
        match words.as_slice() {
            [] => Ok(Self::Status),
            ["home"] => Ok(Self::Home),
            ["stop"] => Ok(Self::Stop),
            ["estop"] => Ok(Self::EStop),
            ["move", "abs", counts] => number(counts).map(Self::MoveAbs),
            ["move", "rel", counts] => number(counts).map(Self::MoveRel),
            ["move", "vel", data] => number(data).map(Self::MoveVel),
            ["move", "abs" | "rel" | "vel", ..] => Err(Rejection::BadData),
            ["get", setting] => named(&SETTINGS, setting).map(Self::Get).ok_or(Rejection::BadCommand),
            ["set", switch, value] => {
                let switch = named(&SWITCHES, switch).ok_or(Rejection::BadCommand)?;
                match *value {
                    "0" => Ok(Self::Set(switch, false)),
                    "1" => Ok(Self::Set(switch, true)),
                    _ => Err(Rejection::BadData),
                }
            }
            _ => Err(Rejection::BadCommand),
        }
    }
}

impl fmt::Display for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Status => Ok(()),
            Self::Home => f.write_str("home"),
            Self::MoveAbs(counts) => write!(f, "move abs {counts}"),
            Self::MoveRel(counts) => write!(f, "move rel {counts}"),
            Self::MoveVel(data) => write!(f, "move vel {data}"),
            Self::Stop => f.write_str("stop"),
            Self::EStop => f.write_str("estop"),
            Self::Get(setting) => write!(f, "get {}", name(&SETTINGS, setting)),
            Self::Set(switch, on) => write!(f, "set {} {}", name(&SWITCHES, switch), u8::from(*on)),
        }
    }
}

impl Rejection {
    /// From the data of an `RJ` reply.
    pub fn parse(data: &str) -> Self {
        named(&REJECTIONS, data).unwrap_or(Self::Unknown)
    }

    /// The word on the wire; empty for [`Self::Unknown`].
    pub fn word(self) -> &'static str {
        name(&REJECTIONS, &self)
    }
}

//! What a GRBL 1.1 controller says: the position of a home-made turntable, as commanded. GRBL has no encoder, so its angle
//! is never truth.
//!
//! ```text
//!   ?   ─▶ <Run|MPos:123.456,0.000,0.000|FS:500,0|Ov:100,100,100>
//!   a line ─▶ ok, or error:N          unasked: ALARM:N, Grbl 1.1h ['$' for help]
//! ```
//!
//! Fields of a status come in any order, and versions add new ones: they are looked up by name. Source: GRBL 1.1
//! interface description, "real-time status reports".

/// Asks for a status, without a line end and without an `ok`; at most ten times a second.
pub const STATUS_REQUEST: u8 = b'?';
/// Ends a jog.
pub const JOG_CANCEL: u8 = 0x85;
/// The longest line, its end not counted: GRBL's own buffer.
pub const LINE_BYTES: usize = 128;
/// Axes a position has at most: X, Y, Z, A, B, C.
pub const MOST_AXES: usize = 6;

/// A line from the controller.
#[derive(Clone, Debug, PartialEq)]
pub enum GrblLine {
    /// The answer to [`STATUS_REQUEST`].
    Status(Status),
    /// A line was taken.
    Ok,
    /// A line was refused, with GRBL's number for why.
    Error(u16),
    /// Motion is locked until `$X` or `$H`, with GRBL's number for why.
    Alarm(u16),
    /// The controller has started: positions begin anew.
    Started,
    /// Settings, messages and what newer versions say.
    Other,
}

/// A status.
#[derive(Clone, Debug, PartialEq)]
pub struct Status {
    /// What the controller does.
    pub state: State,
    /// `MPos`: where the axes are in the machine's coordinates, in the controller's units. Not empty.
    pub machine: Option<Vec<f64>>,
    /// `WPos`: the same less the work offset; sent instead of `MPos` by some settings. Not empty.
    pub work: Option<Vec<f64>>,
    /// `WCO`: the work offset; sent now and then. Not empty.
    pub offset: Option<Vec<f64>>,
}

/// What a controller does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum State {
    /// Nothing.
    Idle,
    /// It carries out motion.
    Run,
    /// It holds, or comes to a hold.
    Hold,
    /// It jogs.
    Jog,
    /// It is locked.
    Alarm,
    /// The door is open.
    Door,
    /// It reads lines without moving.
    Check,
    /// It looks for its reference.
    Home,
    /// It sleeps.
    Sleep,
    /// A word this program does not know.
    Unknown,
}

impl State {
    /// From the word in a status; what follows a `:` in it is a detail of hold and door.
    fn parse(text: &str) -> Self {
        match text.split(':').next().unwrap_or_default() {
            "Idle" => Self::Idle,
            "Run" => Self::Run,
            "Hold" => Self::Hold,
            "Jog" => Self::Jog,
            "Alarm" => Self::Alarm,
            "Door" => Self::Door,
            "Check" => Self::Check,
            "Home" => Self::Home,
            "Sleep" => Self::Sleep,
            _ => Self::Unknown,
        }
    }

    /// The axes may be moving: a hold and an open door come to rest only after a while.
    pub fn may_move(self) -> bool {
        !matches!(self, Self::Idle | Self::Alarm | Self::Check | Self::Sleep)
    }
}

/// A line that is not GRBL's, or damaged: GRBL has no checksum, so only its form can be looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GrblError {
    /// It begins with `<` and does not end with `>`.
    #[error("a status ends with `>`")]
    Cut,
    /// A position that is not one to six finite numbers with commas between.
    #[error("one to six numbers expected as a position")]
    Position,
    /// `error:` or `ALARM:` without a number.
    #[error("a number expected behind `error:` or `ALARM:`")]
    Number,
}

impl GrblLine {
    /// Reads a line without its end.
    ///
    /// # Errors
    /// [`GrblError`]: what is wrong with it.
    pub fn parse(line: &str) -> Result<Self, GrblError> {
        let number = |text: &str| text.parse::<u16>().map_err(|_not_a_number| GrblError::Number);
        if let Some(status) = line.strip_prefix('<') {
            return Status::parse(status.strip_suffix('>').ok_or(GrblError::Cut)?).map(Self::Status);
        }
        if let Some(code) = line.strip_prefix("error:") {
            return number(code).map(Self::Error);
        }
        if let Some(code) = line.strip_prefix("ALARM:") {
            return number(code).map(Self::Alarm);
        }
        Ok(match line {
            "ok" => Self::Ok,
            _ if line.starts_with("Grbl ") => Self::Started,
            _ => Self::Other,
        })
    }
}

impl Status {
    fn parse(text: &str) -> Result<Self, GrblError> {
        let mut fields = text.split('|');
        let state = State::parse(fields.next().unwrap_or_default());
        let mut status = Self { state, machine: None, work: None, offset: None };
        for (name, value) in fields.filter_map(|field| field.split_once(':')) {
            match name {
                "MPos" => status.machine = Some(position(value)?),
                "WPos" => status.work = Some(position(value)?),
                "WCO" => status.offset = Some(position(value)?),
                _ => {}
            }
        }
        Ok(status)
    }
}

fn position(text: &str) -> Result<Vec<f64>, GrblError> {
    let numbers =
        text.split(',').take(MOST_AXES + 1).map(|number| number.parse::<f64>().ok().filter(|n| n.is_finite()));
    let numbers: Option<Vec<f64>> = numbers.collect();
    numbers.filter(|numbers| numbers.len() <= MOST_AXES).ok_or(GrblError::Position)
}

/// Statuses to one axis' position in the machine's coordinates, whichever way the controller reports it.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GrblPosition {
    offset: Option<Vec<f64>>,
}

impl GrblPosition {
    /// Takes a line; the position of the `axis`-th axis (0 is X, 3 is A) in the controller's units. `None`: the line has
    /// none, there is no such axis, or the offset was not sent yet.
    pub fn of(&mut self, line: &GrblLine, axis: usize) -> Option<f64> {
        let status = match line {
            GrblLine::Status(status) => status,
            GrblLine::Started => {
                self.offset = None;
                return None;
            }
            _ => return None,
        };
        if status.offset.is_some() {
            self.offset.clone_from(&status.offset);
        }
        let of_axis = |position: &Option<Vec<f64>>| position.as_ref().and_then(|position| position.get(axis)).copied();
        of_axis(&status.machine).or_else(|| Some(of_axis(&status.work)? + of_axis(&self.offset)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_status_is_read_in_any_order_of_its_fields() {
        let line = GrblLine::parse("<Run|FS:500,0|New:1|MPos:123.456,0.000,-7.5|Ov:100,100,100>");
        let Ok(GrblLine::Status(status)) = line else { panic!("{line:?}") };
        assert_eq!((status.state, status.machine), (State::Run, Some(vec![123.456, 0.0, -7.5])));
        assert!(State::parse("Hold:1") == State::Hold && State::Hold.may_move() && !State::Idle.may_move());
    }

    #[test]
    fn a_work_position_waits_for_its_offset_and_keeps_it_until_the_controller_starts_again() {
        let mut position = GrblPosition::default();
        let mut of = |line| position.of(&GrblLine::parse(line).expect("a line"), 0);
        assert_eq!(of("<Idle|WPos:10.000,0,0>"), None);
        assert_eq!(of("<Idle|WPos:10.000,0,0|WCO:2.500,0,0>"), Some(12.5));
        assert_eq!(of("<Jog|WPos:11.000,0,0>"), Some(13.5));
        assert_eq!(of("<Jog|MPos:14.000,0,0>"), Some(14.0));
        assert_eq!(of("Grbl 1.1h ['$' for help]"), None);
        assert_eq!(of("<Idle|WPos:10.000,0,0>"), None);
    }

    #[test]
    fn other_lines_are_told_apart_and_damaged_ones_refused() {
        assert_eq!(GrblLine::parse("ok"), Ok(GrblLine::Ok));
        assert_eq!(GrblLine::parse("error:9"), Ok(GrblLine::Error(9)));
        assert_eq!(GrblLine::parse("ALARM:1"), Ok(GrblLine::Alarm(1)));
        assert_eq!(GrblLine::parse("[MSG:Reset to continue]"), Ok(GrblLine::Other));
        assert_eq!(GrblLine::parse("<Run|MPos:1"), Err(GrblError::Cut));
        assert_eq!(GrblLine::parse("<Run|MPos:1,inf>"), Err(GrblError::Position));
        assert_eq!(GrblLine::parse("<Run|MPos:1,2,3,4,5,6,7>"), Err(GrblError::Position));
        assert_eq!(GrblLine::parse("error:x"), Err(GrblError::Number));
    }

    proptest! {
        #[test]
        fn arbitrary_lines_give_finite_positions_or_none(line in "<?(Run|Idle|\\|MPos:|\\|WPos:|\\|WCO:|[0-9.,eE+-]|inf|nan|[ -~]){0,20}>?") {
            let mut position = GrblPosition::default();
            if let Ok(line) = GrblLine::parse(&line)
                && let Some(value) = position.of(&line, 0)
            {
                prop_assert!(!value.is_nan());
            }
        }
    }
}

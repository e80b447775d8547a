//! Whom a Zaber line is for or from, and its number.

/// A device on the chain and one of its axes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Address {
    /// 1…99; in a command, 0 is every device on the chain.
    pub device: u8,
    /// 1…99; 0 is the device as a whole.
    pub axis: u8,
}

impl Address {
    /// The device as a whole.
    pub const fn whole(self) -> Self {
        Self { device: self.device, axis: 0 }
    }
}

/// The number by which a reply is told to belong to a command: 0…99.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MessageId(u8);

impl MessageId {
    /// How many there are.
    pub const COUNT: u8 = 100;

    /// The id of a number; `None` past 99.
    pub const fn new(number: u8) -> Option<Self> {
        if number < Self::COUNT { Some(Self(number)) } else { None }
    }

    /// The number, 0…99.
    pub const fn number(self) -> u8 {
        self.0
    }

    /// The one after it; 0 after 99.
    #[must_use]
    pub const fn next(self) -> Self {
        Self((self.0 + 1) % Self::COUNT)
    }
}

/// The numbers a line begins with, and the rest of it.
pub(super) struct Header<'a> {
    pub(super) address: Address,
    pub(super) id: Option<MessageId>,
    pub(super) rest: &'a str,
}

/// Reads up to `most` numbers of one or two digits; missing ones are 0 (protocol manual, "message format"), a missing id
/// is none.
pub(super) fn header(body: &str, most: usize) -> Header<'_> {
    let mut numbers = [None; 3];
    let mut rest = body.trim_start_matches(' ');
    for number in numbers.iter_mut().take(most) {
        let (word, after) = word(rest);
        let short = matches!(word.len(), 1 | 2) && word.bytes().all(|byte| byte.is_ascii_digit());
        let Some(value) = word.parse::<u8>().ok().filter(|_| short) else { break };
        *number = Some(value);
        rest = after;
    }
    let [device, axis, id] = numbers;
    let address = Address { device: device.unwrap_or(0), axis: axis.unwrap_or(0) };
    Header { address, id: id.and_then(MessageId::new), rest }
}

/// The first word and what follows it, without spaces before.
pub(super) fn word(text: &str) -> (&str, &str) {
    let (word, rest) = text.split_once(' ').unwrap_or((text, ""));
    (word, rest.trim_start_matches(' '))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_numbers_are_zero_and_a_long_number_is_none_of_them() {
        let read = |body, most| {
            let Header { address, id, rest } = header(body, most);
            (address.device, address.axis, id.map(MessageId::number), rest.to_owned())
        };
        assert_eq!(read("01 1 07 OK", 3), (1, 1, Some(7), "OK".to_owned()));
        assert_eq!(read("1 home", 3), (1, 0, None, "home".to_owned()));
        assert_eq!(read("", 3), (0, 0, None, String::new()));
        assert_eq!(read("01 1 07 IDLE", 2), (1, 1, None, "07 IDLE".to_owned()));
        assert_eq!(read("01 1 100 OK", 3), (1, 1, None, "100 OK".to_owned()));
    }

    #[test]
    fn the_id_after_99_is_0() {
        assert_eq!(MessageId::new(99).map(MessageId::next), MessageId::new(0));
        assert_eq!(MessageId::new(100), None);
    }
}

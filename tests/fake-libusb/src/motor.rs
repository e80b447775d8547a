//! Tilt, lamp and accelerometer: a device of their own on the first model, behind the audio device on the later ones.

use std::collections::VecDeque;

const REQUEST: u32 = 0x0602_2009;
const REPLY: u32 = 0x0A6F_E000;

/// What the motor's processor knows.
#[derive(Debug)]
pub(crate) struct Motor {
    /// Twice the degrees, −62..=62.
    tilt: i8,
    accelerometer: [i16; 3],
    /// Replies of the audio device that were not fetched yet.
    replies: VecDeque<Vec<u8>>,
}

/// What was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Done {
    /// Reading.
    Read,
    /// Half degrees.
    Tilt(i8),
    /// The lamp's number.
    Led(u16),
}

impl Motor {
    pub(crate) fn new(accelerometer: [i16; 3]) -> Self {
        Self { tilt: 0, accelerometer, replies: VecDeque::new() }
    }

    /// A control transfer to the motor device without data; `None` if it knows no such request.
    pub(crate) fn control(&mut self, request: u8, value: u16) -> Option<Done> {
        match request {
            0x31 => {
                self.tilt = (value as i16).clamp(-62, 62) as i8;
                Some(Done::Tilt(self.tilt))
            }
            0x06 => Some(Done::Led(value)),
            _ => None,
        }
    }

    /// The ten bytes of its state: acceleration big-endian at 2, 4 and 6, tilt at 8, status (0: stopped) at 9.
    pub(crate) fn state(&self) -> [u8; 10] {
        let [x, y, z] = self.accelerometer.map(i16::to_be_bytes);
        [0, 0, x[0], x[1], y[0], y[1], z[0], z[1], self.tilt as u8, 0]
    }

    /// A message to the audio device; `None` if it is not one.
    pub(crate) fn message(&mut self, bytes: &[u8]) -> Option<Done> {
        let word = |index: usize| -> Option<u32> {
            bytes.get(4 * index..4 * index + 4)?.try_into().ok().map(u32::from_le_bytes)
        };
        let (magic, tag, command) = (word(0)?, word(1)?, word(3)?);
        if magic != REQUEST {
            return None;
        }
        let done = match command {
            0x8032 => {
                let [x, y, z] = self.accelerometer.map(i32::from);
                let values = [0, 0, 0, 0, x, y, z, i32::from(self.tilt) / 2];
                let mut state: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
                state.resize(104, 0);
                self.replies.push_back(state);
                Done::Read
            }
            0x803B => {
                self.tilt = (word(4)? as i32).clamp(-31, 31) as i8 * 2;
                Done::Tilt(self.tilt)
            }
            0x10 => Done::Led(word(4)? as u16),
            _ => return None,
        };
        self.replies.push_back([REPLY, tag, 0].iter().flat_map(|word| word.to_le_bytes()).collect());
        Some(done)
    }

    /// The audio device's next reply.
    pub(crate) fn fetch(&mut self) -> Option<Vec<u8>> {
        self.replies.pop_front()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_ways_tell_the_same_state() {
        let mut motor = Motor::new([1, -819, 300]);
        assert_eq!(motor.control(0x31, (-20_i16) as u16), Some(Done::Tilt(-20)));
        assert_eq!(motor.state(), [0, 0, 0, 1, 0xFC, 0xCD, 0x01, 0x2C, (-20_i8) as u8, 0]); // −819 = 0xFCCD

        let message = [REQUEST, 5, 0x68, 0x8032].map(u32::to_le_bytes).concat();
        assert_eq!(motor.message(&message), Some(Done::Read));
        let state = motor.fetch().expect("a state");
        assert_eq!(
            (state.len(), &state[16..20], &state[28..32]),
            (104, &[1, 0, 0, 0][..], &(-10_i32).to_le_bytes()[..])
        );
        assert_eq!(motor.fetch().expect("its end"), [REPLY, 5, 0].map(u32::to_le_bytes).concat());
        assert_eq!(motor.fetch(), None);
    }

    #[test]
    fn the_motor_never_goes_beyond_31_degrees() {
        let mut motor = Motor::new([0; 3]);
        assert_eq!(motor.control(0x31, 1_000), Some(Done::Tilt(62)));
        let message = [REQUEST, 0, 0, 0x803B, (-90_i32) as u32].map(u32::to_le_bytes).concat();
        assert_eq!(motor.message(&message), Some(Done::Tilt(-62)));
        assert_eq!(motor.message(&[0; 20]), None);
    }
}

//! What a camera answers to control transfers.

use std::collections::BTreeMap;

/// A request's first bytes, and a reply's.
const REQUEST: [u8; 2] = [0x47, 0x4D];
const REPLY: [u8; 2] = [0x52, 0x42];
/// Bytes before the payload: magic, length in words, command, tag.
const HEADER: usize = 8;

/// Registers that mean something here.
pub(crate) mod register {
    pub(crate) const VIDEO: u16 = 0x05;
    pub(crate) const DEPTH: u16 = 0x06;
    pub(crate) const DEPTH_FORMAT: u16 = 0x12;
}

/// A camera's memory: its registers, and a reply that was not fetched yet.
#[derive(Debug, Default)]
pub(crate) struct Camera {
    registers: BTreeMap<u16, u16>,
    /// The registers of the image sensor behind it.
    sensor: BTreeMap<u16, u16>,
    reply: Vec<u8>,
}

/// What a request did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Done {
    /// Something was asked.
    Asked,
    /// A register was written.
    Wrote { register: u16, value: u16 },
    /// Nobody knows this command.
    Unknown(u16),
}

impl Camera {
    /// Takes a request; `None` if it is not one.
    pub(crate) fn request(&mut self, bytes: &[u8], zero_plane: usize) -> Option<Done> {
        let (header, payload) = bytes.split_at_checked(HEADER)?;
        let &[m0, m1, l0, l1, c0, c1, t0, t1] = header else { return None };
        if [m0, m1] != REQUEST || payload.len() != usize::from(u16::from_le_bytes([l0, l1])) * 2 {
            return None;
        }
        let command = u16::from_le_bytes([c0, c1]);
        let mut words = payload.chunks_exact(2).map(|word| u16::from_le_bytes([word[0], word[1]]));
        let mut word = || words.next().unwrap_or_default();
        let (done, reply) = match command {
            0x02 => (Done::Asked, words_of(&[0, self.register(word())])),
            0x03 => {
                let (register, value) = (word(), word());
                self.registers.insert(register, value);
                (Done::Wrote { register, value }, words_of(&[0]))
            }
            0x04 => (Done::Asked, fixed_parameters(zero_plane)),
            0x16 => (Done::Asked, parameter(word())),
            0x95 => {
                let (count, register, value) = (word(), word(), word());
                (Done::Asked, words_of(&[count, register, self.sensor(register, value)]))
            }
            unknown => (Done::Unknown(unknown), words_of(&[u16::MAX])),
        };
        let length = u16::try_from(reply.len() / 2).unwrap_or_default().to_le_bytes();
        self.reply = [&REPLY[..], &length, &[c0, c1, t0, t1], &reply].concat();
        Some(done)
    }

    /// Fetches the reply; empty if nothing was asked.
    pub(crate) fn fetch(&mut self) -> Vec<u8> {
        std::mem::take(&mut self.reply)
    }

    pub(crate) fn register(&self, register: u16) -> u16 {
        self.registers.get(&register).copied().unwrap_or_default()
    }

    /// Reads a register of the image sensor, or writes it if the highest bit of its number is set.
    fn sensor(&mut self, register: u16, value: u16) -> u16 {
        if register & 0x8000 == 0 {
            return self.sensor.get(&register).copied().unwrap_or_default();
        }
        self.sensor.insert(register & 0x7FFF, value);
        value
    }
}

fn words_of(words: &[u16]) -> Vec<u8> {
    words.iter().flat_map(|word| word.to_le_bytes()).collect()
}

/// The zero plane of a nominal device, four floats at byte 94: baselines to the projector and to the colour camera in cm,
/// distance of the reference plane in cm, size of a pixel there in cm.
fn fixed_parameters(length: usize) -> Vec<u8> {
    let mut reply = vec![0; length];
    for (place, value) in reply[94..].chunks_exact_mut(4).zip([7.5_f32, 2.3, 120.0, 0.1042]) {
        place.copy_from_slice(&value.to_le_bytes());
    }
    reply
}

fn parameter(number: u16) -> Vec<u8> {
    match number {
        0x41 => vec![0; 8],
        // Registration without a shift: 29 coefficients of zero.
        0x40 => vec![0; 2 + 29 * 4],
        0x00 => words_of(&[0, 200]), // the constant shift
        _ => words_of(&[u16::MAX]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ask(camera: &mut Camera, command: u8, tag: u8, words: &[u16]) -> (Option<Done>, Vec<u8>) {
        let header = [0x47, 0x4D, words.len() as u8, 0, command, 0, tag, 0];
        let done = camera.request(&[&header[..], &words_of(words)].concat(), 322);
        (done, camera.fetch())
    }

    #[test]
    fn every_command_has_its_reply() {
        let mut camera = Camera::default();
        for (command, words, length) in [
            (0x16, &[0x41][..], 8),
            (0x04, &[], 322),
            (0x16, &[0x40], 118),
            (0x16, &[0x00], 4),
            (0x03, &[0x105, 0], 2),
            (0x02, &[0x12], 4),
            (0x95, &[1, 0x106, 0], 6),
        ] {
            let (done, reply) = ask(&mut camera, command, 9, words);
            assert!(done.is_some());
            // Magic, length in words, the command and tag of the request.
            assert_eq!(reply[..8], [0x52, 0x42, (length / 2) as u8, 0, command, 0, 9, 0], "command {command:#x}");
            assert_eq!(reply.len(), 8 + length);
            assert_eq!(camera.fetch(), [], "a reply is fetched once");
        }
    }

    #[test]
    fn registers_keep_what_was_written() {
        let mut camera = Camera::default();
        let written = Done::Wrote { register: 0x12, value: 3 };
        assert_eq!(ask(&mut camera, 0x03, 0, &[0x12, 3]).0, Some(written));
        assert_eq!(ask(&mut camera, 0x02, 0, &[0x12]).1[8..], [0, 0, 3, 0]);
        // Of the image sensor: bit 15 writes.
        assert_eq!(ask(&mut camera, 0x95, 0, &[1, 0x8009, 77]).1[12..], [77, 0]);
        assert_eq!(ask(&mut camera, 0x95, 0, &[1, 0x0009, 0]).1[12..], [77, 0]);
    }

    #[test]
    fn what_is_no_request_gets_no_reply() {
        let mut camera = Camera::default();
        for bytes in [&[][..], &[0x47, 0x4D, 1, 0, 2, 0, 0, 0], &[0x52, 0x42, 0, 0, 2, 0, 0, 0]] {
            assert_eq!(camera.request(bytes, 322), None);
            assert_eq!(camera.fetch(), []);
        }
        assert_eq!(ask(&mut camera, 0x77, 0, &[]).0, Some(Done::Unknown(0x77)));
    }

    #[test]
    fn the_zero_plane_lies_at_byte_94() {
        let reply = ask(&mut Camera::default(), 0x04, 0, &[]).1;
        let float = |at: usize| f32::from_le_bytes([reply[8 + at], reply[9 + at], reply[10 + at], reply[11 + at]]);
        assert_eq!([94, 98, 102, 106].map(float), [7.5, 2.3, 120.0, 0.1042]);
    }
}

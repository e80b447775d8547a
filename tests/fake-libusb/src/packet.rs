//! The packets of a frame: what they look like, and how they are damaged and lost.

use fake_libusb_control::Corruption;

/// Bytes of a packet's header, and of its payload.
const HEADER: usize = 12;
const PAYLOAD: usize = 1_748;

/// How many packets a frame's stream takes.
pub(crate) fn count(stream: &[u8]) -> u16 {
    u16::try_from(stream.len().div_ceil(PAYLOAD)).unwrap_or(u16::MAX)
}

/// Writes packet `index` of a frame's stream to `packet`: magic, flag, sequence number and ticks, then the payload.
pub(crate) fn write(packet: &mut Vec<u8>, stream: &[u8], index: u16, sequence: u8, ticks: u32) {
    let flag = match index {
        0 => 0x71,
        _ if index + 1 == count(stream) => 0x75,
        _ => 0x72,
    };
    packet.clear();
    packet.extend([0x52, 0x42, 0, flag, 0, sequence, 0, 0]);
    packet.extend(ticks.to_le_bytes());
    packet.extend(stream.chunks(PAYLOAD).nth(usize::from(index)).unwrap_or_default());
}

/// Damages a packet.
pub(crate) fn corrupt(packet: &mut Vec<u8>, kind: Corruption) {
    match kind {
        Corruption::Magic => packet[..2].fill(0),
        Corruption::Flag => packet[3] = 0x7F,
        Corruption::Sequence => packet[5] = packet[5].wrapping_add(100),
        Corruption::Short => packet.truncate(HEADER + (packet.len() - HEADER) / 2),
        Corruption::Long => packet.resize(packet.len() + 100, 0),
        Corruption::Payload => packet[HEADER..].iter_mut().for_each(|byte| *byte = !*byte),
    }
}

/// The 11-bit stream as the camera sends it at ten bits: the lowest bit of each code is dropped.
pub(crate) fn ten_bit_stream(packed: &[u8], ten: &mut Vec<u8>) {
    let (mut bits, mut held, mut out, mut waiting) = (0_u32, 0, 0_u32, 0);
    for &byte in packed {
        bits = bits << 8 | u32::from(byte);
        held += 8;
        if held < 11 {
            continue;
        }
        held -= 11;
        out = out << 10 | (bits >> (held + 1) & 0x3FF);
        waiting += 10;
        while waiting >= 8 {
            waiting -= 8;
            ten.push((out >> waiting) as u8);
        }
    }
}

/// Which packets are lost by chance: the splitmix64 generator, the same for the same seed.
#[derive(Debug)]
pub(crate) struct Chance {
    probability: f64,
    state: u64,
}

impl Chance {
    pub(crate) fn new(probability: f64, seed: u64) -> Self {
        Self { probability, state: seed }
    }

    /// Whether the next packet is lost.
    pub(crate) fn strikes(&mut self) -> bool {
        if self.probability <= 0.0 {
            return false;
        }
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.state ^ self.state >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((mixed ^ mixed >> 31) >> 11) as f64 / (1_u64 << 53) as f64 <= self.probability
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tumbled_kinect::packed::{GROUP_PIXELS, pack_group};

    #[test]
    fn chance_strikes_as_often_as_asked_and_the_same_each_time() {
        let strikes = |seed: u64| {
            let mut chance = Chance::new(0.01, seed);
            (0..100_000).filter(|_| chance.strikes()).count()
        };
        // Binomial: 1000 with a standard deviation of 31.
        assert!((850..1_150).contains(&strikes(1)), "{}", strikes(1));
        assert_eq!(strikes(7), strikes(7));
        let mut always = Chance::new(1.0, 0);
        assert!((0..1_000).all(|_| always.strikes()));
    }

    #[test]
    fn ten_bits_are_the_higher_ten() {
        let codes: [u16; GROUP_PIXELS] = [0, 1, 2, 3, 1_024, 2_045, 2_046, 2_047];
        let mut ten = Vec::new();
        ten_bit_stream(&pack_group(codes), &mut ten);
        let bits = codes.iter().fold(0_u128, |bits, &code| bits << 10 | u128::from(code >> 1));
        assert_eq!(ten, bits.to_be_bytes()[6..]); // 80 bits
    }
}

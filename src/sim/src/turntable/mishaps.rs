//! What happens to replies on a serial line.

use super::emulator::Outgoing;
use crate::noise::Noise;
use tumbled_model::Span;
use tumbled_serial::zaber::checksum;

/// Something that happens to a reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Mishap {
    /// It never comes.
    Dropped,
    /// It comes 150 ms late, when nobody waits for it any more.
    Late,
    /// A bit of it is wrong.
    BitFlipped,
    /// Its end is missing, the line end too.
    Cut,
    /// Its id is another one, and its checksum right: it belongs to somebody else's request.
    WrongId,
    /// Noise comes before it, as when a plug is touched.
    Noise,
}

const ALL: [Mishap; 6] =
    [Mishap::Dropped, Mishap::Late, Mishap::BitFlipped, Mishap::Cut, Mishap::WrongId, Mishap::Noise];

/// Longer than a host waits (100 ms by default).
const LATE: Span = Span::from_micros(150_000);

/// Mishaps by chance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Mishaps {
    /// The probability that one happens to a reply, 0…1. Each kind is as likely as the others.
    pub chance: f64,
    /// Which ones.
    pub seed: u64,
}

impl Mishaps {
    /// Lets happen to the `index`-th reply what happens to it. `None`: it never comes.
    pub fn befall(&self, index: u64, reply: Outgoing) -> Option<Outgoing> {
        let mut noise = Noise::new(self.seed, "turntable.mishaps", index);
        if !noise.chance(self.chance) {
            return Some(reply);
        }
        let which = ALL.get(below(&mut noise, ALL.len())).copied().unwrap_or(Mishap::Dropped);
        which.befall(reply, &mut noise)
    }
}

/// Evenly over 0…n−1.
fn below(noise: &mut Noise, n: usize) -> usize {
    ((noise.uniform() * n as f64) as usize).min(n.saturating_sub(1))
}

impl Mishap {
    /// Lets it happen to a reply.
    pub fn befall(self, mut reply: Outgoing, noise: &mut Noise) -> Option<Outgoing> {
        match self {
            Self::Dropped => return None,
            Self::Late => reply.at = reply.at + LATE,
            Self::BitFlipped => {
                let (at, bit) = (below(noise, reply.bytes.len()), below(noise, 8));
                if let Some(byte) = reply.bytes.get_mut(at) {
                    *byte ^= 1 << bit;
                }
            }
            Self::Cut => reply.bytes.truncate(1 + below(noise, reply.bytes.len())),
            Self::WrongId => reply.bytes = under_another_id(&reply.bytes).unwrap_or(reply.bytes),
            Self::Noise => {
                let mut bytes: Vec<u8> = (0..1 + below(noise, 20)).map(|_| noise.bits() as u8).collect();
                bytes.append(&mut reply.bytes);
                reply.bytes = bytes;
            }
        }
        Some(reply)
    }
}

/// `@01 1 07 OK …` as `@01 1 57 OK …`: fifty ids on, checksum made right. `None` where there is no id.
fn under_another_id(bytes: &[u8]) -> Option<Vec<u8>> {
    let line = core::str::from_utf8(bytes).ok()?.trim_end();
    let (body, _) = line.strip_prefix('@')?.rsplit_once(':')?;
    let words: Vec<&str> = body.splitn(4, ' ').collect();
    let &[device, axis, id, rest] = words.as_slice() else { return None };
    let id: u8 = id.parse().ok()?;
    let body = format!("{device} {axis} {:02} {rest}", (id + 50) % 100);
    Some(format!("@{body}:{:02X}\r\n", checksum(&body)).into_bytes())
}

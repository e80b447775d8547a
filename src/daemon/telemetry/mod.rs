//! UDP telemetry: the target's state as a fixed struct, for computers that steer by it.
//!
//! * [`datagram`]: the struct and its table of fields;
//! * [`layout`]: types on the wire;
//! * `of_state`: a state as that struct;
//! * [`published`]: the C header and the description, made from the table;
//! * [`sender`]: datagrams to one address, never waiting; [`outlet`]: shared.

pub mod datagram;
pub mod layout;
mod of_state;
pub mod outlet;
pub mod published;
pub mod sender;

pub use datagram::{Telemetry, TelemetryError, reason_bits};
pub use outlet::TelemetryOutlet;
pub use sender::{SenderError, TelemetryCounts, TelemetrySender};

/// A session's id as 16 bytes: the digits where it is 32 hexadecimal ones (dashes left out), else the first bytes of its
/// BLAKE3 digest.
pub fn session_bytes(session: &str) -> [u8; 16] {
    let digits: String = session.chars().filter(|c| *c != '-').collect();
    match u128::from_str_radix(&digits, 16) {
        Ok(number) if digits.len() == 32 => number.to_be_bytes(),
        _ => {
            let digest = blake3::hash(session.as_bytes());
            digest.as_bytes().first_chunk().copied().unwrap_or_default()
        }
    }
}

#[cfg(test)]
mod tests {
    use super::session_bytes;

    #[test]
    fn hexadecimal_ids_are_their_digits_and_others_differ() {
        assert_eq!(session_bytes("00112233-4455-6677-8899-aabbccddeeff")[..3], [0x00, 0x11, 0x22]);
        assert_ne!(session_bytes("a session"), session_bytes("another session"));
    }
}

//! The sum that ends a Zaber line.

/// The checksum of a line's body: every byte after the first character and before the `:`. With it, all bytes add up to
/// a multiple of 256 (Zaber ASCII protocol manual, "checksum").
pub fn checksum(body: &str) -> u8 {
    body.bytes().fold(0, u8::wrapping_sub)
}

/// A line without its first character, cut before `:CC`; the two digits if it has them.
pub(super) fn split(line: &str) -> (&str, Option<&str>) {
    match line.rsplit_once(':') {
        Some((body, digits)) if digits.len() == 2 => (body, Some(digits)),
        _ => (line, None),
    }
}

/// Two upper-case hex digits; devices write no others, so a changed case is a changed byte.
pub(super) fn digits(text: &str) -> Option<u8> {
    let upper = text.bytes().all(|byte| matches!(byte, b'0'..=b'9' | b'A'..=b'F'));
    if upper { u8::from_str_radix(text, 16).ok() } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bodies and their checksums, worked out apart from this code.
    const VECTORS: [(&str, u8); 14] = [
        ("01 tools echo", 0x8F),
        ("1 1 9 home", 0x5C),
        ("1 1 7 get encoder.pos", 0x47),
        ("1 1 14 move abs 192000", 0x80),
        ("1 1 8 get limit.cycle.dist", 0x67),
        ("1 1 11 stop", 0x16),
        ("1 1 12 get encoder.vel", 0x26),
        ("1 set comm.alert 1", 0x00),
        ("01 1 07 OK BUSY -- 1066667", 0xA0),
        ("01 1 08 OK IDLE -- 768000", 0xFF),
        ("01 1 09 OK BUSY WR 0", 0x8F),
        ("01 1 10 RJ IDLE -- BADDATA", 0x58),
        ("01 1 13 OK BUSY FS 0", 0xA4),
        ("01 1 IDLE --", 0x96),
    ];

    #[test]
    fn the_vectors_hold() {
        for (body, expected) in VECTORS {
            assert_eq!(checksum(body), expected, "{body}");
            let sum = body.bytes().fold(expected, u8::wrapping_add);
            assert_eq!(sum, 0, "{body}: all bytes and the checksum add up to a multiple of 256");
        }
    }

    #[test]
    fn only_two_upper_case_digits_are_a_checksum() {
        assert_eq!(split("a:b:0F"), ("a:b", Some("0F")));
        assert_eq!(split("a:0"), ("a:0", None));
        assert_eq!((digits("0F"), digits("0f"), digits("+1")), (Some(15), None, None));
    }
}

//! Seconds written as decimal numbers, exactly.

use tumbled_model::UnixNs;

/// Nanoseconds of a non-negative decimal number of seconds: `1332333`, `1332333.25`, `.5`.
///
/// Digits past the ninth decimal are dropped. `None` for anything else, and for times past the year 2262. Not by way of `f64`, which holds today's
/// seconds only to 0.2 µs.
pub(crate) fn parse_seconds(text: &str) -> Option<UnixNs> {
    let (whole, fraction) = text.split_once('.').unwrap_or((text, ""));
    let digits_only = whole.bytes().chain(fraction.bytes()).all(|byte| byte.is_ascii_digit());
    if !digits_only || (whole.is_empty() && fraction.is_empty()) {
        return None;
    }
    let seconds: i64 = if whole.is_empty() { 0 } else { whole.parse().ok()? };
    let mut nanoseconds = 0;
    let mut place = 100_000_000;
    for digit in fraction.bytes().take(9) {
        nanoseconds += i64::from(digit - b'0') * place;
        place /= 10;
    }
    Some(UnixNs(seconds.checked_mul(1_000_000_000)?.checked_add(nanoseconds)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn decimals_are_exact_and_everything_else_is_refused() {
        assert_eq!(parse_seconds("1332333.25"), Some(UnixNs(1_332_333_250_000_000)));
        assert_eq!(parse_seconds("1790000000.123456789999"), Some(UnixNs(1_790_000_000_123_456_789)));
        assert_eq!(parse_seconds(".5"), Some(UnixNs(500_000_000)));
        assert_eq!(parse_seconds("7."), Some(UnixNs(7_000_000_000)));
        for text in ["", ".", "-1", "+1", "1e9", "1,5", "1.2.3", " 1", "nan", "9223372037", "99999999999999999999"] {
            assert_eq!(parse_seconds(text), None, "{text}");
        }
    }

    proptest! {
        #[test]
        fn printing_and_parsing_is_the_identity(ns in 0..i64::MAX) {
            let text = format!("{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000);
            prop_assert_eq!(parse_seconds(&text), Some(UnixNs(ns)));
        }

        #[test]
        fn any_text_is_parsed_or_refused(text in "\\PC{0,30}") {
            if let Some(t) = parse_seconds(&text) {
                prop_assert!(t.0 >= 0);
            }
        }
    }
}

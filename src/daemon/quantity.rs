//! Durations and sizes as people write them, on the command line and in the config: `60s`, `2m`, `500ms`, bare seconds; `1GiB`, `500MB`, bare bytes.

use std::time::Duration;

/// Units of time in seconds, longest name first where one ends another.
const TIMES: [(&str, f64); 5] = [("ms", 1e-3), ("us", 1e-6), ("h", 3_600.0), ("m", 60.0), ("s", 1.0)];
/// Units of size in bytes.
const SIZES: [(&str, f64); 9] = [
    ("KiB", 1_024.0),
    ("MiB", 1_048_576.0),
    ("GiB", 1_073_741_824.0),
    ("TiB", 1_099_511_627_776.0),
    ("kB", 1e3),
    ("MB", 1e6),
    ("GB", 1e9),
    ("TB", 1e12),
    ("B", 1.0),
];

/// A text that is no duration or size.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum QuantityError {
    /// No duration.
    #[error("expected a duration such as 60s, 2m, 500ms or bare seconds, above 0")]
    Duration,
    /// No size.
    #[error("expected a size such as 1GiB, 500MB or bare bytes")]
    Size,
}

/// A duration above 0, at most 100 years.
///
/// # Errors
/// [`QuantityError::Duration`].
pub fn duration(text: &str) -> Result<Duration, QuantityError> {
    let seconds = number(text, &TIMES).filter(|seconds| *seconds > 0.0 && *seconds < 100.0 * 365.25 * 86_400.0);
    seconds.map(Duration::from_secs_f64).ok_or(QuantityError::Duration)
}

/// A size in bytes.
///
/// # Errors
/// [`QuantityError::Size`].
pub fn size(text: &str) -> Result<u64, QuantityError> {
    let bytes = number(text, &SIZES).filter(|bytes| (0.0..9e18).contains(bytes));
    bytes.map(|bytes| bytes as u64).ok_or(QuantityError::Size)
}

/// The number and its unit's factor, multiplied; without a unit the number.
fn number(text: &str, units: &[(&str, f64)]) -> Option<f64> {
    let text = text.trim();
    let unit = units.iter().find_map(|(name, factor)| Some((text.strip_suffix(name)?, *factor)));
    let (digits, factor) = unit.unwrap_or((text, 1.0));
    let digits = digits.trim_end();
    // Not `inf`, `nan` or `1e5`: those are floats, and no quantities people write.
    let plain = !digits.is_empty() && digits.bytes().all(|b| b.is_ascii_digit() || b == b'.');
    if plain { digits.parse::<f64>().ok().map(|number| number * factor) } else { None }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations() {
        let ms = |text| duration(text).map(|d| d.as_millis());
        assert_eq!(
            [ms("60s"), ms("2m"), ms("500ms"), ms("1.5"), ms("1 h")],
            [Ok(60_000), Ok(120_000), Ok(500), Ok(1_500), Ok(3_600_000)]
        );
        for wrong in ["", "s", "-1", "0", "1x", "inf", "1e9h", "nan", "1..2"] {
            assert_eq!(duration(wrong), Err(QuantityError::Duration), "{wrong}");
        }
    }

    #[test]
    fn sizes() {
        assert_eq!(
            [size("1GiB"), size("500MB"), size("4096"), size("2 KiB"), size("0")],
            [Ok(1 << 30), Ok(500_000_000), Ok(4_096), Ok(2_048), Ok(0)]
        );
        for wrong in ["", "GiB", "-1B", "1QB"] {
            assert_eq!(size(wrong), Err(QuantityError::Size), "{wrong}");
        }
    }
}

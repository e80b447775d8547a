//! "Did you mean": the name a person most likely wanted.

/// The candidate nearest to what was written, if one is near enough to be meant.
///
/// Distance: edits with swapped neighbours counted once, upper and lower case alike, `-` and `_` alike. Near enough:
/// at most a third of the letters differ, or the one begins with the other (`vertical` for `vertical_offsets`).
pub fn nearest<'a>(written: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let fold = |text: &str| text.to_lowercase().replace('-', "_");
    let written = fold(written);
    let ranked = candidates.into_iter().filter_map(|candidate| {
        let folded = fold(candidate);
        let longest = written.chars().count().max(folded.chars().count());
        let distance = strsim::damerau_levenshtein(&written, &folded);
        let begins = written.chars().count() >= 3 && (folded.starts_with(&written) || written.starts_with(&folded));
        (distance * 3 <= longest || begins).then_some((distance, candidate))
    });
    ranked.min_by_key(|(distance, _)| *distance).map(|(_, candidate)| candidate)
}

#[cfg(test)]
mod tests {
    use super::nearest;

    #[test]
    fn slips_of_the_finger_are_understood_and_other_words_are_not() {
        let keys = ["port", "position_port", "vertical_offsets", "model"];
        assert_eq!(nearest("prot", keys), Some("port")); // one swap
        assert_eq!(nearest("vertical-offset", keys), Some("vertical_offsets")); // one letter of sixteen
        assert_eq!(nearest("vertical", keys), Some("vertical_offsets")); // its beginning
        assert_eq!(nearest("MODEL", keys), Some("model"));
        assert_eq!(nearest("colour", keys), None);
        assert_eq!(nearest("m", keys), None);
    }
}

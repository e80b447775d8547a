//! Stretches of a line that have points.

/// From and to, m along the line.
pub(super) type Span = (f64, f64);

/// The stretches that positions cover, joined over gaps of at most `gap`, rising.
pub(super) fn covered(mut positions: Vec<f64>, gap: f64) -> Vec<Span> {
    positions.sort_by(f64::total_cmp);
    let mut spans: Vec<Span> = Vec::new();
    for at in positions {
        match spans.last_mut() {
            Some((_, to)) if at - *to <= gap => *to = at,
            _ => spans.push((at, at)),
        }
    }
    spans
}

/// What two rising lists of stretches share.
pub(super) fn shared(a: &[Span], b: &[Span]) -> Vec<Span> {
    let overlap = |x: &Span, y: &Span| (x.0.max(y.0), x.1.min(y.1));
    a.iter().flat_map(|x| b.iter().map(move |y| overlap(x, y))).filter(|(from, to)| from < to).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_are_joined_over_small_gaps_and_cut_with_others() {
        let a = covered(vec![3.0, 1.0, 1.5, 3.3, 2.0], 0.6);
        assert_eq!(a, vec![(1.0, 2.0), (3.0, 3.3)]);
        assert_eq!(shared(&a, &[(1.5, 3.1)]), vec![(1.5, 2.0), (3.0, 3.1)]);
        assert_eq!(shared(&a, &[(2.2, 2.8)]), vec![]);
        assert_eq!(covered(Vec::new(), 1.0), vec![]);
    }
}

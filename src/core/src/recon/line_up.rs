//! Sides of a plane that lie on one line: something in front cut it in pieces, or stands out from it.
//!
//! Together they know its direction far better than each alone: two ends of a line that a strut crosses.

use super::boundary::{Side, fitted};
use nalgebra::{Point2, Vector2};

/// Sides may be of one line where they are parallel to within sin 12°, and as far off it as their corners may be, in cells.
const PARALLEL_SINE: f64 = 0.2079;
const OFF_CELLS: f64 = 2.0;
/// They are where their points scatter about it no more than this beyond how they scatter about their own lines.
const SCATTER: f64 = 1.25;

/// Lays sides on the lines they share, the longest first; the others stay.
pub(super) fn lined_up(sides: &mut [&mut Side], cell_m: f64) {
    sides.sort_by(|a, b| b.length().total_cmp(&a.length()));
    let mut free: Vec<usize> = (0..sides.len()).collect();
    while let Some(first) = (!free.is_empty()).then(|| free.remove(0)) {
        let mut group = vec![first];
        let Some(mut line) = Line::of(sides, &group, cell_m) else { continue };
        free.retain(|number| {
            let Some(longer) = joined(sides, &group, &line, *number, cell_m) else { return true };
            group.push(*number);
            line = longer;
            false
        });
        if group.len() < 2 {
            continue;
        }
        for number in group {
            let Some(side) = sides.get_mut(number) else { continue };
            (side.from, side.to) = (line.foot(&side.from), line.foot(&side.to));
            side.direction_sigma_rad = line.direction_sigma_rad;
        }
    }
}

/// The line of a group and one side more; `None`: the side is not of the group's line.
fn joined(sides: &[&mut Side], group: &[usize], line: &Line, number: usize, cell_m: f64) -> Option<Line> {
    let side = sides.get(number)?;
    let way = side.direction();
    let sine = way.x * line.along.y - way.y * line.along.x;
    // Outlines go anticlockwise: sides that face each other go opposite ways.
    if sine.abs() > PARALLEL_SINE || way.dot(&line.along) < 0.0 {
        return None;
    }
    if [side.from, side.to].iter().any(|end| (end - line.foot(end)).norm() > OFF_CELLS * cell_m) {
        return None;
    }
    let all: Vec<usize> = group.iter().copied().chain([number]).collect();
    let alone = all.iter().filter_map(|number| sides.get(*number));
    let (squares, count) = alone
        .fold((0.0, 0.0), |(sum, count), side| (sum + side.sigma_m * side.sigma_m * side.count, count + side.count));
    Line::of(sides, &all, cell_m).filter(|line| line.sigma_m * line.sigma_m * count <= SCATTER * SCATTER * squares)
}

/// A line through several sides' points.
struct Line {
    from: Point2<f64>,
    along: Vector2<f64>,
    sigma_m: f64,
    direction_sigma_rad: f64,
}

impl Line {
    fn of(sides: &[&mut Side], group: &[usize], cell_m: f64) -> Option<Self> {
        let longest = sides.get(*group.first()?)?;
        let (from, along) = (longest.from, longest.direction());
        let out = Vector2::new(along.y, -along.x);
        let members = || group.iter().filter_map(|number| sides.get(*number));
        let places: Vec<(f64, f64)> = members()
            .flat_map(|side| side.places.iter().map(|place| ((place - from).dot(&along), (place - from).dot(&out))))
            .collect();
        let (level, slope, sigma_m) = fitted(&places, cell_m)?;
        // As many as are independent, spread as all of them are.
        let (count, number) = (members().map(|side| side.count).sum::<f64>(), places.len() as f64);
        let mean = places.iter().map(|(at, _)| at).sum::<f64>() / number;
        let spread = places.iter().map(|(at, _)| (at - mean) * (at - mean)).sum::<f64>() / number;
        Some(Self {
            from: from + out * level,
            along: (along + out * slope).normalize(),
            sigma_m,
            direction_sigma_rad: sigma_m / libm::sqrt(count * spread),
        })
    }

    /// The place of the line that is next to one.
    fn foot(&self, place: &Point2<f64>) -> Point2<f64> {
        self.from + self.along * (place - self.from).dot(&self.along)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A side from x = `from` to `to` at the height of a line, its points 2 mm off in turn.
    fn side(from: f64, to: f64, height: impl Fn(f64) -> f64) -> Side {
        let count = ((to - from) / 0.01) as u32;
        let place = |n: u32| {
            let x = from + 0.01 * f64::from(n);
            Point2::new(x, height(x) + if n.is_multiple_of(2) { 0.002 } else { -0.002 })
        };
        Side::drawn([Point2::new(from, height(from)), Point2::new(to, height(to))], (0..=count).map(place).collect())
    }

    #[test]
    fn two_short_pieces_of_one_line_know_its_direction_as_the_whole_does() {
        let height = |x: f64| 0.3 + 0.02 * x;
        let (mut a, mut b) = (side(0.0, 0.15, height), side(0.25, 0.4, height));
        // Each alone is a little off.
        a.to.y += 0.003;
        b.from.y -= 0.003;
        let vague = a.direction_sigma_rad;
        lined_up(&mut [&mut a, &mut b], 0.012);
        for side in [&a, &b] {
            assert!(side.direction_sigma_rad < 0.4 * vague, "{} {vague}", side.direction_sigma_rad);
            assert!((side.direction().y / side.direction().x - 0.02).abs() < 0.003, "{:?}", side.direction());
            assert!([side.from, side.to].iter().all(|end| (end.y - height(end.x)).abs() < 0.001));
        }
        // What is between them is no edge.
        assert!((a.to.x - 0.15).abs() < 1e-3 && (b.from.x - 0.25).abs() < 1e-3);
    }

    #[test]
    fn a_step_or_the_other_side_is_another_line() {
        let (mut a, mut b) = (side(0.0, 0.15, |_| 0.3), side(0.25, 0.4, |_| 0.312));
        let mut back = side(0.25, 0.4, |_| 0.301);
        (back.from, back.to) = (back.to, back.from);
        let before = [a.direction_sigma_rad, b.direction_sigma_rad, back.direction_sigma_rad];
        lined_up(&mut [&mut a, &mut b, &mut back], 0.012);
        assert_eq!([a.direction_sigma_rad, b.direction_sigma_rad, back.direction_sigma_rad], before);
    }
}

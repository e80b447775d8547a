//! Which clusters are the target's.

use super::clusters::{Cluster, Clusters};
use super::{Search, Sphere};

/// A cluster this much as large as the target's is comparable: it could be taken for it.
const COMPARABLE: f64 = 1.0 / 3.0;
/// A cluster with this much of it where the target is expected is a part of the target.
const WITHIN: f64 = 0.9;
/// What is nearer to the target than this is a part of it, m: a panel behind its yoke, which a sensor does not see.
pub(super) const BESIDE_M: f64 = 0.15;
/// A target found without a region is so long, m. `LONGEST_M` is also what tells a wall from it.
const SHORTEST_M: f64 = 0.2;
/// See [`SHORTEST_M`].
pub(super) const LONGEST_M: f64 = 3.0;
/// Two candidates without a region whose ranges differ by less, m, are equally near.
const AS_NEAR_M: f64 = 0.3;

/// What was chosen.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Choice {
    /// By cluster: whether its points are the target's.
    pub(super) is_target: Vec<bool>,
    /// Whether another cluster, or what the target's cluster runs into, could be taken for the target.
    pub(super) ambiguous: bool,
    /// The clusters next to the target's own, in it or reaching into where it is: whether they move with it is not known here.
    pub(super) beside: Vec<usize>,
    /// The target's own largest cluster.
    pub(super) first: Option<usize>,
}

impl Choice {
    fn nothing(clusters: &[Cluster]) -> Self {
        Self { is_target: vec![false; clusters.len()], ambiguous: false, beside: Vec::new(), first: None }
    }

    fn take(&mut self, number: usize) {
        if let Some(taken) = self.is_target.get_mut(number) {
            *taken = true;
        }
    }
}

/// The target where it is expected: of what reaches into the sphere of the target, the cluster that fills most of it,
/// cells near the middle counted more; and every other that is all in it. Another that is comparable and only partly in
/// it, or as much of the target's own cluster beyond it, is ambiguous.
pub(super) fn expected(clusters: &Clusters, at: &Sphere, least_points: u32) -> Choice {
    let list = clusters.list();
    let mut choice = Choice::nothing(list);
    let fills = fills(clusters, at);
    let Some(first) = fullest(list, &fills, least_points) else { return choice };
    choice.take(first);
    choice.first = Some(first);
    let inside = fills.get(first).map_or(0.0, |fill| fill.inside);
    for (number, (cluster, fill)) in list.iter().zip(&fills).enumerate() {
        let all = f64::from(cluster.cells);
        if number == first {
            choice.ambiguous |= all - fill.inside >= COMPARABLE * inside;
            continue;
        }
        if fill.inside > 0.0 {
            choice.beside.push(number);
        }
        if fill.inside >= WITHIN * all {
            choice.take(number);
        } else {
            choice.ambiguous |= fill.inside > 0.0 && all >= COMPARABLE * inside;
        }
    }
    choice
}

/// The target where nothing is known of it.
pub(super) fn first_sight(clusters: &Clusters, search: &Search, least_points: u32) -> Choice {
    let list = clusters.list();
    let mut choice = Choice::nothing(list);
    let first = match search {
        Search::Everything => {
            choice.is_target.fill(true);
            return choice;
        }
        Search::Region(region) => {
            let fills = fills(clusters, &Sphere { center: region.center.coords, radius_m: region.radius_m });
            fullest(list, &fills, least_points)
        }
        Search::Nearest => nearest(list, least_points),
    };
    let Some((number, target)) = first.and_then(|number| Some((number, list.get(number)?))) else { return choice };
    choice.take(number);
    choice.first = Some(number);
    for (other, cluster) in list.iter().enumerate().filter(|(other, _)| *other != number) {
        if cluster.gap_m(target) < BESIDE_M {
            choice.take(other);
            choice.beside.push(other);
        } else if f64::from(cluster.cells) >= COMPARABLE * f64::from(target.cells) {
            choice.ambiguous |= match search {
                Search::Nearest => {
                    is_plausible(cluster, least_points) && cluster.range_m() - target.range_m() < AS_NEAR_M
                }
                Search::Region(_) | Search::Everything => true,
            };
        }
    }
    choice
}

/// How much of a sphere a cluster fills, in cells.
#[derive(Clone, Copy, Debug, Default)]
struct Fill {
    /// Cells in the sphere.
    inside: f64,
    /// The same, each counted 1 in the middle and 0 at the rim: 1 − d²/R².
    weight: f64,
}

fn fills(clusters: &Clusters, sphere: &Sphere) -> Vec<Fill> {
    let mut fills = vec![Fill::default(); clusters.list().len()];
    for (middle, cluster) in clusters.cells() {
        let share = (middle - sphere.center).norm_squared() / (sphere.radius_m * sphere.radius_m);
        if let Some(fill) = fills.get_mut(cluster).filter(|_| share <= 1.0) {
            fill.inside += 1.0;
            fill.weight += 1.0 - share;
        }
    }
    fills
}

/// Of equals the first.
fn fullest(list: &[Cluster], fills: &[Fill], least_points: u32) -> Option<usize> {
    let mut best: Option<(f64, usize)> = None;
    for (number, (cluster, fill)) in list.iter().zip(fills).enumerate() {
        let fuller = best.is_none_or(|(weight, _)| fill.weight > weight);
        if cluster.points >= least_points && fill.inside > 0.0 && fuller {
            best = Some((fill.weight, number));
        }
    }
    best.map(|(_, number)| number)
}

fn nearest(list: &[Cluster], least_points: u32) -> Option<usize> {
    let plausible = list.iter().enumerate().filter(|(_, cluster)| is_plausible(cluster, least_points));
    plausible.min_by(|(_, a), (_, b)| a.range_m().total_cmp(&b.range_m())).map(|(number, _)| number)
}

fn is_plausible(cluster: &Cluster, least_points: u32) -> bool {
    cluster.points >= least_points && (SHORTEST_M..=LONGEST_M).contains(&cluster.length_m())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::RegionOfInterest;
    use crate::segment::scene::square;
    use nalgebra::Point3;
    use tumbled_model::Point;

    /// Squares, by the middle and half a side, facing the sensor at the origin, in clusters of their own.
    fn squares(of: &[([f32; 3], f32)]) -> Clusters {
        let places: Vec<[f32; 3]> = of.iter().flat_map(|(at, half)| square(*at, *half)).collect();
        let mut clusters = Clusters::new();
        let range = |[x, y, z]: [f32; 3]| libm::sqrtf(x * x + y * y + z * z);
        clusters.find(places.iter().map(|place| (*place, range(*place))), 0.05);
        assert_eq!(clusters.list().len(), of.len());
        clusters
    }

    fn region() -> Search {
        Search::Region(RegionOfInterest { center: Point::new(2.5, 0.0, 0.0), radius_m: 1.5 })
    }

    fn at() -> Sphere {
        Sphere { center: Point3::new(2.5, 0.0, 0.0), radius_m: 0.6 }
    }

    #[test]
    fn in_a_region_the_largest_near_its_middle_is_the_target() {
        // At 1.2 m from the centre of 1.5 m a cell counts 0.36: 0.8 m × 0.8 m there is less than 0.6 m × 0.6 m in the
        // middle, and could still be taken for it.
        let clusters = squares(&[([2.5, 1.2, 0.0], 0.4), ([2.5, 0.0, 0.0], 0.3)]);
        let choice = first_sight(&clusters, &region(), 30);
        assert_eq!((choice.is_target.as_slice(), choice.ambiguous), (&[false, true][..], true));
        // A ball of 0.2 m × 0.2 m is left out and could not: a ninth of the target.
        let clusters = squares(&[([2.5, 1.2, 0.0], 0.1), ([2.5, 0.0, 0.0], 0.3)]);
        let choice = first_sight(&clusters, &region(), 30);
        assert_eq!((choice.is_target.as_slice(), choice.ambiguous), (&[false, true][..], false));
    }

    #[test]
    fn a_panel_beside_the_body_is_a_part_of_the_target() {
        // Body to 0.3 m, panel from 0.42 m: a gap of 0.12 m.
        let clusters = squares(&[([2.5, 0.0, 0.0], 0.3), ([2.5, 0.67, 0.0], 0.25)]);
        let choice = first_sight(&clusters, &region(), 30);
        assert_eq!((choice.is_target.as_slice(), choice.ambiguous), (&[true, true][..], false));
    }

    #[test]
    fn without_a_region_the_nearest_of_plausible_size_is_the_target() {
        // A hand's breadth at 1 m, a target at 2 m, another at 2.25 m and one at 4 m, a wall of 3.6 m at 6 m.
        let near = ([1.0, 0.0, 0.0], 0.05);
        let target = ([2.0, 0.0, 0.0], 0.3);
        let wall = ([6.0, 0.0, 0.0], 1.8);
        let choice = first_sight(&squares(&[near, wall, ([4.0, 1.0, 0.0], 0.3), target]), &Search::Nearest, 30);
        assert_eq!((choice.is_target.as_slice(), choice.ambiguous), (&[false, false, false, true][..], false));
        let choice = first_sight(&squares(&[near, wall, ([2.1, 0.8, 0.0], 0.3), target]), &Search::Nearest, 30);
        assert!(choice.ambiguous && choice.is_target == [false, false, false, true]);
    }

    #[test]
    fn everything_is_everything() {
        let choice = first_sight(&squares(&[([1.0, 0.0, 0.0], 0.05), ([6.0, 0.0, 0.0], 1.8)]), &Search::Everything, 30);
        assert_eq!((choice.is_target.as_slice(), choice.ambiguous), (&[true, true][..], false));
    }

    #[test]
    fn where_the_target_is_expected_its_parts_are_taken_and_an_intruder_is_kept_out() {
        // Two parts inside 0.6 m; a person 0.8 m wide whose edge is 0.5 m from the centre.
        let person = ([2.5, -0.9, 0.0], 0.4);
        let clusters = squares(&[person, ([2.5, 0.0, 0.0], 0.3), ([2.5, 0.45, 0.0], 0.08)]);
        let choice = expected(&clusters, &at(), 30);
        assert_eq!((choice.is_target.as_slice(), choice.ambiguous), (&[false, true, true][..], true));
        // The same person out of the sphere is nobody's business, and a small ball at its rim is kept out in silence.
        let clusters = squares(&[([2.5, -1.2, 0.0], 0.4), ([2.5, 0.0, 0.0], 0.3), ([2.5, 0.0, 0.6], 0.08)]);
        let choice = expected(&clusters, &at(), 30);
        assert_eq!((choice.is_target.as_slice(), choice.ambiguous), (&[false, true, false][..], false));
    }

    #[test]
    fn a_target_that_runs_into_something_is_ambiguous() {
        // One cluster of 2 m: 1.2 m of it inside, 0.8 m beyond.
        let clusters = squares(&[([2.5, 0.0, 0.0], 1.0)]);
        assert!(expected(&clusters, &at(), 30).ambiguous);
    }

    #[test]
    fn flecks_are_nobody() {
        let clusters = squares(&[([2.5, 0.0, 0.0], 0.02)]);
        assert!(clusters.list()[0].points < 30);
        assert_eq!(first_sight(&clusters, &region(), 30).is_target, [false]);
        assert_eq!(expected(&clusters, &at(), 30).is_target, [false]);
    }
}

//! From what a beam's footprint meets to the returns a sensor reports.

use super::surface::Surfaces;
use crate::noise::Noise;
use crate::world::{Hit, Ray, Snapshot};
use nalgebra::Vector3;

/// Rays that stand for a footprint: its centre and four about it.
pub(super) const RAYS: usize = 5;

/// How far out the four stand, as a share of the footprint's radius. With five equal weights the mean square distance
/// from the centre is 4/5 of its square: that of an even disc, 1/2.
pub(super) const RING: f64 = 0.790_569_415_042_094_8;

/// Less of a pulse than this share does not trigger the receiver: half a ray's.
const LEAST_SHARE: f64 = 0.1;

/// What comes back to the sensor at one distance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Echo {
    pub(super) range_m: f64,
    /// As a share of what a white diffuse surface that fills the beam gives back.
    pub(super) brightness: f64,
}

/// The returns of one firing.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Returns {
    pub(super) strongest: Option<Echo>,
    pub(super) last: Option<Echo>,
    /// What dual return reports beside the last: the strongest, or the second strongest when the strongest is the last.
    pub(super) beside: Option<Echo>,
}

/// What decides about returns.
#[derive(Clone, Copy, Debug)]
pub(super) struct Receiver<'a> {
    pub(super) surfaces: &'a Surfaces,
    /// Surfaces closer together than this give one return, m.
    pub(super) pulse_m: f64,
}

impl Receiver<'_> {
    /// The returns of a beam that looks along one ray: away from every edge.
    pub(super) fn single(&self, hit: Option<Hit>, ray: &Ray, noise: &mut Noise) -> Returns {
        let mut hits = [None; RAYS];
        hits[0] = hit.map(|hit| (hit, -hit.normal.dot(&ray.direction)));
        self.returns(&mut hits, 1, noise)
    }

    /// The returns of a beam whose footprint may hold an edge. `across` are the ring's rays from the centre's direction.
    pub(super) fn fan(
        &self,
        world: &Snapshot<'_>,
        ray: &Ray,
        across: [Vector3<f64>; 2],
        nearest_m: f64,
        noise: &mut Noise,
    ) -> Returns {
        let [side, up] = across;
        let mut hits = [None; RAYS];
        let offsets = [Vector3::zeros(), side, -side, up, -up];
        for (hit, offset) in hits.iter_mut().zip(offsets) {
            // The ring is milliradians wide: scaling back to length 1 by the first term is exact to 1e-11.
            let direction = (ray.direction + offset) * (1.0 - 0.5 * offset.norm_squared());
            let met = world.cast(&Ray { origin: ray.origin, direction }, nearest_m);
            *hit = met.map(|met| (met, -met.normal.dot(&direction)));
        }
        self.returns(&mut hits, RAYS, noise)
    }

    /// Groups what the rays met into echoes, nearest first, and names them.
    fn returns(&self, hits: &mut [Option<(Hit, f64)>; RAYS], rays: usize, noise: &mut Noise) -> Returns {
        if hits.iter().all(Option::is_none) {
            return Returns::default();
        }
        let range = |hit: &Option<(Hit, f64)>| hit.map_or(f64::INFINITY, |(hit, _)| hit.range_m);
        hits.sort_by(|a, b| range(a).total_cmp(&range(b)));
        let weight = 1.0 / rays as f64;
        // One draw decides a firing: a brighter echo is seen wherever a fainter one is.
        let luck = noise.uniform();
        let mut echoes = [None; RAYS];
        let mut building = Building::default();
        let mut found = 0;
        for (hit, cos) in hits.iter().flatten() {
            if building.share > 0.0 && hit.range_m - building.first_m > self.pulse_m {
                keep(&mut echoes, &mut found, building.echo(luck));
                building = Building::default();
            }
            let answer = self.surfaces.answer(hit.material, hit.range_m, *cos);
            if building.share == 0.0 {
                building.first_m = hit.range_m;
            }
            building.share += weight;
            building.detection += weight * answer.detection;
            // What is certainly too faint to be seen does not draw the mean either.
            let pull = weight * answer.brightness * answer.detection;
            building.brightness += weight * answer.brightness;
            building.pull += pull;
            building.range_pull_m += pull * hit.range_m;
        }
        keep(&mut echoes, &mut found, building.echo(luck));
        name(&echoes)
    }
}

/// An echo while its rays are summed up.
#[derive(Clone, Copy, Debug, Default)]
struct Building {
    first_m: f64,
    share: f64,
    detection: f64,
    brightness: f64,
    pull: f64,
    range_pull_m: f64,
}

impl Building {
    fn echo(&self, luck: f64) -> Option<Echo> {
        let seen = self.share >= LEAST_SHARE && self.pull > 0.0 && luck < self.detection / self.share;
        seen.then(|| Echo { range_m: self.range_pull_m / self.pull, brightness: self.brightness })
    }
}

fn keep(echoes: &mut [Option<Echo>; RAYS], found: &mut usize, echo: Option<Echo>) {
    if echo.is_some()
        && let Some(place) = echoes.get_mut(*found)
    {
        *place = echo;
        *found += 1;
    }
}

/// Strongest and last of the echoes, which come nearest first. Of equally strong ones the nearer counts.
fn name(echoes: &[Option<Echo>; RAYS]) -> Returns {
    let brightest = |without: Option<Echo>| {
        let others = echoes.iter().flatten().filter(|echo| Some(**echo) != without);
        others.copied().reduce(|best, echo| if echo.brightness > best.brightness { echo } else { best })
    };
    let strongest = brightest(None);
    let last = echoes.iter().flatten().last().copied();
    let beside = if strongest == last { brightest(last).or(last) } else { strongest };
    Returns { strongest, last, beside }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::Material;
    use crate::world::Role;

    fn returns(ranges_m: [Option<f64>; RAYS]) -> Returns {
        let surfaces = Surfaces::default();
        let receiver = Receiver { surfaces: &surfaces, pulse_m: 0.9 };
        let hit = |range_m| (Hit { range_m, normal: Vector3::x(), material: Material::Matt, role: Role::Target }, 1.0);
        let mut hits = ranges_m.map(|range| range.map(hit));
        receiver.returns(&mut hits, RAYS, &mut Noise::new(1, "echo", 0))
    }

    fn ranges(returns: Returns) -> [Option<i32>; 3] {
        let mm = |echo: Option<Echo>| echo.map(|echo| libm::round(echo.range_m * 1e3) as i32);
        [mm(returns.strongest), mm(returns.last), mm(returns.beside)]
    }

    #[test]
    fn one_surface_is_one_return_three_times_named() {
        assert_eq!(ranges(returns([Some(3.0); RAYS])), [Some(3_000); 3]);
        assert_eq!(ranges(returns([None; RAYS])), [None; 3]);
    }

    #[test]
    fn an_edge_before_something_far_gives_two_returns() {
        // Three rays of five at 2 m, two at 5 m: the strongest is the near one, the last the far one.
        let two = returns([Some(2.0), Some(5.0), Some(2.0), Some(5.0), Some(2.0)]);
        assert_eq!(ranges(two), [Some(2_000), Some(5_000), Some(2_000)]);
        // The other way round strongest and last are one: the second strongest stands beside it.
        let two = returns([Some(5.0), Some(5.0), Some(2.0), Some(5.0), Some(2.0)]);
        assert_eq!(ranges(two), [Some(5_000), Some(5_000), Some(2_000)]);
    }

    #[test]
    fn surfaces_closer_than_the_pulse_are_mixed() {
        // (3 · 2.0 + 2 · 2.5) / 5 = 2.2 m: a point where nothing is.
        let mixed = returns([Some(2.0), Some(2.5), Some(2.0), Some(2.5), Some(2.0)]);
        assert_eq!(ranges(mixed), [Some(2_200); 3]);
    }

    #[test]
    fn three_surfaces_give_the_brightest_and_the_farthest() {
        let three = returns([Some(2.0), Some(4.0), Some(4.0), Some(4.0), Some(6.0)]);
        assert_eq!(ranges(three), [Some(4_000), Some(6_000), Some(4_000)]);
    }
}

//! What stands beside the target and touches it nowhere: does it move with the target, or does it stand still?
//!
//! A panel whose yoke no sensor sees is a part of the target; a stand under it is not, and would hold the model fast in the
//! room. Neither its place nor its size tells which. So it is remembered where it was and how the target lay; when the target
//! has moved, what is seen is held against both: the thing as it stood, and as the target would have carried it.

use crate::epoch::Epoch;
use crate::segment::{Beside, Segment, Segmenter};
use crate::track::Tracker;
use nalgebra::{Isometry3, Point3};

/// Points of a thing that are held against each other, at most.
const SAMPLE: usize = 256;
/// Of fewer points nothing is remembered: they are the target's where the model is, and nobody's elsewhere.
const LEAST_POINTS: usize = 12;
/// Things remembered of one sensor, at most; then the oldest that is no part is forgotten.
const MOST: usize = 12;
/// The share of a thing's points that lie on the model: then it is a piece of the target that is known.
const KNOWN: f64 = 0.6;
/// On the model, or on the same thing: nearer than this, m.
const NEAR_M: f64 = 0.03;
/// Distances count so much at most, m: the edge of another thing is as far as its other end.
const FAR_M: f64 = 0.10;
/// The same thing as one remembered: its mean distance, m.
const ALIKE_M: f64 = 0.04;
/// Nothing is told before the target would have carried the thing so far, r.m.s., m: above the noise and the samples' gaps.
const CARRIED_M: f64 = 0.06;
/// One is believed when its distance is so much smaller than the other's.
const CLEARLY: f64 = 0.6;
/// What stands is there in most of the looks since it was first seen; who passes by the same place twice is not.
const MOSTLY: f64 = 2.0 / 3.0;
/// Carried so far and still like both: a body of revolution about the axis. It tells nothing of the motion, and is left out.
const ROUND_M: f64 = 0.30;

/// Things that were seen beside a target, by sensor.
#[derive(Clone, Debug, Default)]
pub(super) struct Company {
    sensors: Vec<Vec<Witness>>,
}

/// A thing as it was seen once.
#[derive(Clone, Debug)]
struct Witness {
    /// How the target lay then.
    t_rig_target: Isometry3<f64>,
    /// Rig frame, m.
    places: Vec<Point3<f64>>,
    /// It was seen to move with the target.
    is_part: bool,
    /// Epochs of the sensor since then, and those in which something was like it.
    looks: u32,
    seen: u32,
}

/// The target as it should be seen.
pub(super) struct Seen<'a> {
    pub(super) tracker: &'a mut Tracker,
    pub(super) t_rig_target: Isometry3<f64>,
    /// Whether the last fit left no doubt, and the motion has settled.
    pub(super) is_sure: bool,
}

/// What a thing is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fate {
    Part,
    Unknown,
    Stands,
}

impl Company {
    /// Leaves out of an epoch's segment what is not known to be of the target that lies at a pose, and not so near to it that it
    /// most likely is. Where the pose is sure, what is
    /// not known is judged, and what is seen to stand still is left out of every epoch from now on. Returns how many points of
    /// standing things there were.
    pub(super) fn part(
        &mut self,
        sensor: usize,
        epoch: &Epoch,
        segment: &mut Segment,
        segmenter: &mut Segmenter,
        target: Seen<'_>,
    ) -> usize {
        let Seen { tracker, t_rig_target, is_sure } = target;
        let mut standing = 0;
        let mut is_part = vec![false; segment.beside.len()];
        if is_sure {
            self.look(sensor);
        }
        if segment.beside.is_empty() {
            return standing;
        }
        let samples: Vec<Vec<Point3<f64>>> = segment.beside.iter().map(|beside| sample(epoch, beside)).collect();
        let shares = tracker.shares(&t_rig_target, &samples, NEAR_M);
        for (((beside, sample), share), is_part) in segment.beside.iter().zip(samples).zip(shares).zip(&mut is_part) {
            let fate = match () {
                () if share >= KNOWN => Fate::Part,
                () if !is_sure || beside.indices.len() < LEAST_POINTS => Fate::Unknown,
                () => self.judge(sensor, &sample, &t_rig_target),
            };
            *is_part = fate == Fate::Part || fate == Fate::Unknown && beside.is_near;
            if fate == Fate::Stands {
                segmenter.stands(beside.indices.iter().filter_map(|number| epoch.rig.place(*number)));
                standing += beside.indices.len();
            }
        }
        segment.without(|number| !is_part.get(number).copied().unwrap_or_default());
        standing
    }

    /// Nothing is remembered of a target that is not tracked.
    pub(super) fn forget(&mut self) {
        self.sensors.clear();
    }

    /// An epoch of a sensor begins.
    fn look(&mut self, sensor: usize) {
        if self.sensors.len() <= sensor {
            self.sensors.resize_with(sensor + 1, Vec::new);
        }
        self.sensors.get_mut(sensor).into_iter().flatten().for_each(|witness| witness.looks += 1);
    }

    fn judge(&mut self, sensor: usize, places: &[Point3<f64>], t_rig_target: &Isometry3<f64>) -> Fate {
        let Some(witnesses) = self.sensors.get_mut(sensor) else { return Fate::Unknown };
        let mut best: Option<(usize, Distances)> = None;
        for (number, witness) in witnesses.iter().enumerate() {
            let found = witness.distances(places, t_rig_target);
            if best.as_ref().is_none_or(|(_, least)| found.least() < least.least()) {
                best = Some((number, found));
            }
        }
        match best.filter(|(_, found)| found.least() < ALIKE_M) {
            None => {
                if witnesses.len() == MOST {
                    witnesses.remove(witnesses.iter().position(|witness| !witness.is_part).unwrap_or_default());
                }
                let (t_rig_target, places) = (*t_rig_target, places.to_vec());
                witnesses.push(Witness { t_rig_target, places, is_part: false, looks: 0, seen: 0 });
                Fate::Unknown
            }
            Some((number, found)) => {
                let Some(witness) = witnesses.get_mut(number) else { return Fate::Unknown };
                witness.seen += 1;
                if witness.is_part {
                    return if found.carried_m < NEAR_M { Fate::Part } else { Fate::Unknown };
                }
                let was_there = f64::from(witness.seen) >= MOSTLY * f64::from(witness.looks);
                match found.fate() {
                    Fate::Part => {
                        witness.is_part = true;
                        Fate::Part
                    }
                    Fate::Stands if was_there => {
                        witnesses.remove(number);
                        Fate::Stands
                    }
                    Fate::Stands | Fate::Unknown => Fate::Unknown,
                }
            }
        }
    }
}

/// How far what is seen is from what is remembered, on the average, m.
#[derive(Clone, Copy, Debug)]
struct Distances {
    /// From the thing where it was.
    still_m: f64,
    /// From where the target would have carried it.
    carried_m: f64,
    /// How far that is, r.m.s., m.
    way_m: f64,
}

impl Distances {
    fn least(&self) -> f64 {
        self.still_m.min(self.carried_m)
    }

    fn fate(&self) -> Fate {
        match () {
            () if self.way_m < CARRIED_M => Fate::Unknown,
            () if self.carried_m < CLEARLY * self.still_m => Fate::Part,
            () if self.still_m < CLEARLY * self.carried_m || self.way_m > ROUND_M => Fate::Stands,
            () => Fate::Unknown,
        }
    }
}

impl Witness {
    fn distances(&self, seen: &[Point3<f64>], t_rig_target: &Isometry3<f64>) -> Distances {
        let carry = t_rig_target * self.t_rig_target.inverse();
        let carried: Vec<Point3<f64>> = self.places.iter().map(|place| carry * place).collect();
        let ways = self.places.iter().zip(&carried).map(|(from, to)| (to - from).norm_squared());
        let way_m = libm::sqrt(ways.sum::<f64>() / self.places.len().max(1) as f64);
        Distances { still_m: distance(seen, &self.places), carried_m: distance(seen, &carried), way_m }
    }
}

/// The mean distance of points from the nearest of others, m.
fn distance(points: &[Point3<f64>], others: &[Point3<f64>]) -> f64 {
    let nearest = |point: &Point3<f64>| {
        let squares = others.iter().map(|other| (point - other).norm_squared());
        libm::sqrt(squares.fold(FAR_M * FAR_M, f64::min))
    };
    points.iter().map(nearest).sum::<f64>() / points.len().max(1) as f64
}

/// Some of a thing's points, evenly taken.
fn sample(epoch: &Epoch, beside: &Beside) -> Vec<Point3<f64>> {
    let step = beside.indices.len().div_ceil(SAMPLE).max(1);
    let places = beside.indices.iter().step_by(step).filter_map(|number| epoch.rig.place(*number));
    places.map(|place| Point3::from(place).cast()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Translation3, UnitQuaternion, Vector3};

    /// A target 2.4 m away that has turned by so much about an axis tilted by 7°.
    fn turned(degrees: f64) -> Isometry3<f64> {
        let axis = nalgebra::Unit::new_normalize(Vector3::new(0.122, 0.0, 0.9925));
        let turn = UnitQuaternion::from_axis_angle(&axis, degrees.to_radians());
        Isometry3::from_parts(Translation3::new(2.4, 0.0, 0.0), turn)
    }

    /// A grid of 16 × 16 points 20 mm apart, with 8 mm of noise along its normal, another one at every look.
    fn plate(middle: [f64; 3], along: Vector3<f64>, across: Vector3<f64>, look: usize) -> Vec<Point3<f64>> {
        let normal = along.cross(&across);
        let noise = |k: usize| ((k * 7919 + look * 104_729) % 1000) as f64 * 1e-3 - 0.5;
        (0..256)
            .map(|k| {
                let (i, j) = ((k % 16) as f64 - 7.5, (k / 16) as f64 - 7.5);
                Point3::from(middle) + (along * i + across * j) * 0.02 + normal * noise(k) * 0.016
            })
            .collect()
    }

    /// What becomes of a thing that is seen every degree while the target turns: the last fate before and at the verdict.
    fn verdict(thing: impl Fn(f64, usize) -> Vec<Point3<f64>>, most_deg: usize) -> Option<(usize, Fate)> {
        let mut company = Company::default();
        let fates = (0..=most_deg).map(|degree| {
            let at = turned(degree as f64);
            company.look(0);
            (degree, company.judge(0, &thing(degree as f64, degree), &at))
        });
        fates.into_iter().find(|(_, fate)| *fate != Fate::Unknown)
    }

    #[test]
    fn a_panel_that_is_carried_is_a_part_and_stays_one() {
        // 0.55 m off the axis, upright; 10° carry it 0.1 m.
        let panel = |degrees: f64, look: usize| {
            let body = plate([0.0, 0.55, 0.0], Vector3::y(), Vector3::z(), look);
            body.into_iter().map(|place| turned(degrees) * place).collect::<Vec<_>>()
        };
        let Some((degrees, Fate::Part)) = verdict(panel, 60) else { panic!("{:?}", verdict(panel, 60)) };
        assert!((6..=12).contains(&degrees), "{degrees}");
        let mut company = Company::default();
        let fates: Vec<Fate> = (0..90u32)
            .map(|degree| {
                company.look(0);
                company.judge(0, &panel(f64::from(degree), degree as usize), &turned(f64::from(degree)))
            })
            .collect();
        assert!(fates[degrees..].iter().all(|fate| *fate == Fate::Part), "{fates:?}");
    }

    #[test]
    fn a_panel_that_slides_along_itself_is_no_stand() {
        // Level, so that a turn about the upright axis moves it within its own plane.
        let panel = |degrees: f64, look: usize| {
            let body = plate([0.0, 0.55, 0.0], Vector3::x(), Vector3::y(), look);
            body.into_iter().map(|place| turned(degrees) * place).collect::<Vec<_>>()
        };
        assert!(matches!(verdict(panel, 60), Some((6..=40, Fate::Part))), "{:?}", verdict(panel, 60));
    }

    #[test]
    fn what_stands_still_is_found_out() {
        // A box's front 0.4 m beside the axis, and a level plate 0.5 m below the target.
        let front = |_: f64, look: usize| plate([2.3, 0.4, 0.0], Vector3::y(), Vector3::z(), look);
        assert!(matches!(verdict(front, 90), Some((8..=40, Fate::Stands))), "{:?}", verdict(front, 90));
        let below = |_: f64, look: usize| plate([2.4, 0.0, -0.5], Vector3::x(), Vector3::y(), look);
        assert!(matches!(verdict(below, 360), Some((20..=180, Fate::Stands))), "{:?}", verdict(below, 360));
    }

    #[test]
    fn nothing_is_told_while_the_target_rests_and_of_what_goes_its_own_way() {
        let mut company = Company::default();
        for look in 0..500 {
            let seen = plate([2.3, 0.4, 0.0], Vector3::y(), Vector3::z(), look);
            company.look(0);
            assert_eq!(company.judge(0, &seen, &turned(0.0)), Fate::Unknown);
        }
        // A person who goes to and fro beside it, 4 cm from look to look (30 a second), while it turns by 10° a second.
        for look in 0..2000usize {
            let way = (look * 4) % 200;
            let y = 0.4 + way.min(200 - way) as f64 * 0.01;
            let seen = plate([2.3, y, 0.0], Vector3::y(), Vector3::z(), look);
            company.look(1);
            assert_eq!(company.judge(1, &seen, &turned(look as f64 / 3.0)), Fate::Unknown, "{look}");
            assert!(company.sensors[1].len() <= MOST);
        }
    }
}

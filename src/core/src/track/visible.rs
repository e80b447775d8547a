//! Which part of the model a sensor sees: what faces it and is not hidden behind another part.

use super::frame::GRAZING;
use super::surfels::Surfels;
use nalgebra::{Point3, Vector3};

/// A cell of the picture: four pixels of 0.2°, rad. An even surface's elements leave no hole in it from 1.5 m on.
const CELL_RAD: f64 = 4.0 * 0.2 * core::f64::consts::PI / 180.0;
/// Nearer than that the cells grow: to so much of the surface, m.
const CELL_M: f64 = 0.02;
/// Cells along a side at most: four pixels each of all the view that is drawn.
const MOST_CELLS: usize = 256;
/// Hidden: farther than what is nearest there by more than this, m, and by more than its slope explains.
const BEHIND_M: f64 = 0.04;
/// What is farther than 60° from the picture's middle is not drawn, and nothing hides it: the least cosine.
const BESIDE: f64 = 0.5;

/// The least depth in each cell of a picture towards the model's middle.
#[derive(Clone, Debug, Default)]
pub(super) struct Visible {
    depths: Vec<f32>,
    numbers: Vec<u32>,
}

/// A pin-hole picture: unit axes, its lowest slopes, a cell's slope and the cells along each side.
struct Picture {
    across: Vector3<f64>,
    up: Vector3<f64>,
    along: Vector3<f64>,
    low: [f64; 2],
    cell: f64,
    cells: [usize; 2],
}

impl Visible {
    /// The numbers of the surfels that are seen from a viewpoint (target's frame, m), rising.
    pub(super) fn from(&mut self, surfels: &Surfels, viewpoint: &Point3<f64>) -> &[u32] {
        self.numbers.clear();
        let Some(picture) = Picture::of(surfels, viewpoint) else { return &self.numbers };
        let [wide, high] = picture.cells;
        self.depths.clear();
        self.depths.resize(wide * high, f32::INFINITY);
        for place in &surfels.positions {
            let Some((cell, depth)) = picture.project(&(place - viewpoint)) else { continue };
            if let Some(least) = self.depths.get_mut(cell) {
                *least = least.min(depth as f32);
            }
        }
        for ((place, normal), number) in surfels.positions.iter().zip(&surfels.normals).zip(0..) {
            let sight = place - viewpoint;
            let cosine = -normal.dot(&sight) / sight.norm();
            // Not so for what is no number either: a surfel at the viewpoint itself.
            let is_facing = cosine > GRAZING;
            if !is_facing {
                continue;
            }
            let is_hidden = picture.project(&sight).is_some_and(|(cell, depth)| {
                let nearest = self.depths.get(cell).map_or(f64::INFINITY, |least| f64::from(*least));
                // Within a cell the surface itself is so much deeper at one end than at the other.
                let slope = picture.cell * depth * (1.0 - cosine * cosine).max(0.0).sqrt() / cosine;
                depth > nearest + BEHIND_M + slope
            });
            if !is_hidden {
                self.numbers.push(number);
            }
        }
        &self.numbers
    }
}

impl Picture {
    /// Of all surfels before the viewpoint. `None`: there are none.
    fn of(surfels: &Surfels, viewpoint: &Point3<f64>) -> Option<Self> {
        let count = surfels.len().max(1) as f64;
        let middle = surfels.positions.iter().map(|place| place - viewpoint).sum::<Vector3<f64>>() / count;
        let along = middle.try_normalize(1e-6)?;
        let aside = if along.z.abs() < 0.9 { Vector3::z() } else { Vector3::x() };
        let across = along.cross(&aside).normalize();
        let up = across.cross(&along);
        let mut picture = Self { across, up, along, low: [0.0; 2], cell: 1.0, cells: [1; 2] };
        let (mut low, mut high, mut nearest) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2], f64::INFINITY);
        for place in &surfels.positions {
            let Some(([u, v], depth)) = picture.slopes(&(place - viewpoint)) else { continue };
            low = [low[0].min(u), low[1].min(v)];
            high = [high[0].max(u), high[1].max(v)];
            nearest = nearest.min(depth);
        }
        let extent = (high[0] - low[0]).max(high[1] - low[1]);
        if !extent.is_finite() {
            return None;
        }
        picture.low = low;
        picture.cell = CELL_RAD.max(CELL_M / nearest).max(extent / (MOST_CELLS - 1) as f64);
        let cells = |axis: f64| ((axis / picture.cell) as usize + 1).min(MOST_CELLS);
        picture.cells = [cells(high[0] - low[0]), cells(high[1] - low[1])];
        Some(picture)
    }

    /// Slopes across and up, and the depth, m. `None`: beside the sensor or behind it.
    fn slopes(&self, sight: &Vector3<f64>) -> Option<([f64; 2], f64)> {
        let depth = self.along.dot(sight);
        (depth > BESIDE * sight.norm() && depth > 1e-3)
            .then(|| ([self.across.dot(sight) / depth, self.up.dot(sight) / depth], depth))
    }

    /// The cell and the depth, m.
    fn project(&self, sight: &Vector3<f64>) -> Option<(usize, f64)> {
        let ([u, v], depth) = self.slopes(sight)?;
        let [wide, high] = self.cells;
        let at = |slope: f64, low: f64, cells: usize| (((slope - low) / self.cell) as usize).min(cells - 1);
        Some((at(v, self.low[1], high) * wide + at(u, self.low[0], wide), depth))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tumbled_model::RigNs;

    /// Square sheets of surfels 13 mm apart: (middle, normal, half its side in m).
    fn sheets(sheets: &[(Point3<f64>, Vector3<f64>, f64)]) -> (Surfels, Vec<usize>) {
        let (mut surfels, mut sheet_of) = (Surfels::default(), Vec::new());
        for (number, (middle, normal, half)) in sheets.iter().enumerate() {
            let u = normal.cross(&Vector3::new(0.31, 0.52, 0.17)).normalize();
            let v = normal.cross(&u);
            let steps = (half / 0.013) as i32;
            for (i, j) in (-steps..=steps).flat_map(|i| (-steps..=steps).map(move |j| (i, j))) {
                surfels.positions.push(middle + u * (f64::from(i) * 0.013) + v * (f64::from(j) * 0.013));
                surfels.normals.push(normal.normalize());
                surfels.weights.push(1e5);
                surfels.last_seen.push(RigNs(0));
                sheet_of.push(number);
            }
        }
        (surfels, sheet_of)
    }

    /// Shares of each sheet's surfels that are seen.
    fn shares(of: &[(Point3<f64>, Vector3<f64>, f64)], viewpoint: Point3<f64>) -> Vec<f64> {
        let (surfels, sheet_of) = sheets(of);
        let (mut visible, mut seen) = (Visible::default(), vec![0.0; of.len()]);
        for number in visible.from(&surfels, &viewpoint) {
            seen[sheet_of[*number as usize]] += 1.0;
        }
        let count = |sheet: usize| sheet_of.iter().filter(|at| **at == sheet).count() as f64;
        seen.iter().enumerate().map(|(sheet, seen)| seen / count(sheet)).collect()
    }

    #[test]
    fn what_faces_the_sensor_is_seen_and_what_faces_away_or_stands_edge_on_is_not() {
        let at = Point3::origin();
        // Seen from 2 m: at 0°, 60°, 80° (cosine 0.17), 83° (0.12) and from behind. Half sides of 2 cm: ± 0.6° of parallax.
        for (degrees, share) in [(0.0f64, 1.0), (60.0, 1.0), (80.0, 1.0), (83.0, 0.0), (180.0, 0.0)] {
            let (sin, cos) = libm::sincos(degrees.to_radians());
            let found = shares(&[(at, Vector3::new(sin, 0.0, -cos), 0.02)], Point3::new(0.0, 0.0, -2.0));
            assert_eq!(found, [share], "{degrees}°");
        }
    }

    #[test]
    fn what_is_behind_something_is_hidden_unless_it_is_only_4_cm_behind() {
        let toward = -Vector3::z();
        let screen = (Point3::new(0.0, 0.0, -0.3), toward, 0.3);
        for viewpoint in [Point3::new(0.0, 0.0, -2.0), Point3::new(0.1, -0.1, -0.9), Point3::new(0.0, 0.0, -5.0)] {
            // 0.3 m behind the screen, well within its shadow: hidden. The screen itself is seen whole.
            assert_eq!(shares(&[screen, (Point3::origin(), toward, 0.2)], viewpoint), [1.0, 0.0], "{viewpoint}");
            // Two centimetres behind it: as if it were the same surface.
            assert_eq!(
                shares(&[screen, (Point3::new(0.0, 0.0, -0.28), toward, 0.2)], viewpoint),
                [1.0, 1.0],
                "{viewpoint}"
            );
        }
        // A screen hides from behind just as well: it faces away and is not seen.
        let away = (Point3::new(0.0, 0.0, -0.3), Vector3::z(), 0.3);
        assert_eq!(shares(&[away, (Point3::origin(), toward, 0.2)], Point3::new(0.0, 0.0, -2.0)), [0.0, 0.0]);
    }

    #[test]
    fn a_slanted_surface_does_not_hide_itself() {
        for degrees in [0.0, 30.0, 60.0, 75.0] {
            let (sin, cos) = libm::sincos(f64::to_radians(degrees));
            let found = shares(&[(Point3::origin(), Vector3::new(sin, 0.0, -cos), 0.1)], Point3::new(0.0, 0.0, -1.5));
            assert_eq!(found, [1.0], "{degrees}°");
        }
    }

    #[test]
    fn from_within_or_from_nowhere_nothing_breaks() {
        let (surfels, _) = sheets(&[(Point3::origin(), Vector3::z(), 0.1)]);
        let mut visible = Visible::default();
        for place in [Point3::origin(), Point3::new(f64::NAN, 0.0, 0.0), Point3::new(0.0, 0.0, 1e-9)] {
            assert!(visible.from(&surfels, &place).len() <= surfels.len());
        }
        assert!(visible.from(&Surfels::default(), &Point3::origin()).is_empty());
    }
}

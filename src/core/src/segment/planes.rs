//! Floors, walls and stages: planes that go on beyond the place where the target is.

use super::Sphere;
use super::voxels::Voxels;
use nalgebra::{Matrix3, Vector3};

/// A cell's least edge, m: some forty points of a Kinect, and a normal within 2°.
const LEAST_EDGE_M: f32 = 0.10;
/// A cell with fewer points has no normal.
const LEAST_POINTS: f64 = 5.0;
/// A cell is flat when its points scatter less about its plane, m.
const FLAT_M: f64 = 0.03;
/// λ₁λ₂ over (λ₁ + λ₂)²: a cell below it is a line, seen by one beam, and any plane goes through it. λ₂ = λ₁/15.
const LEAST_WIDTH: f64 = 0.06;
/// Directions to a side of the cube on which normals are counted: 11° apart in the middle of a side.
const SIDE: usize = 10;
/// Offsets along a normal are counted in steps, m.
const STEP_M: f64 = 0.10;
/// Offsets that are told apart, to both sides; those farther away share the last.
const STEPS: usize = 160;
/// Cosine of the most that a cell's normal may be off its plane's: 20°.
const AGREES: f64 = 0.94;
/// A cell's mean may lie so far off its plane, m.
const OFF_M: f64 = 0.05;
/// Fewer cells are no plane worth a word.
const LEAST_CELLS: usize = 12;
/// Planes that are looked for.
const MOST_PLANES: usize = 4;
/// Peaks that are looked at: the target's own faces make some.
const MOST_PEAKS: usize = 8;
/// Points within this many standard deviations of a plane's own thickness are the plane's; at least and at most so many m.
const BAND: (f64, f64, f64) = (3.0, 0.025, 0.06);

/// A plane: n·x = offset, and what is within `band` of it is its own.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Plane {
    /// Unit normal, rig axes; its sign says nothing.
    pub(super) normal: Vector3<f64>,
    /// n·x of the plane's points, m.
    pub(super) offset: f64,
    /// m.
    pub(super) band: f64,
}

impl Plane {
    pub(super) fn holds(&self, place: [f32; 3]) -> bool {
        (self.normal.dot(&Vector3::from(place.map(f64::from))) - self.offset).abs() <= self.band
    }
}

/// What must be true of a plane for it to be the room's.
#[derive(Clone, Copy, Debug)]
pub(super) enum Large {
    /// It leaves the sphere on more than one side: its cells at the sphere's rim are a radius apart or more.
    CutsThrough(Sphere),
    /// It is longer than any target, m.
    LongerThan(f64),
}

/// Looks for planes; made once and reused.
#[derive(Clone, Debug)]
pub(super) struct PlaneFinder {
    voxels: Voxels,
    moments: Vec<Moments>,
    cells: Vec<Cell>,
    votes: Vec<u32>,
}

/// Sums over a cell's points.
#[derive(Clone, Copy, Debug)]
struct Moments {
    /// A point of the cell: the others are measured from it.
    from: [f32; 3],
    count: f64,
    sum: Vector3<f64>,
    /// xx, xy, xz, yy, yz, zz.
    squares: [f64; 6],
}

/// A cell that is flat.
#[derive(Clone, Copy, Debug)]
struct Cell {
    mean: Vector3<f64>,
    normal: Vector3<f64>,
    /// Mean square about its plane, m².
    variance: f64,
    /// The peak it is counted to.
    bin: usize,
    /// Whether it still votes.
    votes: bool,
}

impl PlaneFinder {
    pub(super) fn new() -> Self {
        let votes = vec![0; 3 * SIDE * SIDE * STEPS];
        Self { voxels: Voxels::new(LEAST_EDGE_M), moments: Vec::new(), cells: Vec::new(), votes }
    }

    /// The large planes among the places, those of most cells first; `edge` m is what connects points of one surface.
    pub(super) fn find(&mut self, places: impl Iterator<Item = [f32; 3]>, edge: f32, large: Large) -> Vec<Plane> {
        self.sort(places, edge.max(LEAST_EDGE_M));
        let center = match large {
            Large::CutsThrough(sphere) => sphere.center.coords,
            Large::LongerThan(_) => Vector3::zeros(),
        };
        self.cells.clear();
        self.cells.extend(self.moments.iter().filter_map(|moments| moments.cell(&center)));
        for cell in &self.cells {
            if let Some(votes) = self.votes.get_mut(cell.bin) {
                *votes += 1;
            }
        }
        let mut planes = Vec::new();
        for _ in 0..MOST_PEAKS {
            let Some((plane, members)) = self.peak() else { break };
            if self.is_large(&members, large) {
                planes.push(plane);
                if planes.len() == MOST_PLANES {
                    break;
                }
            }
            self.retire(&members);
        }
        for cell in &self.cells {
            if let Some(votes) = self.votes.get_mut(cell.bin) {
                *votes = 0;
            }
        }
        planes
    }

    fn sort(&mut self, places: impl Iterator<Item = [f32; 3]>, edge: f32) {
        self.voxels.reset(edge);
        self.moments.clear();
        for place in places {
            let number = self.voxels.number(self.voxels.key(place)) as usize;
            if number == self.moments.len() {
                self.moments.push(Moments { from: place, count: 0.0, sum: Vector3::zeros(), squares: [0.0; 6] });
            }
            if let Some(moments) = self.moments.get_mut(number) {
                moments.add(place);
            }
        }
    }

    /// The plane of the bin with the most votes (of equals the first), and its cells.
    fn peak(&self) -> Option<(Plane, Vec<usize>)> {
        let mut best: Option<(u32, usize)> = None;
        for cell in self.cells.iter().filter(|cell| cell.votes) {
            let votes = self.votes.get(cell.bin).copied().unwrap_or_default();
            let better = best.is_none_or(|(most, bin)| votes > most || (votes == most && cell.bin < bin));
            if better {
                best = Some((votes, cell.bin));
            }
        }
        let (_, bin) = best?;
        let mut members: Vec<usize> = self.numbers(|cell| cell.votes && cell.bin == bin);
        let mut plane = self.fit(&members)?;
        // A peak is one bin of several that a plane's cells fall into: the plane gathers the others.
        for _ in 0..3 {
            let near = |cell: &Cell| {
                (plane.normal.dot(&cell.mean) - plane.offset).abs() < OFF_M
                    && plane.normal.dot(&cell.normal).abs() > AGREES
            };
            let gathered = self.numbers(|cell| cell.votes && near(cell));
            let Some(better) = self.fit(&gathered) else { break };
            (plane, members) = (better, gathered);
        }
        Some((plane, members))
    }

    fn numbers(&self, is_one: impl Fn(&Cell) -> bool) -> Vec<usize> {
        self.cells.iter().enumerate().filter(|(_, cell)| is_one(cell)).map(|(number, _)| number).collect()
    }

    fn members<'a>(&'a self, numbers: &'a [usize]) -> impl Iterator<Item = &'a Cell> + Clone {
        numbers.iter().filter_map(|number| self.cells.get(*number))
    }

    /// Through the cells' means, every cell alike: a plane is an area, and near ones have more points to the area.
    /// A few cells give the mean of their normals.
    fn fit(&self, members: &[usize]) -> Option<Plane> {
        let count = members.len() as f64;
        let mean = self.members(members).map(|cell| cell.mean).sum::<Vector3<f64>>() / count;
        let first = self.members(members).next()?.normal;
        let normal = if members.len() < LEAST_CELLS {
            self.members(members).map(|cell| cell.normal * first.dot(&cell.normal).signum()).sum::<Vector3<f64>>()
        } else {
            let spread = self.members(members).map(|cell| cell.mean - mean);
            let covariance = spread.fold(Matrix3::zeros(), |sum, off| sum + off * off.transpose());
            let eigen = covariance.symmetric_eigen();
            let least = eigen.eigenvalues.imin();
            eigen.eigenvectors.column(least).into_owned()
        };
        let normal = normal.try_normalize(1e-12)?;
        let offset = normal.dot(&mean);
        let square = |cell: &Cell| {
            let off = normal.dot(&cell.mean) - offset;
            off * off + cell.variance
        };
        let thickness = libm::sqrt(self.members(members).map(square).sum::<f64>() / count);
        let (sigmas, least, most) = BAND;
        Some(Plane { normal, offset, band: (sigmas * thickness).clamp(least, most) })
    }

    fn is_large(&self, members: &[usize], large: Large) -> bool {
        // From corner to corner of the box about them; 0: there are none.
        let span = |cells: &mut dyn Iterator<Item = &Cell>| {
            let Some(first) = cells.next() else { return 0.0 };
            let (low, high) =
                cells.fold((first.mean, first.mean), |(low, high), cell| (low.inf(&cell.mean), high.sup(&cell.mean)));
            (high - low).norm()
        };
        if members.len() < LEAST_CELLS {
            return false;
        }
        match large {
            Large::LongerThan(most) => span(&mut self.members(members)) > most,
            Large::CutsThrough(sphere) => {
                let rim = sphere.radius_m - 1.5 * f64::from(self.voxels.edge());
                let is_rim = |cell: &&Cell| (cell.mean - sphere.center.coords).norm() > rim;
                span(&mut self.members(members).filter(is_rim)) >= sphere.radius_m
            }
        }
    }

    /// Takes cells' votes away.
    fn retire(&mut self, members: &[usize]) {
        for number in members {
            let Some(cell) = self.cells.get_mut(*number) else { continue };
            cell.votes = false;
            if let Some(votes) = self.votes.get_mut(cell.bin) {
                *votes = votes.saturating_sub(1);
            }
        }
    }
}

impl Moments {
    fn add(&mut self, place: [f32; 3]) {
        let [fx, fy, fz] = self.from;
        let [x, y, z] = place;
        let (x, y, z) = (f64::from(x - fx), f64::from(y - fy), f64::from(z - fz));
        self.count += 1.0;
        self.sum += Vector3::new(x, y, z);
        for (sum, square) in self.squares.iter_mut().zip([x * x, x * y, x * z, y * y, y * z, z * z]) {
            *sum += square;
        }
    }

    /// `None`: not flat, or a line. The normal is from the adjugate of the covariance, λ₁λ₂ nnᵀ and little else where
    /// λ₃ is small: no eigenvectors have to be iterated for.
    fn cell(&self, center: &Vector3<f64>) -> Option<Cell> {
        if self.count < LEAST_POINTS {
            return None;
        }
        let mean = self.sum / self.count;
        let [xx, xy, xz, yy, yz, zz] = self.squares.map(|square| square / self.count);
        let (xx, yy, zz) = (xx - mean.x * mean.x, yy - mean.y * mean.y, zz - mean.z * mean.z);
        let (xy, xz, yz) = (xy - mean.x * mean.y, xz - mean.x * mean.z, yz - mean.y * mean.z);
        let columns = [
            Vector3::new(yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy),
            Vector3::new(xz * yz - xy * zz, xx * zz - xz * xz, xy * xz - xx * yz),
            Vector3::new(xy * yz - xz * yy, xy * xz - xx * yz, xx * yy - xy * xy),
        ];
        let [first, second, third] = columns;
        let (trace, width) = (xx + yy + zz, first.x + second.y + third.z);
        if width < LEAST_WIDTH * trace * trace {
            return None;
        }
        let variance = ((xx * first.x + xy * first.y + xz * first.z) / width).max(0.0);
        if variance > FLAT_M * FLAT_M {
            return None;
        }
        let longest = if first.x >= second.y && first.x >= third.z {
            first
        } else if second.y >= third.z {
            second
        } else {
            third
        };
        let normal = longest.try_normalize(0.0)?;
        let mean = mean + Vector3::from(self.from.map(f64::from));
        Some(Cell { mean, normal, variance, bin: bin(&normal, normal.dot(&(mean - center))), votes: true })
    }
}

/// Where a plane is counted: the side of a cube through which its normal leaves, the place there, the offset.
fn bin(normal: &Vector3<f64>, offset: f64) -> usize {
    let axis = normal.iamax();
    let (along, u, v) = match axis {
        0 => (normal.x, normal.y, normal.z),
        1 => (normal.y, normal.z, normal.x),
        _ => (normal.z, normal.x, normal.y),
    };
    // n and −n are one plane: the side with the positive axis stands for both.
    let place = |c: f64| (((c / along + 1.0) * 0.5 * SIDE as f64) as usize).min(SIDE - 1);
    let step = ((offset * along.signum() / STEP_M + 0.5 * STEPS as f64) as usize).min(STEPS - 1);
    ((axis * SIDE + place(u)) * SIDE + place(v)) * STEPS + step
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Point3;

    fn sphere() -> Sphere {
        Sphere { center: Point3::new(2.5, 0.0, 0.0), radius_m: 1.0 }
    }

    /// Points on a plane through `at`, spanned by two vectors, `n` to a side, with ± 4 mm of a ripple along the normal.
    fn patch(at: [f64; 3], along: [f64; 3], across: [f64; 3], n: usize) -> Vec<[f32; 3]> {
        let (at, along, across) = (Vector3::from(at), Vector3::from(along), Vector3::from(across));
        let normal = along.cross(&across).normalize();
        let share = |k: usize| 2.0 * k as f64 / (n - 1) as f64 - 1.0;
        let ripple = |k: usize| 0.004 * ((k * 37 % 11) as f64 / 5.0 - 1.0);
        (0..n * n)
            .map(|k| at + along * share(k / n) + across * share(k % n) + normal * ripple(k))
            .map(|place| [place.x as f32, place.y as f32, place.z as f32])
            .collect()
    }

    fn inside(cloud: Vec<[f32; 3]>) -> Vec<[f32; 3]> {
        cloud.into_iter().filter(|place| sphere().holds(*place)).collect()
    }

    #[test]
    fn a_floor_that_cuts_through_the_region_is_found_and_the_targets_panel_is_not() {
        // The floor 0.5 m below the centre, tilted by 5°; a panel of 1.2 × 0.6 m in the middle, 45° up.
        let slope = 0.0875;
        let mut cloud = inside(patch([2.5, 0.0, -0.5], [1.5, 0.0, slope * 1.5], [0.0, 1.5, 0.0], 100));
        let floor = cloud.len();
        cloud.extend(patch([2.5, 0.0, 0.0], [0.0, 0.6, 0.0], [0.21, 0.0, 0.21], 60));
        let planes = PlaneFinder::new().find(cloud.iter().copied(), 0.05, Large::CutsThrough(sphere()));
        let [plane] = planes.as_slice() else { panic!("{planes:?}") };
        // Normal (−sin 5°, 0, cos 5°) or its opposite, to a tenth of a degree.
        let expected = Vector3::new(-slope, 0.0, 1.0).normalize();
        assert!(plane.normal.dot(&expected).abs() > 0.999_998, "{plane:?}");
        let held = |range: &[[f32; 3]]| range.iter().filter(|place| plane.holds(**place)).count();
        assert_eq!((held(&cloud[..floor]), held(&cloud[floor..])), (floor, 0));
    }

    #[test]
    fn a_stage_smaller_than_the_region_stays() {
        let cloud = patch([2.5, 0.0, -0.5], [0.4, 0.0, 0.0], [0.0, 0.4, 0.0], 80);
        assert_eq!(PlaneFinder::new().find(cloud.into_iter(), 0.05, Large::CutsThrough(sphere())), []);
    }

    #[test]
    fn without_a_region_a_plane_is_large_when_no_target_is_as_long() {
        let wall = |half: f64| patch([4.0, 0.0, 0.0], [0.0, half, 0.0], [0.0, 0.0, 1.0], 120);
        // 2 m high: diagonals of 4.5 m, and of 2.8 m.
        let find = |half| PlaneFinder::new().find(wall(half).into_iter(), 0.05, Large::LongerThan(3.0)).len();
        assert_eq!((find(2.0), find(1.0)), (1, 0));
    }

    #[test]
    fn a_finder_finds_the_same_again() {
        let cloud = || inside(patch([2.5, 0.2, 0.0], [1.5, 0.0, 0.3], [0.0, 0.2, 1.5], 100)).into_iter();
        let mut finder = PlaneFinder::new();
        let first = finder.find(cloud(), 0.05, Large::CutsThrough(sphere()));
        assert_eq!(first.len(), 1);
        assert_eq!(finder.find(cloud(), 0.05, Large::CutsThrough(sphere())), first);
    }

    #[test]
    fn one_beam_sees_no_plane() {
        let line = (0..400).map(|n| [2.5, -1.0 + n as f32 * 0.005, 0.0]);
        assert_eq!(PlaneFinder::new().find(line, 0.05, Large::CutsThrough(sphere())), []);
    }
}

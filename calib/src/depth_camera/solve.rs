//! The camera's unknowns and every board's plane and rectangle together, by Gauss–Newton.
//!
//! ```text
//!   patch:  depth(z) − d / (n·ρ)            along the ray ρ of its pixel
//!   edge:   where the ray of its pixel meets the plane, off the rectangle's side, in pixels
//!   LiDAR:  its points off the same plane
//! ```
//! A board's six own unknowns (two tilts, distance; two shifts and a turn of the rectangle in the plane) are eliminated board by
//! board.

use nalgebra::{DMatrix, DVector, Isometry3, Matrix6, Point3, SMatrix, SVector, Vector3, Vector6};

use super::samples::{Edge, Patch, Shown};
use super::state::{Camera, EDGE, LENS, Model, SCALE, SURFACE, State, UNKNOWNS, prior};
use crate::board::{lidar_parameters, lidar_rows};
use crate::fit::Unsolved;
use crate::plane::Plane;
use crate::robust::{huber, scale};

/// Gauss–Newton steps at most.
const STEPS: usize = 15;
/// A step below this share of the unknowns' deviations is none.
const STILL: f64 = 1e-5;
/// Steps by which rays are differentiated: px, and of distortion.
const DIFFERENCE: (f64, f64) = (1e-3, 1e-6);
/// How far a rectangle may be from where the camera first saw it, one standard deviation: m, rad.
const RECTANGLE: (f64, f64) = (0.1, 0.1);
/// Boards at least.
pub(super) const LEAST_BOARDS: usize = 4;

/// A row of a board's own unknowns.
type Own = Vector6<f64>;
/// A row of all unknowns.
type Row = SVector<f64, UNKNOWNS>;

/// What all unknowns have to do with each other, and with a board's own.
type Square = SMatrix<f64, UNKNOWNS, UNKNOWNS>;
type Cross = SMatrix<f64, UNKNOWNS, 6>;

/// The noise of patches and edges, in units of what is expected of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Noise {
    pub(super) patch: f64,
    pub(super) edge: f64,
}

/// A board's own values.
#[derive(Clone, Copy, Debug)]
struct Place {
    plane: Plane,
    /// The rectangle's shift along both axes and its turn in the plane.
    shift: [f64; 2],
    turn: f64,
}

/// What was solved for.
#[derive(Clone, Debug)]
pub(super) struct Solved {
    pub(super) state: State,
    pub(super) model: Model,
    /// One standard deviation of each unknown; `None`: not solved for.
    pub(super) sigma: [Option<f64>; UNKNOWNS],
    /// Of rotation and translation of the camera, in the LiDAR's frame, and of the scale.
    pub(super) covariance: crate::fit::Covariance,
    /// The sum of the residuals' squares, robust, with the noise given.
    pub(super) cost: f64,
    pub(super) noise: Noise,
    planes: Vec<Plane>,
}

/// Solves a model for some boards. `noise`: that of another solution, to compare with it; `None`: what the residuals tell.
pub(super) fn solve(
    boards: &[&Shown],
    camera: &dyn Camera,
    model: Model,
    start: &Isometry3<f64>,
    noise: Option<Noise>,
) -> Result<Solved, Unsolved> {
    if boards.len() < LEAST_BOARDS {
        return Err(Unsolved::TooFew { found: boards.len(), least: LEAST_BOARDS });
    }
    let mut state = State::new(*start, camera.lens(), model.power);
    let place = |board: &&Shown| Place { plane: board.plane, shift: [0.0; 2], turn: 0.0 };
    let mut places: Vec<Place> = boards.iter().map(place).collect();
    let active = model.active();
    let mut told = noise.unwrap_or(Noise { patch: 1.0, edge: 1.0 });
    for _ in 0..STEPS {
        if noise.is_none() {
            told = noise_of(boards, &places, &state, camera);
        }
        let normal = Normal::of(boards, &places, &state, camera, told, &active, model.power);
        let step = normal.step()?;
        let small = step.iter().enumerate().all(|(n, change)| change.abs() < STILL * prior(n, model.power));
        state.advance(&step.into());
        for ((place, board), own) in places.iter_mut().zip(boards).zip(normal.own_steps(&step)) {
            advance(place, board, &own);
        }
        if small {
            break;
        }
    }
    let normal = Normal::of(boards, &places, &state, camera, told, &active, model.power);
    let covariance = normal.covariance()?;
    let mut sigma = [None; UNKNOWNS];
    for (place, unknown) in active.iter().enumerate() {
        let variance = covariance.get((place, place)).copied().unwrap_or_default();
        if let Some(sigma) = sigma.get_mut(*unknown) {
            *sigma = Some(variance.max(0.0).sqrt());
        }
    }
    // The first seven are active in every model, and in this order.
    let seven = covariance.fixed_view::<7, 7>(0, 0).into_owned();
    let planes = places.iter().map(|place| place.plane).collect();
    Ok(Solved { state, model, sigma, covariance: seven, cost: normal.cost, noise: told, planes })
}

impl Solved {
    /// The Bayesian information criterion (Schwarz 1978): the less, the better the model is borne by so many samples.
    pub(super) fn criterion(&self, samples: usize) -> f64 {
        self.cost + self.model.active().len() as f64 * libm::log(samples.max(1) as f64)
    }

    /// How far a board's patches are beyond its plane as both sensors have it, by their noise, root mean square.
    pub(super) fn misfit(&self, place: usize, board: &Shown, camera: &dyn Camera) -> f64 {
        let Some(plane) = self.planes.get(place) else { return 0.0 };
        let squares = board.patches.iter().filter_map(|patch| {
            let residual = patch_residual(patch, plane, &self.state, camera)? / (patch.sigma * self.noise.patch);
            Some(residual * residual)
        });
        (squares.sum::<f64>() / board.patches.len().max(1) as f64).sqrt()
    }
}

/// How many samples boards have.
pub(super) fn samples_of(boards: &[&Shown]) -> usize {
    boards.iter().map(|board| board.patches.len() + board.edges.len() + 3).sum()
}

fn advance(place: &mut Place, _: &Shown, own: &Own) {
    let [a, b] = place.plane.across();
    place.plane.normal = (place.plane.normal + a * own[0] + b * own[1]).normalize();
    place.plane.distance_m += own[2];
    place.shift = [place.shift[0] + own[3], place.shift[1] + own[4]];
    place.turn += own[5];
}

fn noise_of(boards: &[&Shown], places: &[Place], state: &State, camera: &dyn Camera) -> Noise {
    let both = || boards.iter().zip(places);
    let mut patches: Vec<f64> = both()
        .flat_map(|(board, place)| board.patches.iter().map(move |patch| (patch, place)))
        .filter_map(|(patch, place)| Some(patch_residual(patch, &place.plane, state, camera)? / patch.sigma))
        .collect();
    let mut edges: Vec<f64> = both()
        .flat_map(|(board, place)| board.edges.iter().map(move |edge| (board, edge, place)))
        .filter_map(|(board, edge, place)| edge_residual(board, edge, place, state, camera))
        .collect();
    // Neighbouring places on an edge share what strays: never believed better than a third of a pixel.
    Noise { patch: scale(&mut patches), edge: scale(&mut edges).max(0.33) }
}

/// How far a patch is beyond the plane along its ray, m of depth.
pub(super) fn patch_residual(patch: &Patch, plane: &Plane, state: &State, camera: &dyn Camera) -> Option<f64> {
    let [x, y] = camera.ray(&state.lens, patch.pixel[0], patch.pixel[1])?;
    let met = plane.distance_m / plane.normal.dot(&Vector3::new(x, y, 1.0));
    (met.is_finite() && met > 0.0).then(|| state.depth(patch.z, &patch.terms) - met)
}

/// How far an edge's place is beyond its side, px along its scan.
fn edge_residual(board: &Shown, edge: &Edge, place: &Place, state: &State, camera: &dyn Camera) -> Option<f64> {
    let beyond = |more_px: f64| {
        let [along_row, along_column] = state.edge_px;
        let more = more_px + if edge.out[0] == 0.0 { along_column } else { along_row };
        let ray = camera.ray(&state.lens, edge.pixel[0] + more * edge.out[0], edge.pixel[1] + more * edge.out[1])?;
        let ray = Vector3::new(ray[0], ray[1], 1.0);
        let met = Point3::from(ray * (place.plane.distance_m / place.plane.normal.dot(&ray)));
        // The axes as they lie in the plane by now.
        let [long, _] = board.axes;
        let n = place.plane.normal;
        let long = (long - n * n.dot(&long)).normalize();
        let [_, short] = board.axes;
        let short = n.cross(&long) * n.cross(&long).dot(&short).signum();
        let middle = board.middle - n * place.plane.beyond_m(&board.middle);
        let way = met - middle;
        let (a, b) = (long.dot(&way) - place.shift[0], short.dot(&way) - place.shift[1]);
        let (sin, cos) = libm::sincos(place.turn);
        let along = [a * cos + b * sin, b * cos - a * sin];
        let (axis, sign) = edge.side;
        Some(sign * along.get(axis)? - board.half.get(axis)?)
    };
    let here = beyond(0.0)?;
    let slope = beyond(1.0)? - here;
    // A side seen along its own line tells nothing.
    (slope > 1e-4).then(|| (here / slope).clamp(-20.0, 20.0))
}

/// The normal equations: of the unknowns solved for, the boards' own eliminated.
struct Normal {
    active: Vec<usize>,
    information: Box<Square>,
    gradient: Row,
    /// By board: the inverse of its own information, its own gradient, and the cross terms.
    own: Vec<(Matrix6<f64>, Own, Cross)>,
    cost: f64,
}

impl Normal {
    fn of(
        boards: &[&Shown],
        places: &[Place],
        state: &State,
        camera: &dyn Camera,
        noise: Noise,
        active: &[usize],
        power: u8,
    ) -> Self {
        let mut normal = Self {
            active: active.to_vec(),
            information: Box::new(Square::zeros()),
            gradient: Row::zeros(),
            own: Vec::new(),
            cost: 0.0,
        };
        for unknown in active {
            let weight = 1.0 / (prior(*unknown, power) * prior(*unknown, power));
            let moved = state.moved(*unknown);
            if let (Some(information), Some(gradient)) =
                (normal.information.get_mut((*unknown, *unknown)), normal.gradient.get_mut(*unknown))
            {
                *information += weight;
                *gradient += weight * moved;
            }
            normal.cost += weight * moved * moved;
        }
        for (board, place) in boards.iter().zip(places) {
            normal.add(board, place, state, camera, noise);
        }
        normal
    }

    fn add(&mut self, board: &Shown, place: &Place, state: &State, camera: &dyn Camera, noise: Noise) {
        let mut sums = Sums { own: Matrix6::zeros(), toward: Own::zeros(), cross: Cross::zeros() };
        for patch in &board.patches {
            if let Some((residual, row, own)) = patch_row(patch, &place.plane, state, camera) {
                self.row(&mut sums, residual, &row, &own, patch.sigma * noise.patch);
            }
        }
        for edge in &board.edges {
            if let Some((residual, row, own)) = edge_row(board, edge, place, state, camera) {
                self.row(&mut sums, residual, &row, &own, noise.edge);
            }
        }
        self.lidar(&mut sums, board, place, state);
        let (shift, turn) = (1.0 / (RECTANGLE.0 * RECTANGLE.0), 1.0 / (RECTANGLE.1 * RECTANGLE.1));
        for (n, weight, value) in [(3, shift, place.shift[0]), (4, shift, place.shift[1]), (5, turn, place.turn)] {
            if let (Some(own), Some(toward)) = (sums.own.get_mut((n, n)), sums.toward.get_mut(n)) {
                *own += weight;
                *toward += weight * value;
            }
        }
        // A plane that no point holds stays where it is.
        let inverse = sums.own.try_inverse().unwrap_or_else(Matrix6::zeros);
        *self.information -= sums.cross * inverse * sums.cross.transpose();
        self.gradient -= sums.cross * (inverse * sums.toward);
        self.own.push((inverse, sums.toward, sums.cross));
    }

    /// Adds a residual with what it depends on.
    fn row(&mut self, sums: &mut Sums, residual: f64, row: &Row, own: &Own, sigma: f64) {
        let in_sigma = residual / sigma;
        let weight = huber(in_sigma);
        self.cost += weight * in_sigma * in_sigma * if weight < 1.0 { 2.0 - weight } else { 1.0 };
        let weight = weight / (sigma * sigma);
        self.information.ger(weight, row, row, 1.0);
        self.gradient.axpy(weight * residual, row, 1.0);
        sums.own += own * own.transpose() * weight;
        sums.toward += own * (weight * residual);
        sums.cross.ger(weight, row, own, 1.0);
    }

    /// The LiDAR's points of a board: its distances depend on place and plane alone.
    fn lidar(&mut self, sums: &mut Sums, board: &Shown, place: &Place, state: &State) {
        let (q, plane) = lidar_rows(&place.plane, &state.t_lidar_camera);
        let rows = lidar_parameters(&place.plane, &state.t_lidar_camera);
        let moments = &board.lidar.matrix;
        let of = rows.transpose() * moments;
        self.cost += q.dot(&(moments * q));
        let (information, gradient) = (of * rows, of * q);
        // Rotation and translation are the first six of every model.
        for a in 0..6 {
            if let (Some(to), Some(from)) = (self.gradient.get_mut(a), gradient.get(a)) {
                *to += from;
            }
            for b in 0..6 {
                if let (Some(to), Some(from)) = (self.information.get_mut((a, b)), information.get((a, b))) {
                    *to += from;
                }
            }
        }
        let mut cross = sums.cross.view_mut((0, 0), (6, 3));
        cross += (of * plane).fixed_view::<6, 3>(0, 0);
        let mut own = sums.own.fixed_view_mut::<3, 3>(0, 0);
        own += plane.transpose() * moments * plane;
        let mut toward = sums.toward.fixed_rows_mut::<3>(0);
        toward += plane.transpose() * moments * q;
    }

    /// Of the unknowns solved for, in their order.
    fn covariance(&self) -> Result<DMatrix<f64>, Unsolved> {
        let count = self.active.len();
        let at = |n: usize| self.active.get(n).copied().unwrap_or_default();
        let part = |a: usize, b: usize| self.information.get((at(a), at(b))).copied().unwrap_or_default();
        let information = DMatrix::from_fn(count, count, part);
        let roots = information.diagonal().map(|value| value.max(0.0).sqrt());
        if roots.iter().any(|root| !root.is_finite() || *root <= 0.0) {
            return Err(Unsolved::Degenerate);
        }
        let scale = DMatrix::from_diagonal(&roots.map(|root| 1.0 / root));
        let scaled = &scale * information * &scale;
        let inverse = scaled.cholesky().ok_or(Unsolved::Degenerate)?.inverse();
        Ok(&scale * inverse * &scale)
    }

    fn step(&self) -> Result<Row, Unsolved> {
        let gradient = self.active.iter().map(|n| self.gradient.get(*n).copied().unwrap_or_default());
        let step = -(self.covariance()? * DVector::from_iterator(self.active.len(), gradient));
        let mut all = Row::zeros();
        for (value, unknown) in step.iter().zip(&self.active) {
            if !value.is_finite() {
                return Err(Unsolved::Degenerate);
            }
            if let Some(entry) = all.get_mut(*unknown) {
                *entry = *value;
            }
        }
        Ok(all)
    }

    /// The boards' own steps that belong to a step of the unknowns.
    fn own_steps<'a>(&'a self, step: &'a Row) -> impl Iterator<Item = Own> + 'a {
        self.own.iter().map(move |(inverse, toward, cross)| -(inverse * (toward + cross.transpose() * step)))
    }
}

/// A board's own part of the normal equations.
struct Sums {
    own: Matrix6<f64>,
    toward: Own,
    cross: Cross,
}

fn set<const N: usize>(row: &mut SVector<f64, N>, place: usize, value: f64) {
    if let Some(entry) = row.get_mut(place) {
        *entry = value;
    }
}

/// A patch's residual and what it depends on.
fn patch_row(patch: &Patch, plane: &Plane, state: &State, camera: &dyn Camera) -> Option<(f64, Row, Own)> {
    let residual = patch_residual(patch, plane, state, camera)?;
    let [u, v] = patch.pixel;
    let ray = camera.ray(&state.lens, u, v)?;
    let [a, b] = plane.across();
    let rho = Vector3::new(ray[0], ray[1], 1.0);
    let cosine = plane.normal.dot(&rho);
    let met = plane.distance_m / cosine;
    let mut row = Row::zeros();
    set(&mut row, SCALE, state.by_scale(patch.z, &patch.terms));
    let size = state.size(state.depth_scale * patch.z);
    for (n, term) in patch.terms.iter().enumerate() {
        set(&mut row, SURFACE + n, term * size);
    }
    for n in 0..6 {
        let small = if n < 4 { DIFFERENCE.0 } else { DIFFERENCE.1 };
        let moved = camera.ray(&state.lens_with(n, small), u, v)?;
        let change = Vector3::new(moved[0] - ray[0], moved[1] - ray[1], 0.0) / small;
        set(&mut row, LENS + n, met / cosine * plane.normal.dot(&change));
    }
    let tilt = met / cosine;
    let own = Own::from([tilt * a.dot(&rho), tilt * b.dot(&rho), -1.0 / cosine, 0.0, 0.0, 0.0]);
    Some((residual, row, own))
}

/// The same of an edge, differentiated by small steps.
fn edge_row(board: &Shown, edge: &Edge, place: &Place, state: &State, camera: &dyn Camera) -> Option<(f64, Row, Own)> {
    let residual = edge_residual(board, edge, place, state, camera)?;
    let mut row = Row::zeros();
    for n in 0..6 {
        let small = if n < 4 { DIFFERENCE.0 } else { DIFFERENCE.1 };
        let moved = State { lens: state.lens_with(n, small), from: None, ..state.clone() };
        set(&mut row, LENS + n, (edge_residual(board, edge, place, &moved, camera)? - residual) / small);
    }
    set(&mut row, if edge.out[0] == 0.0 { EDGE + 1 } else { EDGE }, 1.0);
    let mut own = Own::zeros();
    for n in 0..6 {
        let (mut moved, small) = (*place, 1e-6);
        let mut step = Own::zeros();
        set(&mut step, n, small);
        advance(&mut moved, board, &step);
        set(&mut own, n, (edge_residual(board, edge, &moved, state, camera)? - residual) / small);
    }
    Some((residual, row, own))
}

//! Generalised least squares: planes, the scale of the vertical offsets, a common range bias.
//!
//! The distance of cell i from its plane is
//!
//! ```text
//!   e_i = p_i·n − d + s·height_i·n_z + b·(beam_i·n) + c·(lift_i·n)
//!         − (α·u_i + β·v_i + γ [+ quadratic terms in u_i, v_i])
//! ```
//!
//! with s the scale of the offsets (0 off, 1 on), b a range bias and c an elevation error of all lasers, and the bracket
//! what the rough plane (n, d) still lacks. Beside the cell's own noise, each ring has errors of its own that a whole
//! ring shares: range, elevation, and one per surface. They are part of the covariance: 40 cells of one ring are not
//! 40 independent witnesses.

use crate::cells::{Cell, Plane};
use nalgebra::{DMatrix, DVector, Vector3};
use std::collections::{BTreeMap, BTreeSet};

/// Range error of one laser, metres: an assumption, well inside the ±3 cm usually quoted for the Pucks.
const RING_RANGE_M: f64 = 0.012;
/// Elevation error of one laser, radians: 0.06°, an assumption.
const RING_ELEVATION_RAD: f64 = 0.06 * core::f64::consts::PI / 180.0;
/// What else the cells of a ring share on one surface, metres: an assumption.
const RING_SURFACE_M: f64 = 0.001;
/// A floor or wall is taken to be wavy by this much, metres …
const WAVE_M: f64 = 0.003;
/// … over this length, metres. Waviness widens the standard deviations; it does not weigh the cells.
const WAVE_LENGTH_M: f64 = 0.8;
/// A surface whose normal is this near the vertical is a floor.
const FLOOR_NORMAL_Z: f64 = 0.9;

/// What a fit assumes of one parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Assumed {
    /// It has this value.
    Known(f64),
    /// It is zero give or take this standard deviation.
    Within(f64),
    /// It is fitted.
    Free,
}

/// What a fit assumes. Metres and radians.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Assumptions {
    /// Scale of the vertical offsets: 0 off, 1 on.
    pub(crate) scale: Assumed,
    /// Range bias of all lasers.
    pub(crate) bias: Assumed,
    /// Elevation error of all lasers; never fitted.
    pub(crate) elevation_sigma_rad: f64,
}

/// A fitted value with its standard deviation, waviness of the surface included.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Estimate {
    pub(crate) value: f64,
    pub(crate) sigma: f64,
}

/// What a fit found.
#[derive(Clone, Debug)]
pub(crate) struct Solution {
    pub(crate) bias: Option<Estimate>,
    pub(crate) scale: Option<Estimate>,
    /// Correlation of bias and scale where both are fitted.
    pub(crate) correlation: Option<f64>,
    /// Distances of the cells from the surfaces along the normal, metres.
    pub(crate) residual_m: Vec<f64>,
    /// Their weighted sum of squares.
    pub(crate) chi2: f64,
    /// Akaike's information criterion; less is better, differences count.
    pub(crate) aic: f64,
}

/// Why there is no solution.
#[derive(Clone, Copy, Debug, thiserror::Error)]
pub(crate) enum GlsError {
    #[error("the covariance of {cells} cells is not positive definite")]
    Covariance { cells: usize },
    #[error("{cells} cells do not determine {parameters} parameters")]
    Undetermined { cells: usize, parameters: usize },
}

/// One cell's equation.
#[derive(Clone, Debug)]
struct Row {
    ring: u8,
    surface: usize,
    /// Distance from the rough plane with the offset off, metres.
    distance_m: f64,
    /// Change of the distance with range bias, offset scale and elevation error.
    per_bias: f64,
    per_scale: f64,
    per_elevation: f64,
    sigma_m: f64,
    /// Place on the surface, metres.
    u: f64,
    v: f64,
}

/// The equations of all cells of some surfaces.
#[derive(Clone, Debug)]
pub(crate) struct Problem {
    rows: Vec<Row>,
    surfaces: usize,
    curved: bool,
}

impl Problem {
    /// The equations of flat surfaces, or of surfaces with a quadratic term when `curved`.
    pub(crate) fn new(planes: &[Plane], curved: bool) -> Self {
        let rows = planes.iter().enumerate().flat_map(|(surface, plane)| rows(surface, plane)).collect();
        Self { rows, surfaces: planes.len(), curved }
    }

    /// Number of cells.
    pub(crate) fn cells(&self) -> usize {
        self.rows.len()
    }

    /// Ring of each cell, in the order of [`Solution::residual_m`].
    pub(crate) fn ring_of_cell(&self) -> impl Iterator<Item = u8> + '_ {
        self.rows.iter().map(|row| row.ring)
    }

    /// The rings that have cells.
    pub(crate) fn rings(&self) -> BTreeSet<u8> {
        self.ring_of_cell().collect()
    }

    /// The same without one ring.
    pub(crate) fn without_ring(&self, ring: u8) -> Self {
        let rows = self.rows.iter().filter(|row| row.ring != ring).cloned().collect();
        Self { rows, ..*self }
    }

    /// Fits the surfaces and what is free.
    pub(crate) fn solve(&self, assumed: Assumptions) -> Result<Solution, GlsError> {
        let cells = self.rows.len();
        let known_scale = if let Assumed::Known(scale) = assumed.scale { scale } else { 0.0 };
        let known_bias = if let Assumed::Known(bias) = assumed.bias { bias } else { 0.0 };
        let distances = self.rows.iter().map(|r| r.distance_m + known_scale * r.per_scale + known_bias * r.per_bias);
        let distance = DVector::from_iterator(cells, distances);
        let design = self.design(assumed);
        let parameters = design.ncols();
        if cells <= parameters {
            return Err(GlsError::Undetermined { cells, parameters });
        }

        // With V = L·Lᵀ, L⁻¹ makes all cells independent and of unit variance.
        let cholesky = self.covariance(assumed).cholesky().ok_or(GlsError::Covariance { cells })?;
        let l = cholesky.l();
        let whiten = |m: &DMatrix<f64>| l.solve_lower_triangular(m).ok_or(GlsError::Covariance { cells });
        let white_distance = l.solve_lower_triangular(&distance).ok_or(GlsError::Covariance { cells })?;
        let qr = whiten(&design)?.qr();
        let (q, r) = (qr.q(), qr.r());
        let undetermined = GlsError::Undetermined { cells, parameters };
        let fitted = -r.solve_upper_triangular(&(q.transpose() * &white_distance)).ok_or(undetermined)?;
        let residual = &distance + &design * &fitted;
        let white_residual = &white_distance + &q * (&r * &fitted);

        // The estimate is −W·distance with W = R⁻¹Qᵀ L⁻¹, so waviness G adds W·G·Wᵀ to the covariance (RᵀR)⁻¹.
        let r_inverse = r.solve_upper_triangular(&DMatrix::identity(parameters, parameters)).ok_or(undetermined)?;
        let formal = &r_inverse * r_inverse.transpose();
        let l_q = l.tr_solve_lower_triangular(&q).ok_or(GlsError::Covariance { cells })?;
        let w = &r_inverse * l_q.transpose();
        let covariance = &formal + &w * self.waviness() * w.transpose();

        let chi2 = white_residual.norm_squared();
        let log_det: f64 = l.diagonal().iter().map(|pivot| 2.0 * libm::log(*pivot)).sum();
        let constant = cells as f64 * libm::log(core::f64::consts::TAU);
        let estimate = |at: usize| Estimate { value: fitted[at], sigma: covariance[(at, at)].sqrt() };
        let first = self.terms() * self.surfaces;
        let bias_at = (assumed.bias == Assumed::Free).then_some(first);
        let scale_at = (assumed.scale == Assumed::Free).then_some(first + usize::from(bias_at.is_some()));
        Ok(Solution {
            bias: bias_at.map(estimate),
            scale: scale_at.map(estimate),
            correlation: bias_at.zip(scale_at).map(|(b, s)| formal[(b, s)] / (formal[(b, b)] * formal[(s, s)]).sqrt()),
            residual_m: residual.iter().copied().collect(),
            chi2,
            aic: chi2 + log_det + constant + 2.0 * parameters as f64,
        })
    }

    /// Parameters of one surface.
    fn terms(&self) -> usize {
        if self.curved { 6 } else { 3 }
    }

    /// Derivatives of the distances: the surfaces' terms, then bias and scale where they are free.
    fn design(&self, assumed: Assumptions) -> DMatrix<f64> {
        let terms = self.terms();
        let mut design = DMatrix::zeros(self.rows.len(), terms * self.surfaces);
        for (at, row) in self.rows.iter().enumerate() {
            let Row { u, v, .. } = *row;
            let derivatives = [u, v, -1.0, u * u, u * v, v * v];
            for (term, derivative) in derivatives.iter().take(terms).enumerate() {
                design[(at, terms * row.surface + term)] = *derivative;
            }
        }
        let free = [(assumed.bias, Row::bias as fn(&Row) -> f64), (assumed.scale, Row::scale)];
        for (_, derivative) in free.into_iter().filter(|(parameter, _)| *parameter == Assumed::Free) {
            let last = design.ncols();
            design = design.insert_column(last, 0.0);
            design.set_column(last, &DVector::from_iterator(self.rows.len(), self.rows.iter().map(derivative)));
        }
        design
    }

    /// Covariance of the distances: cell noise, what rings share, and what is known of all lasers together.
    fn covariance(&self, assumed: Assumptions) -> DMatrix<f64> {
        let bias_sigma = if let Assumed::Within(sigma) = assumed.bias { sigma } else { 0.0 };
        self.pairs(|i, j, same_cell| {
            let (bias, elevation) = (i.per_bias * j.per_bias, i.per_elevation * j.per_elevation);
            let all = square(bias_sigma) * bias + square(assumed.elevation_sigma_rad) * elevation;
            let of_ring = square(RING_RANGE_M) * bias + square(RING_ELEVATION_RAD) * elevation;
            let of_surface = if i.surface == j.surface { square(RING_SURFACE_M) } else { 0.0 };
            let shared = if i.ring == j.ring { of_ring + of_surface } else { 0.0 };
            let own = if same_cell { square(i.sigma_m) } else { 0.0 };
            own + shared + all
        })
    }

    /// Covariance of the surfaces' waviness.
    fn waviness(&self) -> DMatrix<f64> {
        self.pairs(|i, j, _| {
            let apart2 = square(i.u - j.u) + square(i.v - j.v);
            let near = libm::exp(-apart2 / (2.0 * square(WAVE_LENGTH_M)));
            if i.surface == j.surface { square(WAVE_M) * near } else { 0.0 }
        })
    }

    /// A matrix from what any two cells have in common.
    fn pairs(&self, common: impl Fn(&Row, &Row, bool) -> f64) -> DMatrix<f64> {
        let n = self.rows.len();
        DMatrix::from_fn(n, n, |i, j| common(&self.rows[i], &self.rows[j], i == j))
    }
}

impl Row {
    fn bias(&self) -> f64 {
        self.per_bias
    }

    fn scale(&self) -> f64 {
        self.per_scale
    }
}

/// The equations of one surface's cells.
fn rows(surface: usize, plane: &Plane) -> Vec<Row> {
    let normal = &plane.normal;
    let is_floor = normal.z.abs() > FLOOR_NORMAL_Z;
    let along = if is_floor { Vector3::x() - normal * normal.x } else { normal.cross(&Vector3::z()) };
    let u_axis = along.normalize();
    let v_axis = normal.cross(&u_axis);
    let row = |cell: &Cell| Row {
        ring: cell.ring,
        surface,
        distance_m: cell.point.dot(normal) - plane.distance_m,
        per_bias: cell.beam.dot(normal),
        per_scale: cell.height_m * normal.z,
        per_elevation: cell.lift.dot(normal),
        sigma_m: plane.sigma_m,
        u: cell.point.dot(&u_axis),
        v: cell.point.dot(&v_axis),
    };
    let mut rows: Vec<Row> = plane.cells.iter().map(row).collect();
    if is_floor {
        level_rings(&mut rows);
    }
    rows
}

/// On a floor a ring is a circle round the sensor, and an error of the laser is one height all along it. The small
/// differences that the floor's slant makes would let it mimic a tilt: each ring takes its mean.
fn level_rings(rows: &mut [Row]) {
    let mut sums: BTreeMap<u8, (f64, f64, f64)> = BTreeMap::new();
    for row in rows.iter() {
        let sum = sums.entry(row.ring).or_default();
        *sum = (sum.0 + row.per_bias, sum.1 + row.per_elevation, sum.2 + 1.0);
    }
    for row in rows {
        if let Some((bias, elevation, n)) = sums.get(&row.ring) {
            (row.per_bias, row.per_elevation) = (bias / n, elevation / n);
        }
    }
}

fn square(x: f64) -> f64 {
    x * x
}

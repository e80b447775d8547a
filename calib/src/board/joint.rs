//! All boards at once: the camera's place, the depth scale and every board's plane are unknown together.
//!
//! ```text
//!   camera points ── n·(α p) = d ──┐ planes ┌── (R n)·p = d + (R n)·t ── LiDAR points
//! ```
//! A plane fitted from the camera alone would carry the camera's errors into the result as if it were true; as an unknown
//! it is held by both clouds with their own weights. For a plane, points enter only through [`Moments`]: an iteration costs
//! the same for ten points as for ten thousand.

use nalgebra::{Isometry3, Matrix3, Matrix4, SMatrix, SVector, Vector3, Vector4};
use tumbled_model::se3::exp_rotation;

use crate::fit::{Covariance, Fit, PARAMETERS, Unsolved};
use crate::plane::{Moments, Plane};

/// Gauss–Newton steps at most; from a closed form three are enough.
const STEPS: usize = 12;
/// A step below this, rad or m, is none.
const STILL: f64 = 1e-9;
/// The least poses whose planes fix six parameters.
pub const LEAST_POSES: usize = 3;
/// Of the information scaled to a unit diagonal, least eigenvalue to largest below which it is not inverted.
const LEAST_CONDITION: f64 = 1e-9;

/// A board in one pose, as both sensors have it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Board {
    /// Its plane in the camera's frame.
    pub plane: Plane,
    /// The camera's points, weighted by their noise.
    pub camera: Moments,
    /// The LiDAR's, in its own frame.
    pub lidar: Moments,
}

/// A plane's three unknowns: two tilts and the distance; and all that one pose depends on.
pub(crate) type PlaneRows = SMatrix<f64, 4, 3>;
pub(crate) type ParameterRows = SMatrix<f64, 4, PARAMETERS>;
type Cross = SMatrix<f64, PARAMETERS, 3>;

/// The current values.
#[derive(Clone, Debug)]
struct State {
    t: Isometry3<f64>,
    scale: f64,
    planes: Vec<Plane>,
}

/// The normal equations.
struct Normal {
    information: Covariance,
    gradient: SVector<f64, PARAMETERS>,
    /// By pose, to find the planes' steps again.
    planes: Vec<(Matrix3<f64>, Vector3<f64>, Cross)>,
}

/// Solves for boards from a start.
///
/// # Errors
/// [`Unsolved`]: fewer than three boards, or boards that do not fix it.
pub(super) fn solve(boards: &[Board], start: &Isometry3<f64>, with_scale: bool) -> Result<(Fit, Vec<Plane>), Unsolved> {
    if boards.len() < LEAST_POSES {
        return Err(Unsolved::TooFew { found: boards.len(), least: LEAST_POSES });
    }
    let mut state = State { t: *start, scale: 1.0, planes: boards.iter().map(|board| board.plane).collect() };
    for _ in 0..STEPS {
        let normal = equations(boards, &state, with_scale)?;
        let covariance = inverse(&normal.information)?;
        let step = -(covariance * normal.gradient);
        advance(&mut state, &normal, &step, with_scale)?;
        if step.norm() < STILL {
            break;
        }
    }
    let normal = equations(boards, &state, with_scale)?;
    let mut covariance = inverse(&normal.information)?;
    if !with_scale {
        covariance.row_mut(6).fill(0.0);
        covariance.column_mut(6).fill(0.0);
    }
    let squares = boards.iter().zip(&state.planes).map(|(board, plane)| disagreement(board, plane, &state));
    let squares: Vec<f64> = squares.collect::<Option<_>>().ok_or(Unsolved::Degenerate)?;
    let fit = Fit {
        t_lidar_camera: state.t,
        depth_scale: with_scale.then_some(state.scale),
        covariance,
        chi_square: squares.iter().sum(),
        freedom: (3 * boards.len()).saturating_sub(if with_scale { 7 } else { 6 }),
        misfits: squares.iter().map(|square| (square / 3.0).sqrt()).collect(),
    };
    let factor = fit.variance_factor();
    Ok((Fit { covariance: fit.covariance * factor, ..fit }, state.planes))
}

/// `∂q/∂(plane)` and `q` for the camera, `q = (α n, d)`.
fn camera_rows(plane: &Plane, scale: f64) -> (Vector4<f64>, PlaneRows) {
    let [a, b] = plane.across();
    let column = |v: Vector3<f64>| Vector4::new(v.x, v.y, v.z, 0.0);
    (
        column(plane.normal * scale) + Vector4::w() * plane.distance_m,
        PlaneRows::from_columns(&[column(a * scale), column(b * scale), Vector4::w()]),
    )
}

/// The same for the LiDAR, `q = (R n, d + (R n)·t)`.
pub(crate) fn lidar_rows(plane: &Plane, t: &Isometry3<f64>) -> (Vector4<f64>, PlaneRows) {
    let [a, b] = plane.across();
    let column = |v: Vector3<f64>| {
        let turned = t.rotation * v;
        Vector4::new(turned.x, turned.y, turned.z, turned.dot(&t.translation.vector))
    };
    (
        column(plane.normal) + Vector4::w() * plane.distance_m,
        PlaneRows::from_columns(&[column(a), column(b), Vector4::w()]),
    )
}

/// `∂q/∂(R, t)` of the LiDAR: `δ(R n) = θ × R n`.
pub(crate) fn lidar_parameters(plane: &Plane, t: &Isometry3<f64>) -> ParameterRows {
    let (m, place) = (t.rotation * plane.normal, t.translation.vector);
    let mut rows = ParameterRows::zeros();
    rows.fixed_view_mut::<3, 3>(0, 0).copy_from(&-m.cross_matrix());
    rows.fixed_view_mut::<1, 3>(3, 0).copy_from(&m.cross(&place).transpose());
    rows.fixed_view_mut::<1, 3>(3, 3).copy_from(&m.transpose());
    rows
}

fn equations(boards: &[Board], state: &State, with_scale: bool) -> Result<Normal, Unsolved> {
    let mut normal = Normal { information: Covariance::zeros(), gradient: SVector::zeros(), planes: Vec::new() };
    for (board, plane) in boards.iter().zip(&state.planes) {
        let (q_camera, camera) = camera_rows(plane, state.scale);
        let (q_lidar, lidar) = lidar_rows(plane, &state.t);
        let mut of_camera = ParameterRows::zeros();
        if with_scale {
            // Where the ray meets the plane, d/α, and not where the point was measured: else noise alone shrinks the scale.
            of_camera.fixed_view_mut::<1, 1>(3, 6).fill(-plane.distance_m / state.scale);
        }
        let of_lidar = lidar_parameters(plane, &state.t);
        let part = |moments: &Matrix4<f64>, q: &Vector4<f64>, rows: &PlaneRows, of: &ParameterRows| {
            let (weighted, residual) = (moments * rows, moments * q);
            (
                of.transpose() * moments * of,
                of.transpose() * weighted,
                rows.transpose() * weighted,
                of.transpose() * residual,
                rows.transpose() * residual,
            )
        };
        let c = part(&board.camera.matrix, &q_camera, &camera, &of_camera);
        let l = part(&board.lidar.matrix, &q_lidar, &lidar, &of_lidar);
        let (cross, own, toward) = (c.1 + l.1, c.2 + l.2, c.4 + l.4);
        let own_inverse = own.try_inverse().ok_or(Unsolved::Degenerate)?;
        normal.information += c.0 + l.0 - cross * own_inverse * cross.transpose();
        normal.gradient += c.3 + l.3 - cross * own_inverse * toward;
        normal.planes.push((own_inverse, toward, cross));
    }
    if !with_scale {
        // A parameter that is known exactly.
        normal.information.fixed_view_mut::<1, 1>(6, 6).fill(1.0);
    }
    Ok(normal)
}

fn advance(
    state: &mut State,
    normal: &Normal,
    step: &SVector<f64, PARAMETERS>,
    with_scale: bool,
) -> Result<(), Unsolved> {
    if step.iter().any(|number| !number.is_finite()) {
        return Err(Unsolved::Degenerate);
    }
    for (plane, (own_inverse, toward, cross)) in state.planes.iter_mut().zip(&normal.planes) {
        let own = -(own_inverse * (toward + cross.transpose() * step));
        let [a, b] = plane.across();
        plane.normal = (plane.normal + a * own.x + b * own.y).normalize();
        plane.distance_m += own.z;
    }
    state.t.rotation = exp_rotation(&step.fixed_rows::<3>(0).into()) * state.t.rotation;
    state.t.translation.vector += step.fixed_rows::<3>(3);
    if with_scale {
        state.scale += step.fixed_rows::<1>(6).x;
    }
    Ok(())
}

/// The two sensors' own planes held against each other, in their covariances: squared, three degrees of freedom.
fn disagreement(board: &Board, plane: &Plane, state: &State) -> Option<f64> {
    let own = |moments: &Matrix4<f64>, (q, rows): (Vector4<f64>, PlaneRows)| {
        let information: Matrix3<f64> = rows.transpose() * moments * rows;
        let covariance = information.try_inverse()?;
        Some((-(covariance * (rows.transpose() * moments * q)), covariance))
    };
    let (camera, of_camera) = own(&board.camera.matrix, camera_rows(plane, state.scale))?;
    let (lidar, of_lidar) = own(&board.lidar.matrix, lidar_rows(plane, &state.t))?;
    let apart: Vector3<f64> = camera - lidar;
    Some(apart.dot(&((of_camera + of_lidar).try_inverse()? * apart)))
}

/// The inverse, where all parameters are fixed. Scaled to a unit diagonal first: radians and metres are not compared.
pub(crate) fn inverse(information: &Covariance) -> Result<Covariance, Unsolved> {
    let roots = information.diagonal().map(|number| number.max(0.0).sqrt());
    if roots.iter().any(|root| !root.is_finite() || *root <= 0.0) {
        return Err(Unsolved::Degenerate);
    }
    let scale = Covariance::from_diagonal(&roots.map(|root| 1.0 / root));
    let scaled = scale * information * scale;
    let eigenvalues = nalgebra::SymmetricEigen::new(scaled).eigenvalues;
    if eigenvalues.min() < LEAST_CONDITION * eigenvalues.max() {
        return Err(Unsolved::Degenerate);
    }
    let inverse = scaled.try_inverse().ok_or(Unsolved::Degenerate)?;
    Ok(scale * inverse * scale)
}

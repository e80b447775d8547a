//! The update: linear, for the innovation of a pose is the error itself, a body twist.
//!
//! ```text
//!   ⎡ √Rᵀ     0  ⎤    one orthogonal    ⎡ √Sᵀ   K̄ᵀ ⎤     S = H P Hᵀ + R,  K = K̄ √S⁻¹
//!   ⎣ U Hᵀ    U  ⎦    transformation    ⎣  0    U⁺ ⎦     P⁺ = U⁺ᵀ U⁺
//! ```
//! Nothing is subtracted, so nothing becomes negative.

use super::measurement::Innovation;
use super::root::{Root, triangle};
use super::state::{Setup, State};
use nalgebra::{DMatrix, Matrix6, Vector6};
use tumbled_model::se3::skew;

/// A correction of the attitude beyond this bends the error's coordinates: they are moved to the new pose, rad.
const BENDS_RAD: f64 = 0.03;

/// The state after a pose whose noise is widened by `widened` (a factor of its variance), and the normalised innovation
/// squared; none where the numbers fail.
pub(super) fn update(setup: &Setup, state: &State, innovation: &Innovation, widened: f64) -> Option<(State, f64)> {
    let width = setup.layout.width;
    let noise = (innovation.noise * widened).cholesky()?.l().transpose();
    let mut rows = DMatrix::zeros(6 + width, 6 + width);
    rows.view_mut((0, 0), (6, 6)).copy_from(&noise);
    rows.view_mut((6, 0), (width, 6)).copy_from(&innovation.seen);
    rows.view_mut((6, 6), (width, width)).copy_from(state.root.rows());
    let rows = triangle(rows);

    let innovation_root: Matrix6<f64> = rows.fixed_view::<6, 6>(0, 0).transpose();
    let white: Vector6<f64> = innovation_root.solve_lower_triangular(&innovation.twist)?;
    let correction: Vec<f64> = (0..width).map(|column| rows.fixed_view::<6, 1>(0, 6 + column).dot(&white)).collect();
    let mut after = state.clone();
    after.root = Root::of(rows.view((6, 6), (width, width)).into_owned());
    after.correct(&setup.layout, &correction);
    let twist = Vector6::from_iterator(correction.iter().copied());
    if twist.fixed_rows::<3>(0).norm() > BENDS_RAD {
        after.root = moved_to(&after.root, &twist);
    }
    Some((after, white.norm_squared()))
}

/// The covariance in the coordinates of the corrected pose: `P ← G P Gᵀ`, `G = I − ½ ad(ξ)`.
fn moved_to(root: &Root, twist: &Vector6<f64>) -> Root {
    let turn = skew(&twist.fixed_rows::<3>(0).into()) * -0.5;
    let shift = skew(&twist.fixed_rows::<3>(3).into()) * -0.5;
    let before = root.rows();
    let mut rows = before.clone();
    super::root::add_mapped(&mut rows, 0, before, 0, &turn);
    super::root::add_mapped(&mut rows, 3, before, 0, &shift);
    super::root::add_mapped(&mut rows, 3, before, 3, &turn);
    Root::of(rows)
}

#[cfg(test)]
mod tests;

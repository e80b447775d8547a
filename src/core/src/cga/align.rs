//! The motor that best takes points to sphere centres, in closed form.
//!
//! The objective `Σ w (M P M̃)·S` is `½ Σ w (r² − |Rp + t − c|²)`: radii are constants, so its maximiser is the weighted
//! alignment of points to centres, and r acts only through the weights. With quaternions, `A = 𝑅(p) − 𝐿(c)` (left and
//! right multiplication by pure quaternions) gives `|Rp + t − c|² = |A q + 2d|²` for the motor `q + εd`. The best d for
//! a q is `−½ Ā q`; what is left is `qᵀ N q`, `N = Σ w AᵀA − W ĀᵀĀ`: q is the eigenvector of N's least eigenvalue, which is
//! the cost. Never a reflection, and half a turn is no special case. (Valkenburg and Dorst 2011 for motors by eigenvectors;
//! Horn 1987 for the quaternion form; design note `method.md` §4.1.)

use super::{Motor, Plane};
use nalgebra::{Matrix3, Matrix4, Point3, Quaternion, SymmetricEigen, Vector3, Vector4};

/// The rotation is not unique when the two least eigenvalues differ by less than this, relative to the trace.
const UNIQUE: f64 = 1e-6;
/// The translation is not unique when its least eigenvalue is below this, relative to the trace.
const HELD: f64 = 1e-9;

/// A point and the centre of the sphere it belongs to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointPair {
    /// p: the point that moves, m.
    pub point: Point3<f64>,
    /// c: the centre it goes to, m.
    pub center: Point3<f64>,
    /// w ≥ 0. For a sphere of radius r and noise σ, `1/(σ² + r²)` is sensible.
    pub weight: f64,
}

/// A direction and where it points after the motion, both of unit length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DirectionPair {
    /// n: the direction that turns.
    pub direction: Vector3<f64>,
    /// n′: where it goes.
    pub target: Vector3<f64>,
    /// w ≥ 0, in units of a squared length: of m² per point's weight.
    pub weight: f64,
}

/// A point and the plane it lies in after the motion. It helps to fix the translation only.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlanePair {
    /// p: the point that moves, m.
    pub point: Point3<f64>,
    /// The plane it goes to.
    pub plane: Plane<f64>,
    /// w ≥ 0.
    pub weight: f64,
}

/// The best motor and how good it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Alignment {
    /// The motor; of q and −q the one whose first number other than 0 is positive.
    pub motor: Motor,
    /// `Σ w |Rp + t − c|² + Σ w |Rn − n′|²`, m²: N's least eigenvalue.
    pub cost: f64,
    /// By how much the second least eigenvalue is larger, relative to N's trace: 0 for no rotation known.
    pub separation: f64,
}

/// Why there is no single best motor.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AlignmentError {
    /// Nothing with a weight above 0.
    #[error("there is nothing to align: no pair has a weight above 0")]
    Empty,
    /// A number that is none.
    #[error("a coordinate or weight is not a finite number, or a weight is below 0")]
    NotFinite,
    /// Pairs on a line, symmetric, or fewer than three: rotations about an axis are as good.
    #[error(
        "the pairs fix no rotation about ({:.3}, {:.3}, {:.3}): eigenvalues {separation:.1e} of the trace apart, {UNIQUE:.0e} needed",
        axis.x, axis.y, axis.z
    )]
    Rotation {
        /// The axis, in the frame moved to, of unit length: the null direction.
        axis: Vector3<f64>,
        /// How far apart the two least eigenvalues are, relative to the trace.
        separation: f64,
    },
    /// Planes leave a translation open.
    #[error("the pairs fix no translation along ({:.3}, {:.3}, {:.3})", direction.x, direction.y, direction.z)]
    Translation {
        /// The direction, in the frame moved to, of unit length: the null direction.
        direction: Vector3<f64>,
    },
}

/// The motor for which `Σ w |Rp + t − c|² + Σ w |Rn − n′|²` is least.
///
/// # Errors
/// Nothing to align, numbers that are none, no unique rotation; directions alone fix no translation.
pub fn align(points: &[PointPair], directions: &[DirectionPair]) -> Result<Alignment, AlignmentError> {
    align_with_planes(points, directions, &[])
}

/// As [`align`]; then, with the rotation fixed, the translation for which `Σ w |Rp + t − c|² + Σ w (n·(Rp + t) − d)²` is
/// least. The cost is that of the first step: points at their own best translation, and directions.
///
/// # Errors
/// As [`align`]; planes that leave a translation open.
pub fn align_with_planes(
    points: &[PointPair],
    directions: &[DirectionPair],
    planes: &[PlanePair],
) -> Result<Alignment, AlignmentError> {
    check(points, directions, planes)?;
    let total: f64 = points.iter().map(|pair| pair.weight).sum();
    let (from, to) = centroids(points, total);
    // N about the centroids: there Ā is 0, and no large squares cancel.
    let mut n = Matrix4::zeros();
    for pair in points {
        let a = right(&(pair.point.coords - from)) - left(&(pair.center.coords - to));
        n += a.transpose() * a * pair.weight;
    }
    for pair in directions {
        let b = right(&pair.direction) - left(&pair.target);
        n += b.transpose() * b * pair.weight;
    }
    let (q, cost, separation) = least(&n)?;
    let rotation = nalgebra::UnitQuaternion::new_unchecked(q);
    let t = translation(&rotation, points, planes, total, to - rotation * from)?;
    let d = Quaternion::from_imag(t) * q * 0.5;
    let motor = Motor::from_dual_quaternion(q, d).ok_or(AlignmentError::NotFinite)?;
    Ok(Alignment { motor, cost, separation })
}

fn check(points: &[PointPair], directions: &[DirectionPair], planes: &[PlanePair]) -> Result<(), AlignmentError> {
    let finite = |vector: &Vector3<f64>| vector.iter().all(|number| number.is_finite());
    let points = points.iter().map(|pair| (finite(&pair.point.coords) && finite(&pair.center.coords), pair.weight));
    let directions = directions.iter().map(|pair| (finite(&pair.direction) && finite(&pair.target), pair.weight));
    let planes = planes.iter().map(|pair| (finite(&pair.point.coords) && finite(&pair.plane.normal()), pair.weight));
    let mut any = false;
    for (finite, weight) in points.chain(directions).chain(planes) {
        if !(finite && weight >= 0.0 && weight.is_finite()) {
            return Err(AlignmentError::NotFinite);
        }
        any |= weight > 0.0;
    }
    if any { Ok(()) } else { Err(AlignmentError::Empty) }
}

/// The weighted centroids of points and centres; the origins where there are none.
fn centroids(points: &[PointPair], total: f64) -> (Vector3<f64>, Vector3<f64>) {
    if total <= 0.0 {
        return (Vector3::zeros(), Vector3::zeros());
    }
    let (mut from, mut to) = (Vector3::zeros(), Vector3::zeros());
    for pair in points {
        from += pair.point.coords * pair.weight;
        to += pair.center.coords * pair.weight;
    }
    (from / total, to / total)
}

/// The eigenvector of the least eigenvalue, that eigenvalue, and how far apart the next is.
fn least(n: &Matrix4<f64>) -> Result<(Quaternion<f64>, f64, f64), AlignmentError> {
    let eigen = SymmetricEigen::new(*n);
    let values = &eigen.eigenvalues;
    let mut order = [0, 1, 2, 3];
    order
        .sort_by(|&a, &b| values.get(a).zip(values.get(b)).map_or(core::cmp::Ordering::Equal, |(a, b)| a.total_cmp(b)));
    let [first, second, ..] = order;
    let (lowest, next) = values.get(first).zip(values.get(second)).ok_or(AlignmentError::NotFinite)?;
    let vector = |column| {
        let v: Vector4<f64> = eigen.eigenvectors.column(column).into_owned();
        Quaternion::new(v.x, v.y, v.z, v.w)
    };
    let (q, other) = (vector(first), vector(second));
    let trace = n.trace();
    let separation = if trace > 0.0 { (next - lowest) / trace } else { 0.0 };
    if separation < UNIQUE || separation.is_nan() {
        // other ⟂ q, so other = u q with u pure: the rotations between them turn about u.
        let axis = (other * q.conjugate()).imag();
        let axis = axis.try_normalize(0.0).unwrap_or_else(Vector3::x);
        return Err(AlignmentError::Rotation { axis, separation });
    }
    Ok((signed(q), lowest.max(0.0), separation))
}

/// Of q and −q the one whose first number other than 0 is positive: scalar first, then x, y, z.
fn signed(q: Quaternion<f64>) -> Quaternion<f64> {
    let first = [q.w, q.i, q.j, q.k].into_iter().find(|number| *number != 0.0).unwrap_or(1.0);
    if first < 0.0 { -q } else { q }
}

/// The translation of all linear terms: `(Σw_p I + Σw_π nnᵀ) t = Σw_p (c − Rp) + Σw_π n (d − n·Rp)`; without planes it is
/// the points' own.
fn translation(
    rotation: &nalgebra::UnitQuaternion<f64>,
    points: &[PointPair],
    planes: &[PlanePair],
    total: f64,
    of_points: Vector3<f64>,
) -> Result<Vector3<f64>, AlignmentError> {
    if planes.is_empty() && !points.is_empty() && total > 0.0 {
        return Ok(of_points);
    }
    let mut matrix = Matrix3::identity() * total;
    let mut side = of_points * total;
    for pair in planes {
        let normal = pair.plane.normal();
        let gap = pair.plane.height_over_origin() - normal.dot(&(rotation * pair.point.coords));
        matrix += normal * normal.transpose() * pair.weight;
        side += normal * (gap * pair.weight);
    }
    let eigen = SymmetricEigen::new(matrix);
    let (weakest, value) = eigen.eigenvalues.argmin();
    if value <= HELD * matrix.trace() {
        return Err(AlignmentError::Translation { direction: eigen.eigenvectors.column(weakest).into_owned() });
    }
    matrix.cholesky().map(|factor| factor.solve(&side)).ok_or(AlignmentError::NotFinite)
}

/// 𝐿(x): `𝐿(x) y = x y` for a pure quaternion x, over (w, x, y, z).
fn left(x: &Vector3<f64>) -> Matrix4<f64> {
    Matrix4::new(
        0.0, -x.x, -x.y, -x.z, //
        x.x, 0.0, -x.z, x.y, //
        x.y, x.z, 0.0, -x.x, //
        x.z, -x.y, x.x, 0.0,
    )
}

/// 𝑅(x): `𝑅(x) y = y x` for a pure quaternion x, over (w, x, y, z).
fn right(x: &Vector3<f64>) -> Matrix4<f64> {
    Matrix4::new(
        0.0, -x.x, -x.y, -x.z, //
        x.x, 0.0, x.z, -x.y, //
        x.y, -x.z, 0.0, x.x, //
        x.z, x.y, -x.x, 0.0,
    )
}

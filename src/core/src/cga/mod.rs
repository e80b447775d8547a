//! Conformal geometric algebra, G(4,1), as far as registration needs it: vectors and motors, no general multivectors.
//!
//! Euclidean space is put on a cone in five dimensions, with the basis e1, e2, e3, e0 (the origin) and e∞ (the point at
//! infinity), e0² = e∞² = 0, e0·e∞ = −1. Points, planes and spheres are all vectors there, so one inner product answers
//! how any two of them lie to each other, and one motor moves them all. (Dorst, Fontijne, Mann: Geometric Algebra for
//! Computer Science, ch. 13–16; design note `method.md` §1, §2, §4.1.)
//!
//! * [`conformal`]: the five numbers and their inner product; [`shapes`]: points, planes, spheres and what their products
//!   mean;
//! * [`anchored`]: a sphere or plane held at a point of its surface: the form for computing, exact through flat, in `f32`
//!   too;
//! * [`motor`]: rigid motion as a unit dual quaternion;
//! * [`moment`], [`fit`], [`tangent`]: three spheres of a neighbourhood of points;
//! * [`mod@align`]: the motor that best takes points to sphere centres, in closed form.

pub mod align;
pub mod anchored;
pub mod conformal;
pub mod fit;
pub mod moment;
pub mod motor;
pub mod shapes;
pub mod tangent;

pub use align::{Alignment, AlignmentError, DirectionPair, PlanePair, PointPair, align, align_with_planes};
pub use anchored::AnchoredSphere;
pub use conformal::{Conformal, Real};
pub use fit::{FitError, FittedSphere, fit_sphere};
pub use moment::{MomentSphere, moment_sphere};
pub use motor::Motor;
pub use shapes::{ConformalPoint, Plane, Sphere};
pub use tangent::{TangentSphere, tangent_sphere};

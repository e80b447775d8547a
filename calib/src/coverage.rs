//! Whether poses differ enough to fix six parameters, and in words what is missing.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

/// Boards' normals must have at least this mean square along every direction (0.002 to 0.007 in poor sets, 0.04 to 0.13 in
/// good ones).
pub const LEAST_NORMALS: f64 = 0.02;
/// Spheres' centres must scatter at least so far along their second and third direction, m.
pub const LEAST_CENTRES_M: [f64; 2] = [0.25, 0.10];

/// How directions or places are spread.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spread {
    /// Mean squares along the three principal directions, the largest first.
    pub sizes: [f64; 3],
    /// Those directions, length 1.
    pub directions: [Vector3<f64>; 3],
}

impl Spread {
    /// Of boards' normals, about no mean.
    pub fn of_normals(normals: &[Vector3<f64>]) -> Self {
        Self::of(normals.iter().copied(), normals.len())
    }

    /// Of places, about their mean.
    pub fn of_places(places: &[Vector3<f64>]) -> Self {
        let mean = places.iter().sum::<Vector3<f64>>() / places.len().max(1) as f64;
        Self::of(places.iter().map(|place| place - mean), places.len())
    }

    fn of(vectors: impl Iterator<Item = Vector3<f64>>, count: usize) -> Self {
        let scatter = vectors.fold(Matrix3::zeros(), |sum, v| sum + v * v.transpose()) / count.max(1) as f64;
        let eigen = SymmetricEigen::new(scatter);
        let mut parts: Vec<(f64, Vector3<f64>)> =
            eigen.eigenvalues.iter().copied().zip(eigen.eigenvectors.column_iter().map(Into::into)).collect();
        parts.sort_by(|a, b| b.0.total_cmp(&a.0));
        let part = |n: usize| parts.get(n).copied().unwrap_or((0.0, Vector3::zeros()));
        let all: [(f64, Vector3<f64>); 3] = core::array::from_fn(part);
        Self { sizes: all.map(|(size, _)| size.max(0.0)), directions: all.map(|(_, direction)| direction) }
    }
}

/// What boards' normals lack, in the camera's frame; `None`: nothing.
pub fn missing_tilts(spread: &Spread) -> Option<String> {
    let [_, second, third] = spread.sizes;
    let [_, _, weak] = spread.directions;
    if third >= LEAST_NORMALS {
        return None;
    }
    if second < LEAST_NORMALS {
        return Some(
            "all boards face nearly the same way: add boards turned to the left and right, and boards leaning back and \
             forward, by 30 to 45 degrees; without them nothing across the boards is fixed"
                .to_owned(),
        );
    }
    Some(match weak.abs().argmax().0 {
        0 => "no tilt about the vertical: add boards leaning left and right (turned by 30 to 45 degrees); without them the \
              translation to the left and right is not fixed"
            .to_owned(),
        1 => "no tilt about the level: add boards leaning back and forward by 30 to 45 degrees; without them the translation \
              up and down is not fixed"
            .to_owned(),
        _ => "every board is seen on edge: add boards that face the sensors; without them the translation forward and back \
              is not fixed"
            .to_owned(),
    })
}

/// What spheres' places lack, in the camera's frame; `None`: nothing.
pub fn missing_places(spread: &Spread) -> Option<String> {
    let [_, second, third] = spread.sizes.map(f64::sqrt);
    let [least_second, least_third] = LEAST_CENTRES_M;
    let [_, _, weak] = spread.directions;
    if second < least_second {
        return Some(
            "the sphere's places lie near one line: the rotation about it is not fixed; put it to the left and right, high and \
             low, near and far"
                .to_owned(),
        );
    }
    if third >= least_third {
        return None;
    }
    let way = match weak.abs().argmax().0 {
        0 => "more to the left and right",
        1 => "higher and lower",
        _ => "nearer and farther",
    };
    Some(format!("the sphere's places lie near one plane: put it {way}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn turned(about: Vector3<f64>, degrees: &[f64]) -> Vec<Vector3<f64>> {
        let normal = |degrees: &f64| tumbled_model::se3::exp_rotation(&(about * degrees.to_radians())) * Vector3::z();
        degrees.iter().map(normal).collect()
    }

    #[test]
    fn what_is_missing_is_named_by_what_to_do() {
        let words = |normals: &[Vector3<f64>]| missing_tilts(&Spread::of_normals(normals));
        // Leaning back and forward turns a board about x: no normal has a part along x.
        let leaning = turned(Vector3::x(), &[-40.0, -20.0, 0.0, 20.0, 40.0]);
        assert!(
            words(&leaning).expect("poor").contains("no tilt about the vertical: add boards leaning left and right")
        );
        let turning = turned(Vector3::y(), &[-40.0, -20.0, 0.0, 20.0, 40.0]);
        assert!(words(&turning).expect("poor").contains("leaning back and forward"));
        assert!(words(&turned(Vector3::x(), &[0.0, 1.0])).expect("poor").contains("the same way"));
        let both: Vec<Vector3<f64>> = leaning.into_iter().chain(turning).collect();
        assert_eq!(words(&both), None);
    }

    #[test]
    fn places_on_a_line_and_in_a_plane_are_told_apart() {
        let words = |places: &[[f64; 3]]| {
            missing_places(&Spread::of_places(&places.iter().copied().map(Vector3::from).collect::<Vec<_>>()))
        };
        let line = [[0.0, 0.0, 1.0], [0.0, 0.0, 2.0], [0.0, 0.1, 3.0], [0.0, 0.0, 4.0]];
        assert!(words(&line).expect("poor").contains("one line"));
        let plane = [[-0.5, 0.0, 1.0], [0.5, 0.0, 1.0], [-0.5, 0.0, 2.0], [0.5, 0.0, 2.0]];
        assert!(words(&plane).expect("poor").contains("higher and lower"));
        let space = [[-0.5, 0.2, 1.0], [0.5, -0.2, 1.0], [-0.5, -0.2, 2.0], [0.5, 0.2, 2.0]];
        assert_eq!(words(&space), None);
    }
}

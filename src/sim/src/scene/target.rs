//! What is measured: one of the simulator's own shapes, or a surface that somebody brings.

use super::error::SceneError;
use crate::shape::{Material, Mesh};
use crate::target::TargetKind;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How long a target's longest side may be, m: beyond it lies a wrong unit rather than a target.
const SIZE_M: core::ops::RangeInclusive<f64> = 0.01..=20.0;

/// What is measured: `shape` or `mesh`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SceneTarget {
    /// Which of the simulator's own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shape: Option<TargetKind>,
    /// A file with its surface (.obj, .stl or .ply), relative to the scene file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mesh: Option<String>,
    /// Metres per unit of the file: 0.001 for millimetres. Left out: 1, or what `size_m` asks for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub scale: Option<f64>,
    /// How long its longest side along x, y or z is made, m; left out: as it is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size_m: Option<f64>,
    /// Whether its origin is moved to the middle of its extents; otherwise it stays where the file or the shape has it.
    pub center: bool,
    /// What all of its surface is made of; left out: what the shape has, matt for a file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub material: Option<Material>,
}

impl SceneTarget {
    /// One of the simulator's own, as it is.
    pub fn of(shape: TargetKind) -> Self {
        Self { shape: Some(shape), ..Self::default() }
    }

    /// Its surface in its own frame, m. `brought`: what the file holds, in the file's unit.
    pub(super) fn surface(&self, brought: Option<Mesh>) -> Result<Mesh, SceneError> {
        let mut mesh = match (self.shape, &self.mesh, brought) {
            (Some(shape), None, _) => shape.mesh(),
            (None, Some(_), Some(mesh)) => mesh,
            (None, Some(file), None) => return Err(SceneError::NoMesh(file.clone())),
            (Some(_), Some(_), _) | (None, None, _) => return Err(SceneError::OneSurface),
        };
        let factor = self.factor(&mesh)?;
        mesh.scale(factor);
        if self.center {
            let [low, high] = mesh.extents();
            let middle = nalgebra::center(&low, &high).coords;
            mesh.vertices.iter_mut().for_each(|vertex| *vertex -= middle);
        }
        if let Some(material) = self.material {
            mesh.triangles.iter_mut().for_each(|triangle| triangle.material = material);
        }
        let size_m = mesh.size_m();
        if SIZE_M.contains(&size_m) && mesh.radius() <= 2.0 * SIZE_M.end() {
            return Ok(mesh);
        }
        Err(SceneError::Size { size_m, far_m: mesh.radius() })
    }

    fn factor(&self, mesh: &Mesh) -> Result<f64, SceneError> {
        let positive = |key, found: f64| match found.is_finite() && found > 0.0 {
            true => Ok(found),
            false => Err(SceneError::Number { key, found, expected: "a finite number above 0" }),
        };
        match (self.scale, self.size_m) {
            (None, None) => Ok(1.0),
            (Some(scale), None) if self.mesh.is_some() => positive("target.scale", scale),
            (None, Some(size_m)) => Ok(positive("target.size_m", size_m)? / mesh.size_m()),
            (Some(_), _) => Err(SceneError::OneScale),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::solid::cuboid;
    use nalgebra::{Point3, Vector3};

    /// 1200 × 600 × 300 units, its lowest corner at the origin.
    fn crate_in_mm() -> Mesh {
        let mut mesh = cuboid(Vector3::new(1200.0, 600.0, 300.0), 1, |_, _| Material::Matt);
        mesh.vertices.iter_mut().for_each(|vertex| *vertex += Vector3::new(600.0, 300.0, 150.0));
        mesh
    }

    fn file() -> SceneTarget {
        SceneTarget { mesh: Some("crate.stl".into()), ..SceneTarget::default() }
    }

    #[test]
    fn a_files_surface_is_scaled_centred_and_made_of_what_the_scene_says() {
        let target = SceneTarget { scale: Some(0.001), center: true, material: Some(Material::Foil), ..file() };
        let mesh = target.surface(Some(crate_in_mm())).unwrap();
        let [low, high] = mesh.extents();
        assert!((low - Point3::new(-0.6, -0.3, -0.15)).norm() < 1e-12, "{low}");
        assert!((high - Point3::new(0.6, 0.3, 0.15)).norm() < 1e-12, "{high}");
        assert!(mesh.triangles.iter().all(|triangle| triangle.material == Material::Foil));
        // By size instead of scale, its origin left at the corner: 0.9 m long, and half and a quarter of that.
        let mesh = SceneTarget { size_m: Some(0.9), ..file() }.surface(Some(crate_in_mm())).unwrap();
        let [low, high] = mesh.extents();
        assert!(low.coords.norm() < 1e-12 && (high - Point3::new(0.9, 0.45, 0.225)).norm() < 1e-12, "{high}");
    }

    #[test]
    fn a_shape_of_the_simulators_can_have_another_size() {
        let sphere = SceneTarget { size_m: Some(0.5), ..SceneTarget::of(TargetKind::Sphere) };
        let mesh = sphere.surface(None).unwrap();
        assert!((mesh.size_m() - 0.5).abs() < 1e-12 && mesh.vertices.len() > 1_000);
        let own = SceneTarget::of(TargetKind::BoxBus).surface(None).unwrap();
        assert_eq!(own, TargetKind::BoxBus.mesh());
    }

    #[test]
    fn a_wrong_unit_is_found_and_the_remedy_named() {
        let error = file().surface(Some(crate_in_mm())).unwrap_err().to_string();
        assert!(error.contains("1200") && error.contains("scale = 0.001"), "{error}");
        // A small thing far from its origin would swing past the sensors when it turns.
        let mut far = crate_in_mm();
        far.vertices.iter_mut().for_each(|vertex| vertex.x += 1e6);
        let error = SceneTarget { scale: Some(0.001), ..file() }.surface(Some(far)).unwrap_err().to_string();
        assert!(error.contains("center = true"), "{error}");
    }

    #[test]
    fn what_is_no_target_is_refused() {
        let surface = |target: SceneTarget| target.surface(Some(crate_in_mm())).unwrap_err().to_string();
        assert!(surface(SceneTarget::default()).contains("`shape` or `mesh`"));
        assert!(surface(SceneTarget { shape: Some(TargetKind::Cube), ..file() }).contains("`shape` or `mesh`"));
        assert!(surface(SceneTarget { scale: Some(f64::NAN), ..file() }).contains("target.scale is NaN"));
        assert!(surface(SceneTarget { size_m: Some(-1.0), ..file() }).contains("target.size_m is -1"));
        assert!(surface(SceneTarget { size_m: Some(1.0), scale: Some(1.0), ..file() }).contains("target.scale"));
        let scaled = SceneTarget { scale: Some(2.0), ..SceneTarget::of(TargetKind::Cube) };
        assert!(surface(scaled).contains("target.scale"));
        assert!(file().surface(None).unwrap_err().to_string().contains("crate.stl"));
    }
}

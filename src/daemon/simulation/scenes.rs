//! Scenes by name or file.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use tumbled_model::UnixNs;
use tumbled_sim::scene::{Scene, SceneConfig};
use tumbled_sim::shape::Mesh;

use super::meshes;
use crate::cli::Failure;

/// What an input that is a scene begins with: `sim:demo`.
pub const SCHEME: &str = "sim:";

/// The scenes that come with the program: name and text, in the order of their names.
const SCENES: [(&str, &str); 15] = [
    ("calibration-board", include_str!("../../../config/scenes/calibration-board.toml")),
    ("calibration-mockup", include_str!("../../../config/scenes/calibration-mockup.toml")),
    ("calibration-sphere", include_str!("../../../config/scenes/calibration-sphere.toml")),
    ("calibration-time", include_str!("../../../config/scenes/calibration-time.toml")),
    ("demo", include_str!("../../../config/scenes/demo.toml")),
    ("faults", include_str!("../../../config/scenes/faults.toml")),
    ("intruder", include_str!("../../../config/scenes/intruder.toml")),
    ("low-overlap", include_str!("../../../config/scenes/low-overlap.toml")),
    ("orbit-drift", include_str!("../../../config/scenes/orbit-drift.toml")),
    ("paper-rig", include_str!("../../../config/scenes/paper-rig.toml")),
    ("paper-simulation", include_str!("../../../config/scenes/paper-simulation.toml")),
    ("symmetric", include_str!("../../../config/scenes/symmetric.toml")),
    ("tumble", include_str!("../../../config/scenes/tumble.toml")),
    ("turntable-20dps", include_str!("../../../config/scenes/turntable-20dps.toml")),
    ("turntable-5dps", include_str!("../../../config/scenes/turntable-5dps.toml")),
];

/// The program's own scenes, a line each: name and what it is for.
pub fn list() -> String {
    let about = |text: &str| toml::from_str(text).map_or_else(|_| String::new(), |scene: SceneConfig| scene.about);
    let lines: Vec<String> = SCENES.iter().map(|(name, text)| format!("  {name:<19} {}", about(text))).collect();
    lines.join("\n")
}

/// The scene an input names; `None`: it is no scene.
pub fn scene_of(input: &Path) -> Option<&str> {
    input.to_str()?.strip_prefix(SCHEME)
}

/// Loads and builds a scene: one that comes with the program, or a file of one's own.
///
/// # Errors
/// A name that is none, a file that is no scene: exit code 2.
pub fn load(name: &str) -> Result<Scene, Failure> {
    load_with(name, None, None)
}

/// The same with another seed or another length.
///
/// # Errors
/// As [`load`].
pub fn load_with(name: &str, seed: Option<u64>, duration: Option<Duration>) -> Result<Scene, Failure> {
    load_changed(name, |config| {
        config.seed = seed.unwrap_or(config.seed);
        config.duration_s = duration.map_or(config.duration_s, |duration| duration.as_secs_f64());
    })
}

/// The same with any change of its keys.
///
/// # Errors
/// As [`load`], and keys that are no scene any more.
pub fn load_changed(name: &str, change: impl FnOnce(&mut SceneConfig)) -> Result<Scene, Failure> {
    let mut config = read(name)?;
    change(&mut config);
    let brought = brought(name, &config)?;
    Scene::build_with(config, brought).map_err(|error| Failure::input(format!("the scene {name}: {error}")))
}

/// The same without an end, for a live session whose zero is this wall time.
///
/// # Errors
/// As [`load`].
pub fn load_endless(name: &str, unix_at_zero: UnixNs) -> Result<Scene, Failure> {
    let failed = |error| Failure::input(format!("the scene {name}: {error}"));
    let config = read(name)?;
    let brought = brought(name, &config)?;
    Scene::endless(config, brought, unix_at_zero).map_err(failed)
}

fn read(name: &str) -> Result<SceneConfig, Failure> {
    let of_program = SCENES.iter().find(|(known, _)| *known == name).map(|(_, text)| (*text).to_owned());
    let text = match of_program {
        Some(text) => text,
        None => std::fs::read_to_string(name).map_err(|error| {
            Failure::input(format!("there is no scene `{name}`, and no file of that name can be read: {error}"))
                .with_help(format!("the program's own scenes are\n{}", list()))
        })?,
    };
    toml::from_str(&text).map_err(|error| Failure::input(format!("the scene {name}: {error}")))
}

/// Threads that make a scene; 0 = one for each processor. Changes no byte.
///
/// # Errors
/// A system that gives no threads.
pub fn pool(threads: usize) -> Result<Arc<rayon::ThreadPool>, Failure> {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().map(Arc::new).map_err(Failure::failed)
}

/// The surface that the scene names; `None`: its target is one of the simulator's own.
fn brought(name: &str, config: &SceneConfig) -> Result<Option<Mesh>, Failure> {
    config.target.mesh.as_deref().map(|file| surface(Path::new(name), file)).transpose()
}

/// Reads the surface that a scene file names; a path that is not absolute begins in the scene file's folder.
fn surface(scene: &Path, file: &str) -> Result<Mesh, Failure> {
    let path = scene.parent().unwrap_or(Path::new("")).join(file);
    let brought = meshes::read(&path).map_err(|error| {
        Failure::input(error).with_help(format!("target.mesh of {} names the file", scene.display()))
    })?;
    let (triangles, without_area) = (brought.mesh.triangles.len(), brought.without_area);
    tracing::info!(file = %path.display(), triangles, without_area, "the target's surface has been read");
    Ok(brought.mesh)
}

#[cfg(test)]
pub(super) const NAMES: [&str; SCENES.len()] = {
    let mut names = [""; SCENES.len()];
    let mut n = 0;
    while n < SCENES.len() {
        names[n] = SCENES[n].0;
        n += 1;
    }
    names
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scene_of_the_program_can_be_built_under_its_own_name() {
        for (name, _) in SCENES {
            assert_eq!(load(name).expect("a scene").config.name, name);
        }
    }
}

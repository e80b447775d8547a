//! Scenes by name or file.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use tumbled_model::UnixNs;
use tumbled_sim::scene::{Scene, SceneConfig};

use crate::cli::Failure;

/// What an input that is a scene begins with: `sim:demo`.
pub const SCHEME: &str = "sim:";

/// The scenes that come with the program: name and text.
const SCENES: [(&str, &str); 3] = [
    ("demo", include_str!("../../../config/scenes/demo.toml")),
    ("tumble", include_str!("../../../config/scenes/tumble.toml")),
    ("turntable-20dps", include_str!("../../../config/scenes/turntable-20dps.toml")),
];

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
    let mut config = read(name)?;
    config.seed = seed.unwrap_or(config.seed);
    config.duration_s = duration.map_or(config.duration_s, |duration| duration.as_secs_f64());
    Scene::build(config).map_err(|error| Failure::input(format!("the scene {name}: {error}")))
}

/// The same without an end, for a live session whose zero is this wall time.
///
/// # Errors
/// As [`load`].
pub fn load_endless(name: &str, unix_at_zero: UnixNs) -> Result<Scene, Failure> {
    let failed = |error| Failure::input(format!("the scene {name}: {error}"));
    Scene::endless(read(name)?, unix_at_zero).map_err(failed)
}

fn read(name: &str) -> Result<SceneConfig, Failure> {
    let of_program = SCENES.iter().find(|(known, _)| *known == name).map(|(_, text)| (*text).to_owned());
    let text = match of_program {
        Some(text) => text,
        None => std::fs::read_to_string(name).map_err(|error| {
            let known: Vec<&str> = SCENES.iter().map(|(name, _)| *name).collect();
            Failure::input(format!("there is no scene `{name}`, and no file of that name can be read: {error}"))
                .with_help(format!("the program's own scenes are {}", known.join(", ")))
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

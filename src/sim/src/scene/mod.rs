//! A scene as its file says it, and what is built from it.
//!
//! The file is TOML, read by the daemon; here are its types ([`SceneConfig`]), and [`Scene::build`] makes bodies, sensors
//! and lines of them. Angles are degrees and rates degrees a second where a key says so; everything else is SI.

mod build;
mod config;
mod endless;
mod places;
mod stage;
mod target;

pub use build::{KinectUnit, LidarUnit, Scene, SceneError};
pub use config::{
    OperatorErrors, SceneConfig, SceneExperiment, SceneKinect, SceneLidar, SceneMotion, SceneProfile, SceneRoom,
    SceneSlip, SceneStage, SceneStall, SceneWalk, Transform,
};
pub use places::{ScenePose, SceneViews};
pub use target::SceneTarget;

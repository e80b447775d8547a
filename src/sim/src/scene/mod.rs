//! A scene as its file says it, and what is built from it.
//!
//! The file is TOML, read by the daemon; here are its types ([`SceneConfig`]), and [`Scene::build`] makes bodies, sensors
//! and lines of them. Angles are degrees and rates degrees a second where a key says so; everything else is SI.

mod bodies;
mod build;
mod config;
mod endless;
mod error;
mod limits;
mod operator;
mod places;
mod stage;
mod target;
mod units;

pub use build::Scene;
pub use config::{
    OperatorErrors, SceneConfig, SceneExperiment, SceneKinect, SceneLidar, SceneMotion, SceneProfile, SceneRoom,
    SceneSlip, SceneStage, SceneStall, SceneWalk, Transform,
};
pub use error::SceneError;
pub use places::{ScenePose, SceneViews};
pub use target::SceneTarget;
pub use units::{KinectUnit, LidarUnit};

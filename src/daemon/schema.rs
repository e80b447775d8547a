//! The JSON Schemas the project publishes, generated from the Rust types.
//!
//! Each lies in the repository; a test holds the file against the type, and
//! `cargo test --test main -- --ignored regenerate` writes the files anew. A command that prints new JSON adds its
//! report here.

use schemars::{Schema, schema_for};
use tumbled_sim::faults::FaultScript;
use tumbled_sim::scene::SceneConfig;

use crate::cli::config::check::CheckReport;
use crate::config::raw::RawConfig;
use crate::config::show::ShowReport;
use crate::experiment::campaign::CampaignFile;
use crate::experiment::campaign::pose::PoseCampaignFile;
use crate::stream::{self, Sent};

/// A published schema.
pub struct Published {
    /// The file, relative to the root of the repository.
    pub file: &'static str,
    /// The schema.
    pub schema: Schema,
}

impl Published {
    /// The text of the file.
    pub fn text(&self) -> String {
        // `:#` indents.
        format!("{:#}\n", self.schema.as_value())
    }
}

/// The schema of the config file: what `tumbled config schema` prints.
pub fn config() -> Published {
    Published { file: "config/rig.schema.json", schema: schema_for!(RawConfig) }
}

/// The schemas of the other files that people write: with them an editor knows the keys.
pub fn files() -> Vec<Published> {
    vec![
        Published { file: "docs/schema/scene.schema.json", schema: schema_for!(SceneConfig) },
        Published { file: "docs/schema/faults.schema.json", schema: schema_for!(FaultScript) },
        Published { file: "docs/schema/campaign-file.schema.json", schema: schema_for!(CampaignFile) },
        Published { file: "docs/schema/campaign-pose-file.schema.json", schema: schema_for!(PoseCampaignFile) },
    ]
}

/// The schemas of every JSON output.
pub fn outputs() -> Vec<Published> {
    vec![
        Published { file: "docs/schema/config-check.schema.json", schema: schema_for!(CheckReport) },
        Published { file: "docs/schema/devices.schema.json", schema: schema_for!(crate::cli::devices::DevicesReport) },
        Published {
            file: "docs/schema/doctor.schema.json",
            schema: schema_for!(crate::cli::doctor::report::DoctorReport),
        },
        Published { file: "docs/schema/diff.schema.json", schema: schema_for!(crate::cli::diff::DiffReport) },
        Published { file: "docs/schema/export.schema.json", schema: schema_for!(crate::cli::export::Report) },
        Published { file: "docs/schema/control-request.schema.json", schema: schema_for!(crate::control::OrderLine) },
        Published { file: "docs/schema/control-answer.schema.json", schema: schema_for!(crate::control::Reply) },
        Published { file: "docs/schema/import.schema.json", schema: schema_for!(crate::cli::import::ImportReport) },
        Published {
            file: "docs/schema/api-control.schema.json",
            schema: schema_for!(crate::web::control::ControlReport),
        },
        Published { file: "docs/schema/record.schema.json", schema: schema_for!(crate::cli::record::RecordReport) },
        Published {
            file: "docs/schema/register.schema.json",
            schema: schema_for!(crate::cli::register::report::RegisterReport),
        },
        Published {
            file: "docs/schema/reconstruct.schema.json",
            schema: schema_for!(crate::reconstruction::ReconstructReport),
        },
        Published {
            file: "docs/schema/reconstruct-planes.schema.json",
            schema: schema_for!(crate::reconstruction::report::PlanesFile),
        },
        Published {
            file: "docs/schema/reconstruct-contour.schema.json",
            schema: schema_for!(crate::reconstruction::report::ContourFile),
        },
        Published {
            file: "docs/schema/experiment-reconstruction.schema.json",
            schema: schema_for!(crate::experiment::reconstruction::ReconstructionReport),
        },
        Published {
            file: "docs/schema/calibrate-extrinsic.schema.json",
            schema: schema_for!(crate::calibration::extrinsic::ExtrinsicReport),
        },
        Published {
            file: "docs/schema/calibrate-kinect.schema.json",
            schema: schema_for!(crate::calibration::depth::KinectReport),
        },
        Published {
            file: "docs/schema/calibrate-turntable.schema.json",
            schema: schema_for!(crate::calibration::turntable::TurntableReport),
        },
        Published {
            file: "docs/schema/calibrate-time.schema.json",
            schema: schema_for!(crate::calibration::time::TimeReport),
        },
        Published { file: "docs/schema/replay-vary.schema.json", schema: schema_for!(crate::vary::VaryReport) },
        Published { file: "docs/schema/evaluate.schema.json", schema: schema_for!(crate::evaluation::EvaluateReport) },
        Published {
            file: "docs/schema/experiment-registration.schema.json",
            schema: schema_for!(crate::experiment::registration::ExperimentReport),
        },
        Published {
            file: "docs/schema/campaign.schema.json",
            schema: schema_for!(crate::experiment::campaign::CampaignReport),
        },
        Published {
            file: "docs/schema/campaign-pose.schema.json",
            schema: schema_for!(crate::experiment::campaign::pose::PoseCampaignReport),
        },
        Published {
            file: "docs/schema/campaign-pose-trials.schema.json",
            schema: schema_for!(crate::experiment::campaign::pose::trial::PoseTrial),
        },
        Published {
            file: "docs/schema/experiment-pose.schema.json",
            schema: schema_for!(crate::experiment::pose::PoseExperimentReport),
        },
        Published {
            file: "docs/schema/target.schema.json",
            schema: schema_for!(crate::cli::target::show::TargetReport),
        },
        Published {
            file: "docs/schema/target-match.schema.json",
            schema: schema_for!(crate::cli::target::matching::MatchReport),
        },
        Published { file: "docs/schema/recover.schema.json", schema: schema_for!(crate::cli::recover::RecoverReport) },
        Published {
            file: "docs/schema/simulate.schema.json",
            schema: schema_for!(crate::cli::simulate::SimulateReport),
        },
        Published { file: "docs/schema/run.schema.json", schema: schema_for!(crate::cli::run::RunReport) },
        Published { file: "docs/schema/replay.schema.json", schema: schema_for!(crate::cli::replay::ReplayReport) },
        Published {
            file: "docs/schema/replay-epochs.schema.json",
            schema: schema_for!(crate::session::lines::EpochLine),
        },
        Published { file: "docs/schema/verify.schema.json", schema: schema_for!(crate::cli::verify::VerifyReport) },
        Published { file: "docs/schema/info.schema.json", schema: schema_for!(crate::cli::info::report::InfoReport) },
        Published { file: "docs/schema/status.schema.json", schema: schema_for!(crate::cli::status::StatusReport) },
        Published { file: "docs/schema/stream-hello.schema.json", schema: schema_for!(Sent<stream::Hello>) },
        Published { file: "docs/schema/stream-health.schema.json", schema: schema_for!(Sent<stream::HealthLine>) },
        Published { file: "docs/schema/stream-error.schema.json", schema: schema_for!(Sent<stream::ErrorLine>) },
        Published { file: "docs/schema/stream-event.schema.json", schema: schema_for!(Sent<stream::EventLine>) },
        Published { file: "docs/schema/stream-state.schema.json", schema: schema_for!(Sent<stream::StateLine>) },
        Published { file: "docs/schema/stream-point.schema.json", schema: schema_for!(Sent<stream::PointLine>) },
        Published { file: "docs/schema/stream-sigma.schema.json", schema: schema_for!(Sent<stream::SigmaLine>) },
        Published { file: "docs/schema/stream-cloud.schema.json", schema: schema_for!(Sent<stream::CloudLine>) },
        Published { file: "docs/schema/stream-model.schema.json", schema: schema_for!(Sent<stream::ModelLine>) },
        Published { file: "docs/schema/stream-contour.schema.json", schema: schema_for!(Sent<stream::ContourLine>) },
        Published { file: "docs/schema/stream-truth.schema.json", schema: schema_for!(Sent<stream::TruthLine>) },
        Published {
            file: "docs/schema/transport-order.schema.json",
            schema: schema_for!(crate::session::transport::TransportOrder),
        },
        Published {
            file: "docs/schema/transport.schema.json",
            schema: schema_for!(crate::session::transport::TransportReport),
        },
        Published { file: "docs/schema/config-show.schema.json", schema: schema_for!(ShowReport) },
    ]
}

//! The one integration binary: on a small machine linking is the cost, and one link is cheaper than ten.

mod architecture;
mod background;
mod beside_target;
mod calibrate_cli;
mod calibrate_depth_figures;
mod calibrate_figures;
mod calibrate_turning;
mod cli_basics;
mod config_cli;
mod config_layers;
mod config_session;
mod emulated_stage;
mod endless_scenes;
mod evaluate_cli;
mod experiment_cli;
mod export_cli;
mod export_losses;
mod export_outputs;
mod export_session;
mod faults;
mod foreign_kinect;
mod foreign_lidar;
mod foreign_registration;
mod foreign_scenes;
#[cfg(feature = "foxglove")]
mod foxglove;
mod golden;
mod info_cli;
#[cfg(feature = "kinect-usb")]
mod kinect_doctor;
#[cfg(feature = "kinect-usb")]
mod kinect_live;
mod live_losses;
mod machine_cli;
mod ordered_recordings;
mod page_answers;
mod pose_campaign_cli;
mod predicted;
mod readme;
mod real_states;
mod reconstruct_cli;
mod record_cli;
mod recorded_config;
mod recording_cli;
mod register_cli;
mod rehearsal;
mod replay_cli;
mod replay_killed;
mod rig_files;
mod run_cli;
mod run_simulated;
mod saved_target;
mod scene_limits;
mod schemas;
mod service;
mod simulated;
mod simulated_stage;
mod simulated_times;
mod soak;
mod stalls;
mod state_live;
mod state_losses;
mod states;
mod status_cli;
mod stream_limits;
mod stream_protocol;
mod stream_sockets;
mod support;
mod telemetry;
mod turntable_faults;
mod turntable_live;
mod web;
#[cfg(feature = "kinect-usb")]
mod whole_rig;

#[allow(dead_code, reason = "the driver's own tests use all of it")]
#[path = "../drivers/velodyne/tests/support/synth.rs"]
mod synth;

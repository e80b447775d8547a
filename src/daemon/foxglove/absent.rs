//! The bridge of a program that was built without it.

use std::net::SocketAddr;

use serde::Serialize;

use super::{DepthView, FoxgloveConfig, FoxgloveError, SensorPose, ViewTotals};
use crate::stream::{CloudView, ContourLine, EventLine, Hello, ModelView, StateLine};

/// A bridge that cannot be: no value of this type exists.
#[derive(Debug)]
pub enum FoxgloveBridge {}

impl FoxgloveBridge {
    /// Refuses.
    ///
    /// # Errors
    /// Always [`FoxgloveError::NotBuilt`].
    pub fn start(_config: &FoxgloveConfig, _hello: &Hello, _poses: Vec<SensorPose>) -> Result<Self, FoxgloveError> {
        Err(FoxgloveError::NotBuilt)
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        match *self {}
    }

    /// Whether a cloud would be shown.
    pub fn wants_cloud(&self, _sensor: &str) -> bool {
        match *self {}
    }

    /// Shows a cloud.
    pub fn cloud(&mut self, _cloud: &CloudView<'_>) {
        match *self {}
    }

    /// Shows a depth image.
    pub fn depth(&mut self, _depth: &DepthView<'_>) {
        match *self {}
    }

    /// Shows health.
    pub fn health(&mut self, _line: &impl Serialize, _unix_ns: i64) {
        match *self {}
    }

    /// Shows the target's pose.
    pub fn state(&mut self, _line: &StateLine, _unix_ns: i64) {
        match *self {}
    }

    /// Whether its surface would be shown.
    pub fn wants_surface(&self) -> bool {
        match *self {}
    }

    /// Shows its surface.
    pub fn surface(&self, _model: &ModelView<'_>, _contour: Option<&ContourLine>) {
        match *self {}
    }

    /// Shows an event.
    pub fn event(&mut self, _event: &EventLine) {
        match *self {}
    }

    /// What went to viewers.
    pub fn totals(&self) -> ViewTotals {
        match *self {}
    }

    /// Ends it.
    pub fn stop(self) -> ViewTotals {
        match self {}
    }
}

//! CONTOUR: the edges of the target's surface as it is known so far, for viewers.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_core::recon::{Edge, EdgeKind};
use tumbled_model::{RigNs, UnixNs};

use super::class::Class;
use super::hello::StreamOrigin;

/// What a line of the contour is. Whether a surface ends or is hidden where it ends, only `tumbled reconstruct` tells.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum ContourKind {
    /// Where two planes meet.
    Crease,
    /// Where a plane ends, or what was seen of it so far.
    End,
}

/// A straight piece of the contour.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ContourEdge {
    /// What it is.
    pub kind: ContourKind,
    /// Where it begins and ends, m, target's frame.
    pub ends_m: [[f64; 3]; 2],
}

/// The contour of a model. It is made beside the measurement, when the machine has time for it: a few seconds old, and
/// another one in a replay.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "tumbled stream: CONTOUR")]
pub struct ContourLine {
    /// CONTOUR.
    pub class: Class,
    /// Where the data come from.
    pub origin: StreamOrigin,
    /// The target's number in the session.
    pub target: u32,
    /// The epoch after which the model was as this was made of it.
    pub epoch: u64,
    /// Its time, ns on the session's timeline.
    pub t_ns: i64,
    /// The same as wall time, ns since 1970-01-01 UTC as a decimal string.
    pub unix_ns: String,
    /// The frame of the coordinates: `target`.
    pub frame: String,
    /// Planes that were found.
    pub planes: u64,
    /// The edges: creases first, longest first.
    pub edges: Vec<ContourEdge>,
}

impl ContourEdge {
    /// Of an edge whose surface was not told from where it was seen.
    pub fn new(edge: &Edge) -> Self {
        let kind = match edge.kind {
            EdgeKind::Crease => ContourKind::Crease,
            EdgeKind::Boundary | EdgeKind::Occlusion => ContourKind::End,
        };
        Self { kind, ends_m: edge.ends.map(|end| end.coords.into()) }
    }
}

impl ContourLine {
    /// Of the model of a target, by its number, as it was after an epoch at `t`, wall time `unix`.
    pub fn new(
        origin: StreamOrigin,
        (target, epoch): (u32, u64),
        (t, unix): (RigNs, UnixNs),
        planes: usize,
        edges: Vec<ContourEdge>,
    ) -> Self {
        let (class, frame) = (Class::Contour, "target".to_owned());
        Self {
            class,
            origin,
            target,
            epoch,
            t_ns: t.0,
            unix_ns: unix.0.to_string(),
            frame,
            planes: planes as u64,
            edges,
        }
    }
}

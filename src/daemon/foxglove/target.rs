//! The target for viewers: where it is, its surface, its contour.

use std::sync::Arc;
use std::time::{Duration, Instant};

use foxglove::messages::packed_element_field::NumericType;
use foxglove::messages::{
    Color, FrameTransform, FrameTransforms, LinePrimitive, PackedElementField, Point3, PointCloud, Pose, PoseInFrame,
    Quaternion, SceneEntity, SceneUpdate, Vector3, line_primitive,
};
use foxglove::{Channel, Context, FoxgloveError, PartialMetadata, RawChannel, Schema};
use schemars::schema_for;

use super::VIEW_POINTS;
use super::messages::{identity, log_time, timestamp};
use crate::stream::contour::ContourKind;
use crate::stream::{ContourLine, ModelView, StateLine};

/// Between two states: viewers draw no more often.
const STATE_PERIOD: Duration = Duration::from_millis(50);
/// Bytes of a piece of surface: x, y, z and its normal, six f32.
const SURFEL_BYTES: usize = 24;
/// The frame that the target's pose gives.
const TARGET: &str = "target";

/// The channels about the target.
#[derive(Debug)]
pub(super) struct TargetChannels {
    state: Arc<RawChannel>,
    pose: Channel<PoseInFrame>,
    model: Channel<PointCloud>,
    contour: Channel<SceneUpdate>,
    sent: Option<Instant>,
}

impl TargetChannels {
    /// On a bridge's context.
    pub(super) fn new(context: &Arc<Context>) -> Result<Self, FoxgloveError> {
        let schema = schema_for!(StateLine).as_value().to_string().into_bytes();
        let schema = Schema::new("tumbled.State", "jsonschema", schema);
        Ok(Self {
            state: context.channel_builder("/state").message_encoding("json").schema(schema).build_raw()?,
            pose: context.channel_builder("/pose").build(),
            model: context.channel_builder("/model").build(),
            contour: context.channel_builder("/contour").build(),
            sent: None,
        })
    }

    /// Whether anybody looks at the surface.
    pub(super) fn want_surface(&self) -> bool {
        self.model.has_sinks() || self.contour.has_sinks()
    }

    /// Shows where the target is: pose, transform (on `tf`) and, with its covariance, the state.
    pub(super) fn state(&mut self, line: &StateLine, unix_ns: i64, tf: &Channel<FrameTransforms>) {
        let now = Instant::now();
        if self.sent.is_some_and(|sent| now.duration_since(sent) < STATE_PERIOD) {
            return;
        }
        self.sent = Some(now);
        if self.state.has_sinks() {
            match serde_json::to_vec(line) {
                Ok(json) => self.state.log_with_meta(&json, PartialMetadata::with_log_time(log_time(unix_ns))),
                Err(error) => tracing::error!("a state was not shown: it is no JSON: {error}"),
            }
        }
        let (Some([x, y, z]), Some([qx, qy, qz, qw])) = (line.position_m, line.rotation_xyzw) else { return };
        let (place, rotation) = (Vector3 { x, y, z }, Quaternion { x: qx, y: qy, z: qz, w: qw });
        if self.pose.has_sinks() {
            let pose = Pose { position: Some(place), orientation: Some(rotation) };
            let message = PoseInFrame { timestamp: timestamp(unix_ns), frame_id: "rig".to_owned(), pose: Some(pose) };
            self.pose.log_with_time(&message, log_time(unix_ns));
        }
        if tf.has_sinks() {
            let transform = FrameTransform {
                timestamp: timestamp(unix_ns),
                parent_frame_id: "rig".to_owned(),
                child_frame_id: TARGET.to_owned(),
                translation: Some(place),
                rotation: Some(rotation),
            };
            tf.log_with_time(&FrameTransforms { transforms: vec![transform] }, log_time(unix_ns));
        }
    }

    /// Shows the surface and its contour to whoever looks at them.
    pub(super) fn surface(&self, model: &ModelView<'_>, contour: Option<&ContourLine>) {
        if self.model.has_sinks() {
            self.model.log_with_time(&surface(model), log_time(model.unix.0));
        }
        if let Some(line) = contour.filter(|_| self.contour.has_sinks()) {
            self.contour.log_with_time(&edges(line, model.unix.0), log_time(model.unix.0));
        }
    }
}

/// At most [`VIEW_POINTS`] pieces of surface with their normals, target's frame.
fn surface(model: &ModelView<'_>) -> PointCloud {
    let mut data = Vec::with_capacity(SURFEL_BYTES * model.surfels.len().min(VIEW_POINTS));
    for (place, normal) in model.thinned_out(VIEW_POINTS) {
        for value in place.iter().chain(&normal) {
            data.extend_from_slice(&value.to_le_bytes());
        }
    }
    let names = ["x", "y", "z", "normal_x", "normal_y", "normal_z"];
    let field = |(name, offset): (&str, u32)| PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: NumericType::Float32 as i32,
    };
    PointCloud {
        timestamp: timestamp(model.unix.0),
        frame_id: TARGET.to_owned(),
        pose: Some(identity()),
        point_stride: SURFEL_BYTES as u32,
        fields: names.into_iter().zip((0..).step_by(4)).map(field).collect(),
        data: data.into(),
    }
}

/// The edges as two sets of lines that move with the target: creases, and where planes end.
fn edges(line: &ContourLine, unix_ns: i64) -> SceneUpdate {
    let lines = |kind: ContourKind, color: Color| LinePrimitive {
        r#type: line_primitive::Type::LineList as i32,
        pose: Some(identity()),
        thickness: 2.0,
        scale_invariant: true,
        points: line
            .edges
            .iter()
            .filter(|edge| edge.kind == kind)
            .flat_map(|edge| edge.ends_m)
            .map(|[x, y, z]| Point3 { x, y, z })
            .collect(),
        color: Some(color),
        colors: Vec::new(),
        indices: Vec::new(),
    };
    let entity = SceneEntity {
        timestamp: timestamp(unix_ns),
        frame_id: TARGET.to_owned(),
        // One of the same name takes its place.
        id: "contour".to_owned(),
        frame_locked: true,
        lines: vec![
            lines(ContourKind::Crease, Color { r: 1.0, g: 0.3, b: 0.7, a: 1.0 }),
            lines(ContourKind::End, Color { r: 0.6, g: 0.6, b: 0.7, a: 1.0 }),
        ],
        ..SceneEntity::default()
    };
    SceneUpdate { deletions: Vec::new(), entities: vec![entity] }
}

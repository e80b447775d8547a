//! The bridge itself.

use std::collections::BTreeMap;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::time::{Duration, Instant};

use foxglove::messages::{FrameTransforms, Log, PointCloud, RawImage};
use foxglove::{Channel, Context, Encode, PartialMetadata, RawChannel, Schema, WebSocketServerHandle};
use schemars::schema_for;
use serde::Serialize;
use tokio::runtime::{Builder, Runtime};
use tokio::time::timeout;

use super::messages::{depth_image, log_line, log_time, point_cloud, transforms};
use super::target::TargetChannels;
use super::{DepthView, FoxgloveConfig, FoxgloveError, SensorPose, ViewTotals};
use crate::stream::{CloudView, ContourLine, EventLine, HealthLine, Hello, ModelView, StateLine, StreamOrigin, reach};

/// Messages that wait for one viewer; the oldest is dropped. Six seconds of clouds of one sensor, 20 MB; images of a
/// Kinect alone would be 40 MB.
const BACKLOG: usize = 64;

/// Between two clouds of a sensor: more than a person sees is of no use.
const CLOUD_PERIOD: Duration = Duration::from_millis(100);

/// Between two images of a Kinect: 0.6 MB each.
const DEPTH_PERIOD: Duration = Duration::from_millis(200);

/// Between two messages on `/tf`: a viewer that connects later needs them too.
const TF_PERIOD: Duration = Duration::from_secs(1);

/// How long viewers may take to close.
const FAREWELL: Duration = Duration::from_secs(1);

/// A running bridge. Nothing here waits for a viewer: a cloud costs its copy, and nothing if nobody looks at it.
#[derive(Debug)]
pub struct FoxgloveBridge {
    runtime: Option<Runtime>,
    server: Option<WebSocketServerHandle>,
    address: SocketAddr,
    context: Arc<Context>,
    clouds: BTreeMap<String, Paced<PointCloud>>,
    depths: BTreeMap<String, Paced<RawImage>>,
    target: TargetChannels,
    tf: Channel<FrameTransforms>,
    tf_sent: Option<Instant>,
    health: Arc<RawChannel>,
    log: Channel<Log>,
    poses: Vec<SensorPose>,
    totals: ViewTotals,
}

/// A channel whose messages keep a distance.
#[derive(Debug)]
struct Paced<T: Encode> {
    channel: Channel<T>,
    period: Duration,
    sent: Option<Instant>,
}

impl FoxgloveBridge {
    /// Listens for viewers. `hello` gives the names they show; `poses`: how the sensors are mounted, one topic
    /// `/cloud/<id>` each.
    ///
    /// # Errors
    /// [`FoxgloveError`]: the address cannot be had, or must not be for these data.
    pub fn start(config: &FoxgloveConfig, hello: &Hello, poses: Vec<SensorPose>) -> Result<Self, FoxgloveError> {
        let asked = config.address;
        reach::check("the Foxglove bridge", asked, hello.origin, config.allow_nonlive)?;
        let start = |error: foxglove::FoxgloveError| FoxgloveError::Start(error.into());
        // Its own context: channels of other bridges in this process are none of ours.
        let context = Context::new();
        let tf = context.channel_builder("/tf").build();
        let log = context.channel_builder("/log").build();
        let health = context.channel_builder("/health").message_encoding("json").schema(health_schema());
        let health = health.build_raw().map_err(start)?;
        let target = TargetChannels::new(&context).map_err(start)?;
        let runtime = runtime().map_err(|error| FoxgloveError::Start(error.into()))?;
        let server = context
            .websocket_server()
            .name(title(hello))
            .session_id(hello.session.clone())
            .message_backlog_size(BACKLOG)
            .bind(host(asked.ip()), asked.port());
        let server = runtime.block_on(server.start()).map_err(|error| match error {
            foxglove::FoxgloveError::Bind(source) => FoxgloveError::Address { address: asked, source },
            other => start(other),
        })?;
        let address = SocketAddr::new(asked.ip(), server.port());
        tracing::info!(%address, origin = hello.origin.name(), "Foxglove bridge");
        let mut bridge = Self {
            runtime: Some(runtime),
            server: Some(server),
            address,
            context,
            clouds: BTreeMap::new(),
            depths: BTreeMap::new(),
            target,
            tf,
            tf_sent: None,
            health,
            log,
            poses,
            totals: ViewTotals::default(),
        };
        for sensor in bridge.poses.iter().map(|pose| pose.sensor.to_string()).collect::<Vec<_>>() {
            bridge.cloud_channel(&sensor);
        }
        Ok(bridge)
    }

    /// Where it listens, with the port that was chosen.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Whether a cloud of this sensor would be shown now: ask before making one.
    pub fn wants_cloud(&self, sensor: &str) -> bool {
        self.clouds.get(sensor).is_some_and(|cloud| cloud.channel.has_sinks() && cloud.is_due(Instant::now()))
    }

    /// Shows a cloud to the viewers that subscribed to it, thinned out to 10 a second and 20 000 points.
    pub fn cloud(&mut self, cloud: &CloudView<'_>) {
        let now = Instant::now();
        self.send_poses(cloud.unix.0, now);
        let shown = self.cloud_channel(cloud.sensor.as_str());
        if !shown.channel.has_sinks() {
            return;
        }
        if !shown.is_due(now) {
            self.totals.thinned_out += 1;
            return;
        }
        shown.sent = Some(now);
        shown.channel.log_with_time(&point_cloud(cloud), log_time(cloud.unix.0));
        self.totals.clouds += 1;
    }

    /// Shows a depth image to the viewers that subscribed to it, thinned out to 5 a second.
    pub fn depth(&mut self, depth: &DepthView<'_>) {
        let (now, context) = (Instant::now(), &self.context);
        let shown = self.depths.entry(depth.sensor.to_string()).or_insert_with_key(|sensor| Paced {
            channel: context.channel_builder(format!("/depth/{sensor}")).build(),
            period: DEPTH_PERIOD,
            sent: None,
        });
        if shown.channel.has_sinks() && shown.is_due(now) {
            shown.sent = Some(now);
            shown.channel.log_with_time(&depth_image(depth), log_time(depth.unix.0));
        }
    }

    /// Shows health: the line that the state stream sends. `unix_ns` is its time.
    pub fn health(&mut self, line: &impl Serialize, unix_ns: i64) {
        self.send_poses(unix_ns, Instant::now());
        if !self.health.has_sinks() {
            return;
        }
        match serde_json::to_vec(line) {
            Ok(json) => self.health.log_with_meta(&json, PartialMetadata::with_log_time(log_time(unix_ns))),
            Err(error) => tracing::error!("health was not shown: it is no JSON: {error}"),
        }
    }

    /// Shows where the target is, at most 20 times a second: the line that the state stream sends. `unix_ns` is its time.
    pub fn state(&mut self, line: &StateLine, unix_ns: i64) {
        self.target.state(line, unix_ns, &self.tf);
    }

    /// Whether anybody looks at the target's surface or its contour: ask before making them.
    pub fn wants_surface(&self) -> bool {
        self.target.want_surface()
    }

    /// Shows the target's surface, and its contour if there is one.
    pub fn surface(&self, model: &ModelView<'_>, contour: Option<&ContourLine>) {
        self.target.surface(model, contour);
    }

    /// Shows an event in the viewer's log.
    pub fn event(&mut self, event: &EventLine) {
        let unix_ns = event.unix_ns.parse().unwrap_or(0);
        self.log.log_with_time(&log_line(event), log_time(unix_ns));
    }

    /// What went to viewers since the start.
    pub fn totals(&self) -> ViewTotals {
        let viewers = self.server.as_ref().map_or(0, WebSocketServerHandle::client_count);
        ViewTotals { viewers, ..self.totals }
    }

    /// Closes every connection, within a second, and ends. Not to be called from an asynchronous task.
    pub fn stop(mut self) -> ViewTotals {
        let totals = self.totals();
        if let (Some(runtime), Some(server)) = (self.runtime.take(), self.server.take()) {
            // Whoever has not closed by then is closed with the runtime.
            runtime.block_on(async { timeout(FAREWELL, server.stop().wait()).await.unwrap_or_default() });
            runtime.shutdown_timeout(Duration::from_millis(200));
        }
        totals
    }

    fn cloud_channel(&mut self, sensor: &str) -> &mut Paced<PointCloud> {
        let context = &self.context;
        self.clouds.entry(sensor.to_owned()).or_insert_with(|| Paced {
            channel: context.channel_builder(format!("/cloud/{sensor}")).build(),
            period: CLOUD_PERIOD,
            sent: None,
        })
    }

    fn send_poses(&mut self, unix_ns: i64, now: Instant) {
        if self.tf_sent.is_none_or(|sent| now.duration_since(sent) >= TF_PERIOD) {
            self.tf_sent = Some(now);
            self.tf.log_with_time(&transforms(&self.poses, unix_ns), log_time(unix_ns));
        }
    }
}

impl Drop for FoxgloveBridge {
    fn drop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            // Dropping a runtime waits for it, which an asynchronous caller must not.
            runtime.shutdown_background();
        }
    }
}

impl<T: Encode> Paced<T> {
    fn is_due(&self, now: Instant) -> bool {
        self.sent.is_none_or(|sent| now.duration_since(sent) >= self.period)
    }
}

/// What the viewer shows as the name of the connection: nobody takes a rehearsal for a measurement.
fn title(hello: &Hello) -> String {
    let origin = match hello.origin {
        StreamOrigin::Live => "LIVE",
        StreamOrigin::Replay => "REPLAY",
        StreamOrigin::Simulated => "SIMULATED",
    };
    format!("tumbled {origin}: {}", hello.rig)
}

/// An address as the library puts a port behind it.
fn host(ip: IpAddr) -> String {
    match ip {
        IpAddr::V4(ip) => ip.to_string(),
        IpAddr::V6(ip) => format!("[{ip}]"),
    }
}

fn health_schema() -> Schema {
    let schema = schema_for!(HealthLine);
    Schema::new("tumbled.Health", "jsonschema", schema.as_value().to_string().into_bytes())
}

fn runtime() -> std::io::Result<Runtime> {
    Builder::new_multi_thread().worker_threads(1).thread_name("foxglove").enable_io().enable_time().build()
}

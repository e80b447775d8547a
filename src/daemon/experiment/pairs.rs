//! Pairs of clouds of one target: a Kinect's frame and a LiDAR's crossing, simulated to the byte and decoded, with the truth.

use std::sync::Arc;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use tumbled_core::register::{Cloud, DepthView, RangeView, SensorKind, View};
use tumbled_kinect::{
    BackProjector, DepthImage, DepthTable, HEIGHT, Intrinsics, NoiseModel, Points, WIDTH, ZeroPlane, decode_metres,
    without_flying,
};
use tumbled_model::{DepthEncoding, PacketMask, RigNs, Span, UnixNs};
use tumbled_sim::clock::SimClock;
use tumbled_sim::kinect::{KinectModel, KinectParameters};
use tumbled_sim::lidar::{Gps, Head, LidarConfig, LidarModel, LidarParameters, View as LidarSector};
use tumbled_sim::motion::Still;
use tumbled_sim::noise::Noise;
use tumbled_sim::target::TargetKind;
use tumbled_sim::world::{Body, Ray, Role, World};
use tumbled_velodyne::stream::{Decoded, Settings, StreamDecoder};
use tumbled_velodyne::{Model, ReturnMode};

use super::{organised, thin};

/// The LiDAR of the pairs, and how fast it turns.
const MODEL: Model = Model::Vlp32c;
const RPM: u32 = 600;
/// Half a crossing: 36° of a turn at 600 rpm, in which every beam passes the range image's span.
const HALF_CROSSING: Span = Span(10_000_000);
/// A head whose turn begins with the session comes to the target again after a turn.
const TURN: Span = Span(100_000_000);

/// Distances from the target's middle, m.
const KINECT_M: [f64; 2] = [1.3, 3.0];
const LIDAR_M: [f64; 2] = [1.8, 5.0];
/// How far beside the sight line's middle the target stands at most, m, along each axis.
const ASIDE_M: f64 = 0.1;
/// Draws until a pair is as asked for.
const ATTEMPTS: u64 = 400;
/// A frame has this many times the points asked for: voxels of a few points are what a rig would use.
const KINECT_SURPLUS: f64 = 1.3;
/// A point is in the overlap if the Kinect saw a surface within this of where it truly is, along z (issue 6), m.
const OVERLAP_M: f64 = 0.04;
/// A return farther than this from the surface its beam's middle meets is of an edge: it is taken where it was measured.
const EDGE_M: f64 = 0.1;

/// Points of the two clouds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct PointCounts {
    /// Of the Kinect's.
    pub kinect: usize,
    /// Of the LiDAR's.
    pub lidar: usize,
}

impl std::fmt::Display for PointCounts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.kinect, self.lidar)
    }
}

/// The attitudes of the target.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Attitudes {
    /// Any, evenly over all, and any roll of the LiDAR.
    #[default]
    Random,
    /// The published ones: 16 steps of 22.5° about x, then y, then z; the LiDAR beside the Kinect and upright.
    Views,
}

/// Attitudes of [`Attitudes::Views`].
pub const VIEWS: u64 = 48;

/// What pairs are asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairSpec {
    /// What is seen.
    pub target: TargetKind,
    /// How many points.
    pub points: PointCounts,
    /// The angle between the sensors' sights of the target, least and greatest, degrees.
    pub sights_deg: [f64; 2],
    /// The share of LiDAR points on what the Kinect sees, least and greatest.
    pub overlap: [f64; 2],
    /// How the target stands.
    pub attitudes: Attitudes,
    /// With the depth image and the range image beside the points.
    pub organised: bool,
}

/// A pair. The Kinect's cloud is registered onto the LiDAR's.
#[derive(Clone, Debug)]
pub struct Pair {
    /// Its number.
    pub index: u64,
    /// The Kinect's, in its own frame.
    pub moving: Cloud,
    /// The LiDAR's, in its own frame.
    pub reference: Cloud,
    /// Kinect to LiDAR. `None`: nobody knows.
    pub truth: Option<Isometry3<f64>>,
    /// The target in the Kinect's frame: what symmetric targets are judged by. `None`: unknown.
    pub body: Option<(TargetKind, Isometry3<f64>)>,
    /// The share of the LiDAR's points whose true position the Kinect sees within 4 cm. `None`: unknown.
    pub overlap: Option<f64>,
    /// Between the lines from the target to the sensors, degrees.
    pub sights_deg: Option<f64>,
}

/// Why there is no pair.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PairError {
    /// Nothing drawn was as asked for.
    #[error(
        "pair {index}: none of {ATTEMPTS} draws has {points} points with an overlap of {} to {} and sights {} to {} degrees \
        apart: widen them, or ask for fewer points", overlap[0], overlap[1], sights_deg[0], sights_deg[1]
    )]
    NotFound {
        /// The pair's number.
        index: u64,
        /// What was asked for.
        points: PointCounts,
        /// What was asked for.
        overlap: [f64; 2],
        /// What was asked for.
        sights_deg: [f64; 2],
    },
    /// Something of the simulator's or the decoders' that is refused: a fault of this program.
    #[error("{0}")]
    Sensor(Box<dyn std::error::Error + Send + Sync>),
}

/// A target that stands still at the world's origin, and a place for two sensors around it.
#[derive(Debug)]
pub struct Stand {
    kind: TargetKind,
    world: World,
    middle: Vector3<f64>,
    table: DepthTable,
    projector: BackProjector,
    camera: Intrinsics,
}

/// What the sensors measured, before it is thinned.
struct Measured {
    lidar: tumbled_velodyne::Points,
    has_heights: bool,
}

impl Stand {
    /// Prepares a target: its surface's tree, the camera's rays.
    ///
    /// # Errors
    /// [`PairError::Sensor`].
    pub fn new(kind: TargetKind) -> Result<Self, PairError> {
        let mesh = kind.mesh();
        let [low, high] = mesh.extents();
        let middle = Vector3::from([0, 1, 2].map(|axis| 0.5 * (low[axis] + high[axis])));
        let motion = Arc::new(Still(Isometry3::identity()));
        let world = World::new(vec![Body { role: Role::Target, mesh: Arc::new(mesh), motion }]);
        let camera = Intrinsics::default();
        let projector = BackProjector::new(&camera, &NoiseModel::default()).map_err(sensor)?;
        let table = DepthTable::from_law(&ZeroPlane::default());
        Ok(Self { kind, world, middle, table, projector, camera })
    }

    /// The `index`-th pair of a seed: always the same, whichever were made before.
    ///
    /// # Errors
    /// [`PairError`]: nothing is as asked for, or this program's sensors fail.
    pub fn pair(&self, spec: &PairSpec, seed: u64, index: u64) -> Result<Pair, PairError> {
        for attempt in 0..ATTEMPTS {
            let mut noise = Noise::new(seed, "pair", index.wrapping_mul(ATTEMPTS).wrapping_add(attempt));
            if let Some(pair) = self.attempt(spec, index, &mut noise)? {
                return Ok(pair);
            }
        }
        let (points, overlap, sights_deg) = (spec.points, spec.overlap, spec.sights_deg);
        Err(PairError::NotFound { index, points, overlap, sights_deg })
    }

    fn attempt(&self, spec: &PairSpec, index: u64, noise: &mut Noise) -> Result<Option<Pair>, PairError> {
        let placed = self.place(spec, index, noise);
        // Every pair has sensors of its own: biases and warp are drawn anew.
        let device = noise.bits();
        // Its points are few and quickly made: most draws that are not as asked for end here.
        let measured = self.scan(&placed.t_body_lidar, device)?;
        let returns = &measured.lidar;
        if returns.len() < spec.points.lidar {
            return Ok(None);
        }
        let points: Vec<Point3<f32>> =
            returns.x.iter().zip(&returns.y).zip(&returns.z).map(|((x, y), z)| Point3::new(*x, *y, *z)).collect();
        let lidar = thin::picked(&points, spec.points.lidar, noise);
        let depth = self.frame(&placed.t_body_kinect, device)?;
        let overlap = self.overlap(&placed, &lidar, &depth);
        let [least, greatest] = spec.overlap;
        if !(least..=greatest).contains(&overlap) {
            return Ok(None);
        }
        let (mut seen, mut clean) = (Points::new(), DepthImage::new());
        without_flying(&depth, &mut clean);
        self.projector.points(&clean, &mut seen);
        if (seen.len() as f64) < KINECT_SURPLUS * spec.points.kinect as f64 {
            return Ok(None);
        }
        let points: Vec<Point3<f32>> =
            seen.x().iter().zip(seen.y()).zip(seen.z()).map(|((x, y), z)| Point3::new(*x, *y, *z)).collect();
        let kinect = thin::voxelised(&points, spec.points.kinect, noise);
        let views = spec.organised.then(|| self.views(&placed, &depth, &measured)).flatten();
        let (depth_view, range_view) =
            views.map_or((View::Bare, View::Bare), |(depth, ranges)| (View::Depth(depth), View::Ranges(ranges)));
        let cloud = |sensor, points, view| Cloud { sensor, points, viewpoint: Some(Point3::origin()), view };
        Ok(Some(Pair {
            index,
            moving: cloud(SensorKind::Kinect, kinect, depth_view),
            reference: cloud(SensorKind::Lidar, lidar, range_view),
            truth: Some(placed.t_body_lidar.inverse() * placed.t_body_kinect),
            body: Some((self.kind, placed.t_body_kinect.inverse())),
            overlap: Some(overlap),
            sights_deg: Some(placed.sights_deg(&self.middle)),
        }))
    }

    /// Where the sensors are: the Kinect looks along +x of a rig whose origin is the target's middle, the LiDAR is swung
    /// about it by the angle between the sights, and the target is turned.
    fn place(&self, spec: &PairSpec, index: u64, noise: &mut Noise) -> Placed {
        let mut between = |[low, high]: [f64; 2]| low + (high - low) * noise.uniform();
        let (kinect_m, lidar_m, sights) = (between(KINECT_M), between(LIDAR_M), between(spec.sights_deg).to_radians());
        let turn = core::f64::consts::TAU;
        let mut aside = || Vector3::new(0.0, between([-ASIDE_M, ASIDE_M]), between([-ASIDE_M, ASIDE_M]));
        let (kinect_aside, lidar_aside) = (aside(), aside());
        let (attitude, swing, rolls) = match spec.attitudes {
            Attitudes::Random => {
                let swing = between([0.0, turn]);
                let rolls = [between([0.0, turn]), between([0.0, turn])];
                (random_rotation(noise), swing, rolls)
            }
            // The LiDAR beside the Kinect.
            Attitudes::Views => (view(index), 0.0, [0.0, 0.0]),
        };
        let about = |axis: Vector3<f64>, angle: f64| UnitQuaternion::from_scaled_axis(axis * angle);
        let optical = UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(0.5, -0.5, 0.5, -0.5));
        let kinect = Isometry3::from_parts(
            Translation3::from(Vector3::new(-kinect_m, 0.0, 0.0) + kinect_aside),
            optical * about(Vector3::z(), rolls[0]),
        );
        let lidar = Isometry3::from_parts(
            Translation3::from(Vector3::new(-lidar_m, 0.0, 0.0) + lidar_aside),
            about(Vector3::x(), rolls[1]),
        );
        // About an axis across the sight; z where the LiDAR stands beside the Kinect.
        let axis = about(Vector3::x(), swing) * Vector3::z();
        let swung = Isometry3::from_parts(Translation3::identity(), about(axis, sights)) * lidar;
        let t_rig_body = Isometry3::from_parts(Translation3::from(-(attitude * self.middle)), attitude);
        let t_body_rig = t_rig_body.inverse();
        Placed { t_body_kinect: t_body_rig * kinect, t_body_lidar: t_body_rig * swung }
    }

    fn scan(&self, t_body_lidar: &Isometry3<f64>, device: u64) -> Result<Measured, PairError> {
        let config = LidarConfig {
            id: "lidar".to_owned(),
            head: Head::BuiltIn(MODEL),
            mode: ReturnMode::Strongest,
            rpm: RPM,
            start_azimuth_deg: 0.0,
            view: LidarSector::default(),
            vertical_offsets: None,
            t_rig_lidar: *t_body_lidar,
            clock: SimClock::default(),
            gps: Gps::default(),
            position_every: TURN,
            unix_at_zero: UnixNs(0),
            parameters: LidarParameters::default(),
        };
        let head = LidarModel::new(config).map_err(sensor)?;
        let mut decoder = StreamDecoder::new(Settings { model: Some(MODEL), ..Settings::default() });
        let mut decoded = Decoded::default();
        let ahead = RigNs(TURN.0);
        for index in head.first_packet_at(ahead - HALF_CROSSING)..head.first_packet_at(ahead + HALF_CROSSING) {
            let packet = head.packet(&self.world, index, device);
            if let Some(rejection) = decoder.push(&packet.bytes, packet.end, &mut decoded) {
                return Err(PairError::Sensor(format!("a simulated packet is refused: {rejection:?}").into()));
            }
        }
        decoder.finish(&mut decoded);
        Ok(Measured { lidar: decoded.points, has_heights: decoder.vertical_offsets().unwrap_or(false) })
    }

    fn frame(&self, t_body_kinect: &Isometry3<f64>, device: u64) -> Result<DepthImage, PairError> {
        let parameters = KinectParameters::default();
        let camera = KinectModel::new("kinect", &self.camera, *t_body_kinect, parameters).map_err(sensor)?;
        let bytes = camera.frame(&self.world, RigNs(0), 0, device).packed().map_err(sensor)?;
        let mut depth = DepthImage::new();
        decode_metres(DepthEncoding::Packed11, &bytes, &PacketMask::NONE, &self.table, &mut depth).map_err(sensor)?;
        Ok(depth)
    }

    /// The share of LiDAR points whose true position is seen by the Kinect.
    fn overlap(&self, placed: &Placed, lidar: &[Point3<f32>], depth: &DepthImage) -> f64 {
        let world = self.world.at(RigNs(0));
        let origin = placed.t_body_lidar * Point3::origin();
        let t_kinect_body = placed.t_body_kinect.inverse();
        let seen = |point: &&Point3<f32>| {
            let measured = placed.t_body_lidar * point.cast::<f64>();
            let way = measured - origin;
            let ray = Ray { origin, direction: way.normalize() };
            let hit = world.cast(&ray, 0.0).filter(|hit| (hit.range_m - way.norm()).abs() < EDGE_M);
            let place = hit.map_or(measured, |hit| origin + ray.direction * hit.range_m);
            self.depth_at(&(t_kinect_body * place), depth).is_some_and(|beside_m| beside_m.abs() < OVERLAP_M)
        };
        lidar.iter().filter(seen).count() as f64 / lidar.len().max(1) as f64
    }

    /// By how much the surface seen in a place's direction is farther than the place, along z, m; `None`: nothing is seen.
    fn depth_at(&self, place: &Point3<f64>, depth: &DepthImage) -> Option<f64> {
        if place.z <= 0.0 {
            return None;
        }
        let (u, v) = self.camera.pixel(place.x / place.z, place.y / place.z);
        let (column, row) = (u.round(), v.round());
        let inside = (0.0..WIDTH as f64).contains(&column) && (0.0..HEIGHT as f64).contains(&row);
        let pixel = inside.then(|| row as usize * WIDTH + column as usize)?;
        let z = f64::from(*depth.pixels().get(pixel)?);
        (z > 0.0).then_some(z - place.z)
    }

    fn views(&self, placed: &Placed, depth: &DepthImage, measured: &Measured) -> Option<(DepthView, RangeView)> {
        let spec = MODEL.spec()?;
        // Degrees a second, by the seconds from firing to firing.
        let step_deg = f64::from(RPM) * 6.0 * 1e-9 * f64::from(spec.cycle_ns);
        let range_m = (placed.t_body_lidar.translation.vector - self.middle).norm();
        let ranges = organised::range_view(&measured.lidar, spec, measured.has_heights, step_deg, range_m);
        Some((organised::depth_view(depth, &self.camera), ranges))
    }
}

/// Two sensors around the target.
struct Placed {
    t_body_kinect: Isometry3<f64>,
    t_body_lidar: Isometry3<f64>,
}

impl Placed {
    fn sights_deg(&self, middle: &Vector3<f64>) -> f64 {
        let from = |sensor: &Isometry3<f64>| sensor.translation.vector - middle;
        from(&self.t_body_kinect).angle(&from(&self.t_body_lidar)).to_degrees()
    }
}

fn sensor(error: impl std::error::Error + Send + Sync + 'static) -> PairError {
    PairError::Sensor(Box::new(error))
}

/// Evenly over all rotations (Shoemake): four normal numbers, made a unit quaternion.
fn random_rotation(noise: &mut Noise) -> UnitQuaternion<f64> {
    let mut number = || noise.normal();
    let quaternion = nalgebra::Quaternion::new(number(), number(), number(), number());
    UnitQuaternion::try_new(quaternion, 1e-9).unwrap_or_default()
}

/// The `index`-th published attitude; they repeat.
fn view(index: u64) -> UnitQuaternion<f64> {
    let n = index % VIEWS;
    let axis = match n / 16 {
        0 => Vector3::x(),
        1 => Vector3::y(),
        _ => Vector3::z(),
    };
    UnitQuaternion::from_scaled_axis(axis * (22.5 * (n % 16) as f64).to_radians())
}

#[cfg(test)]
mod tests;

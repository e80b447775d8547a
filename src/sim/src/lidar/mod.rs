//! Simulated Velodynes: every beam cast at its own firing time, encoded as the sensor would.
//!
//! ```text
//!   schedule ─ when, head ─┐
//!   beams ─ laser, lens ───┴─▶ ray ─▶ world ─▶ echo ─ returns ─▶ noise ─▶ counts ─▶ packet
//!                                    surface ───┘
//! ```
//!
//! Any packet is made by its number alone, so packets may be made in any order and on any thread. The footprint is
//! cast as five rays where a body's bounding sphere is met and as one elsewhere (inside a room: walls have no edges
//! that matter). Features narrower than the footprint's rays stand apart (about 1 mrad) can fall between them.

mod beams;
mod echo;
mod position;
mod schedule;
mod surface;

pub use beams::made_calibration;
pub use position::Gps;
pub use schedule::View;
pub use surface::{Surface, Surfaces};

use crate::clock::SimClock;
use crate::noise::Noise;
use crate::world::{Ray, Snapshot, World};
use beams::{Beam, Beams};
use bytes::Bytes;
use core::f64::consts::{PI, TAU};
use echo::{Echo, RING, Receiver, Returns};
use nalgebra::{Isometry3, Point3, Vector3};
use schedule::{GROUPS, Group, Schedule};
use serde::{Deserialize, Serialize};
use tumbled_model::{CivilTime, RigNs, Span, UnixNs};
use tumbled_velodyne::encode::{self, DataPacketBuilder};
use tumbled_velodyne::hdl64::encode::{Said, Slot};
use tumbled_velodyne::hdl64::{Calibration, Generation, Hdl64Encoder, LASERS, Unit};
use tumbled_velodyne::wire::{BLOCKS, SLOTS};
use tumbled_velodyne::{Model, ReturnMode};

/// A body nearer than this to the sensor's centre is its own housing, m.
const HOUSING_M: f64 = 0.06;

/// Added to bounding spheres: bodies move while a group fires (10 m/s for 0.1 ms), and sums round. Metres.
const SPHERE_SLACK_M: f64 = 0.005;

/// Bodies that a group is tried against one by one; in a world of more every beam is cast.
const MAX_SPHERES: usize = 32;

/// A sensor's settings.
#[derive(Clone, Debug)]
pub struct LidarConfig {
    /// Its name: streams of random numbers go by it.
    pub id: String,
    /// Which sensor.
    pub head: Head,
    /// Which returns it reports.
    pub mode: ReturnMode,
    /// Turns a minute of its own clock, 1..=1200 (real ones: 300, 600, 1200).
    pub rpm: u32,
    /// Where the head points at the session's start, degrees clockwise from above.
    pub start_azimuth_deg: f64,
    /// What it looks at.
    pub view: View,
    /// Whether beams leave at the heights that their elevations tell; `None`: as the decoder takes it for the model.
    pub vertical_offsets: Option<bool>,
    /// Its frame into the rig's: x forward at azimuth 0, y left, z up.
    pub t_rig_lidar: Isometry3<f64>,
    /// Its clock.
    pub clock: SimClock,
    /// What it has of GPS.
    pub gps: Gps,
    /// From one position packet to the next, by its own clock; real ones send 40 to 280 a second.
    pub position_every: Span,
    /// UTC at the session's start, for sentences.
    pub unix_at_zero: UnixNs,
    /// How well it measures.
    pub parameters: LidarParameters,
}

/// Which sensor.
#[derive(Clone, Debug)]
pub enum Head {
    /// A model whose geometry is built in.
    BuiltIn(Model),
    /// An HDL-64E S2 or S3 with its factory calibration.
    Hdl64e {
        /// S2 or S3.
        generation: Generation,
        /// Its lasers; [`made_calibration`] has some.
        calibration: Box<Calibration>,
    },
}

/// How well a sensor measures.
///
/// Ranges: data sheets say ±30 mm (VLP-32C, typical) of one beam; the split into white noise and a beam's own bias is
/// that of the accuracy scenes. Footprint: 3 mrad. Encoder: block azimuths of real captures scatter by ±0.02°, taken as
/// three standard deviations. Pulse: returns closer than about a metre are not told apart (dual return, VLP manuals).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct LidarParameters {
    /// Standard deviation of a single range, m.
    pub range_sigma_m: f64,
    /// Standard deviation of the beams' biases, m; each beam's is fixed for a seed.
    pub beam_bias_sigma_m: f64,
    /// Whole width of a beam, mrad; 0: a line.
    pub footprint_mrad: f64,
    /// Returns closer together than this become one, m.
    pub pulse_m: f64,
    /// Standard deviation of a block's azimuth reading, degrees.
    pub encoder_sigma_deg: f64,
    /// Standard deviation of the reflectivity, counts of 255.
    pub intensity_sigma: f64,
    /// The materials.
    pub surfaces: Surfaces,
}

impl Default for LidarParameters {
    fn default() -> Self {
        Self {
            range_sigma_m: 0.015,
            beam_bias_sigma_m: 0.010,
            footprint_mrad: 3.0,
            pulse_m: 0.9,
            encoder_sigma_deg: 0.007,
            intensity_sigma: 2.0,
            surfaces: Surfaces::default(),
        }
    }
}

/// Settings no sensor has.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum LidarError {
    /// A model without built-in geometry.
    #[error("an HDL-64E has no built-in geometry: give it a generation and a calibration")]
    NoCalibration,
    /// A generation that is not simulated in this mode.
    #[error("HDL-64E {generation:?} in {mode} return is not simulated: S2 has single return, S3 single and dual")]
    Generation {
        /// The generation asked for.
        generation: Generation,
        /// The mode asked for.
        mode: ReturnMode,
    },
    /// A speed outside 1..=1200.
    #[error("{0} rpm: 1 to 1200 expected")]
    Speed(u32),
    /// A sector that ends before it begins, or is no part of a turn.
    #[error("view from {from_deg}° to {to_deg}°: more than 0° and less than 360° clockwise expected")]
    View {
        /// Its beginning.
        from_deg: f64,
        /// Its end.
        to_deg: f64,
    },
    /// A number that is not finite or is negative where it cannot be.
    #[error("{name} is {found}: a finite number of at least 0 expected")]
    Number {
        /// Which setting.
        name: &'static str,
        /// What it is.
        found: f64,
    },
}

/// A packet.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Packet {
    /// The true time of its first firing.
    pub t: RigNs,
    /// The true time of its last firing: it leaves the sensor then.
    pub end: RigNs,
    /// The payload.
    pub bytes: Bytes,
}

/// A simulated Velodyne.
#[derive(Clone, Debug)]
pub struct LidarModel {
    config: LidarConfig,
    schedule: Schedule,
    beams: Beams,
    /// An HDL-64E's packets, at the start of its status cycle.
    hdl64: Option<Hdl64Encoder>,
    limits_m: (f64, f64),
    noise_name: String,
    encoder_name: String,
    bias_name: String,
}

impl LidarModel {
    /// A sensor with these settings.
    ///
    /// # Errors
    /// [`LidarError`]: settings no sensor has.
    pub fn new(config: LidarConfig) -> Result<Self, LidarError> {
        check(&config)?;
        let beams = Beams::new(&config.head, config.mode, config.vertical_offsets)?;
        let schedule = Schedule::new(config.rpm, beams.group_ns, beams.groups, config.start_azimuth_deg, config.view);
        let hdl64 = match &config.head {
            Head::BuiltIn(_) => None,
            Head::Hdl64e { generation, calibration } => {
                let unit = Unit {
                    rpm: config.rpm as i16,
                    return_mode: match config.mode {
                        ReturnMode::Strongest => 0,
                        ReturnMode::Last => 1,
                        ReturnMode::Dual => 2,
                    },
                    ..Unit::default()
                };
                Some(Hdl64Encoder::new(*generation, calibration, &unit))
            }
        };
        let (min, max) = config.model().range_limits_m();
        Ok(Self {
            schedule,
            beams,
            hdl64,
            limits_m: (f64::from(min), f64::from(max)),
            noise_name: format!("lidar.{}.return", config.id),
            encoder_name: format!("lidar.{}.encoder", config.id),
            bias_name: format!("lidar.{}.bias", config.id),
            config,
        })
    }

    /// Its settings.
    pub fn config(&self) -> &LidarConfig {
        &self.config
    }

    /// A data packet: the `index`-th since the session's start, for its first 60 days.
    pub fn packet(&self, world: &World, index: u64, seed: u64) -> Packet {
        let groups = self.schedule.packet(index);
        let groups = groups.get(..self.schedule.groups()).unwrap_or_default();
        let mut noise = Noise::new(seed, &self.noise_name, index);
        let mut biases = None;
        let mut slots = [[[Sent::default(); LASERS]; 2]; GROUPS];
        for (group, slots) in groups.iter().zip(slots.iter_mut()) {
            self.fire(world, group, &mut noise, |beam, head_rad, returns, noise| {
                let biases = biases.get_or_insert_with(|| self.biases(seed));
                let bias_m = biases.get(usize::from(beam.1.laser)).copied().unwrap_or(0.0);
                let sent = self.measure(&beam.1, head_rad, returns, bias_m, noise);
                for (block, sent) in slots.iter_mut().zip(sent) {
                    if let Some(slot) = block.get_mut(beam.0) {
                        *slot = sent;
                    }
                }
            });
        }
        let first_ns = groups.first().map_or(0, |group| group.oscillator_ns);
        let last_ns = groups.last().map_or(0, |group| group.oscillator_ns) + i64::from(self.beams.last_ns());
        let (t, end) = (self.config.clock.instant(first_ns), self.config.clock.instant(last_ns));
        let azimuths = self.azimuths(groups, index, seed);
        let bytes = match &self.hdl64 {
            None => self.encode(t, &azimuths, &slots),
            Some(encoder) => self.encode_hdl64(encoder, t, index, &azimuths, &slots),
        };
        Packet { t, end, bytes }
    }

    /// The number of the first packet that begins at or after an instant.
    pub fn first_packet_at(&self, t: RigNs) -> u64 {
        let (mut low, mut high) = (0u64, 1u64);
        let begins = |index: u64| self.config.clock.instant(self.first_firing_ns(index));
        while begins(high) < t && high < 1 << 33 {
            (low, high) = (high, high * 2);
        }
        while low < high {
            let middle = low + (high - low) / 2;
            if begins(middle) >= t { high = middle } else { low = middle + 1 }
        }
        low
    }

    fn first_firing_ns(&self, index: u64) -> i64 {
        self.schedule.packet(index).first().map_or(0, |group| group.oscillator_ns)
    }

    /// The biases of the beams, m: the same for every packet of a seed.
    pub fn biases(&self, seed: u64) -> [f64; LASERS] {
        let mut noise = Noise::new(seed, &self.bias_name, 0);
        core::array::from_fn(|_| noise.normal() * self.config.parameters.beam_bias_sigma_m)
    }

    /// Casts the beams of a group that can meet anything, and hands on what has a return: the beam with its place, where
    /// the head pointed, the returns.
    fn fire(
        &self,
        world: &World,
        group: &Group,
        noise: &mut Noise,
        mut met: impl FnMut((usize, Beam), f64, Returns, &mut Noise),
    ) {
        let parameters = &self.config.parameters;
        let t = self.config.clock.instant(group.oscillator_ns);
        let head_rad = group.turns * TAU;
        let turn_rad_per_ns = self.schedule.turns_per_ns() * TAU;
        let footprint_rad = 0.5e-3 * parameters.footprint_mrad;
        let sight =
            Sight::of(world, t, &self.config.t_rig_lidar, &self.beams, head_rad, footprint_rad, turn_rad_per_ns);
        if !sight.inside && sight.count == 0 {
            return;
        }
        let receiver = Receiver { surfaces: &parameters.surfaces, pulse_m: parameters.pulse_m };
        let (sin_head, cos_head) = libm::sincos(head_rad);
        let mut snapshot: Option<(i32, Snapshot<'_>)> = None;
        for (place, beam) in self.beams.beams.iter().enumerate() {
            let turned = turn_rad_per_ns * f64::from(beam.dt_ns);
            let aim = Aim::new(beam, sin_head, cos_head, turned);
            let near = sight.meets(&aim, footprint_rad);
            if !near && !sight.inside {
                continue;
            }
            let world = match snapshot.take() {
                Some((dt_ns, snapshot)) if dt_ns == beam.dt_ns => snapshot,
                _ => world.at(t + Span(i64::from(beam.dt_ns))),
            };
            let ray = Ray {
                origin: self.config.t_rig_lidar * aim.origin,
                direction: self.config.t_rig_lidar * aim.direction,
            };
            let returns = if near && footprint_rad > 0.0 {
                let across = aim.across(footprint_rad * RING).map(|offset| self.config.t_rig_lidar * offset);
                receiver.fan(&world, &ray, across, HOUSING_M, noise)
            } else {
                receiver.single(world.cast(&ray, HOUSING_M), &ray, noise)
            };
            snapshot = Some((beam.dt_ns, world));
            if returns.strongest.is_some() {
                met((place, *beam), head_rad + turned, returns, noise);
            }
        }
    }

    /// What the sensor says of a firing's returns: for its one block, or for the two of dual return.
    fn measure(&self, beam: &Beam, head_rad: f64, returns: Returns, bias_m: f64, noise: &mut Noise) -> [Sent; 2] {
        let mut sent = |echo: Option<Echo>| {
            let Some(echo) = echo else { return Sent::default() };
            let parameters = &self.config.parameters;
            let range_m = echo.range_m + bias_m + parameters.range_sigma_m * noise.normal();
            let intensity = 100.0 * echo.brightness + parameters.intensity_sigma * noise.normal();
            let (min, max) = self.limits_m;
            if !(min..=max).contains(&range_m) {
                return Sent::default();
            }
            let raw = self.beams.raw(beam.laser, head_rad, range_m);
            Sent { raw, intensity: if raw == 0 { 0 } else { libm::round(intensity).clamp(0.0, 255.0) as u8 } }
        };
        match self.config.mode {
            ReturnMode::Strongest => [sent(returns.strongest), Sent::default()],
            ReturnMode::Last => [sent(returns.last), Sent::default()],
            ReturnMode::Dual => {
                let last = sent(returns.last);
                // One return is measured once and sent twice.
                [last, if returns.beside == returns.last { last } else { sent(returns.beside) }]
            }
        }
    }

    /// The azimuths as the encoder reads them, 0.01°, one a group.
    fn azimuths(&self, groups: &[Group], index: u64, seed: u64) -> [u16; GROUPS] {
        let mut noise = Noise::new(seed, &self.encoder_name, index);
        let sigma = self.config.parameters.encoder_sigma_deg * 100.0;
        let mut azimuths = [0; GROUPS];
        for (azimuth, group) in azimuths.iter_mut().zip(groups) {
            let off = if sigma > 0.0 { (sigma * noise.normal()).clamp(-3.0 * sigma, 3.0 * sigma) } else { 0.0 };
            let cdeg = libm::round(group.turns * 36_000.0 + off) as i64;
            *azimuth = cdeg.rem_euclid(36_000) as u16;
        }
        azimuths
    }

    fn encode(&self, t: RigNs, azimuths: &[u16; GROUPS], slots: &Slots) -> Bytes {
        let mut packet = DataPacketBuilder::new(self.config.model(), self.config.mode);
        packet.stamp(self.config.clock.lidar(t));
        let blocks = self.config.mode.blocks_per_firing();
        for block in 0..BLOCKS {
            let sent = slots.get(block / blocks).and_then(|group| group.get(block % blocks));
            let content: [encode::Slot; SLOTS] = core::array::from_fn(|slot| {
                let sent = sent.and_then(|sent| sent.get(slot)).copied().unwrap_or_default();
                (sent.raw, sent.intensity)
            });
            packet.block(block, azimuths.get(block / blocks).copied().unwrap_or(0), &content);
        }
        Bytes::copy_from_slice(&packet.build())
    }

    fn encode_hdl64(
        &self,
        encoder: &Hdl64Encoder,
        t: RigNs,
        index: u64,
        azimuths: &[u16; GROUPS],
        slots: &Slots,
    ) -> Bytes {
        let mut encoder = encoder.clone();
        encoder.skip(index as usize);
        // Blocks of a group: upper and lower bank, in dual return both once more.
        let blocks = 2 * self.config.mode.blocks_per_firing();
        let azimuths = core::array::from_fn(|block| azimuths.get(block / blocks).copied().unwrap_or(0));
        let content = core::array::from_fn(|block| {
            let (group, within) = (block / blocks, block % blocks);
            core::array::from_fn(|slot| {
                let sent = slots.get(group).and_then(|group| group.get(within / 2));
                let sent = sent.and_then(|sent| sent.get(within % 2 * SLOTS + slot)).copied().unwrap_or_default();
                Slot { raw: sent.raw, intensity: sent.intensity }
            })
        });
        let time = CivilTime::from_unix(UnixNs(self.config.unix_at_zero.0.saturating_add(t.0)));
        let gps = if self.config.gps == Gps::None { 0 } else { b'A' };
        let said = Said { time, gps, temperature_c: 40, firmware: 7, warnings: 0 };
        Bytes::copy_from_slice(&encoder.encode(self.config.clock.lidar(t), &azimuths, &content, &said))
    }
}

impl LidarConfig {
    /// The model.
    pub fn model(&self) -> Model {
        match &self.head {
            Head::BuiltIn(model) => *model,
            Head::Hdl64e { .. } => Model::Hdl64e,
        }
    }
}

/// One slot of a packet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Sent {
    raw: u16,
    intensity: u8,
}

/// By group, return and place.
type Slots = [[[Sent; LASERS]; 2]; GROUPS];

/// Where a beam leaves and looks, lidar frame.
#[derive(Clone, Copy, Debug)]
struct Aim {
    origin: Point3<f64>,
    direction: Vector3<f64>,
    /// Level, to the left of the direction.
    left: Vector3<f64>,
}

impl Aim {
    fn new(beam: &Beam, sin_head: f64, cos_head: f64, turned: f64) -> Self {
        let (sin_turn, cos_turn) = libm::sincos(turned);
        let sin_rest = beam.sin_offset * cos_turn + beam.cos_offset * sin_turn;
        let cos_rest = beam.cos_offset * cos_turn - beam.sin_offset * sin_turn;
        let sin = sin_head * cos_rest + cos_head * sin_rest;
        let cos = cos_head * cos_rest - sin_head * sin_rest;
        let left = Vector3::new(sin, cos, 0.0);
        Self {
            origin: Point3::from(left * beam.left_m + Vector3::z() * beam.height_m),
            direction: Vector3::new(beam.cos_elevation * cos, -beam.cos_elevation * sin, beam.sin_elevation),
            left,
        }
    }

    /// The offsets to the side and up that a ray `apart_rad` from the middle has.
    fn across(&self, apart_rad: f64) -> [Vector3<f64>; 2] {
        [self.left * apart_rad, self.direction.cross(&self.left) * apart_rad]
    }
}

/// The bodies that a group's beams can meet, as bounding spheres in the lidar frame.
struct Sight {
    spheres: [(Point3<f64>, f64); MAX_SPHERES],
    count: usize,
    /// The sensor stands inside a body's sphere: every beam can meet it.
    inside: bool,
}

impl Sight {
    fn of(
        world: &World,
        t: RigNs,
        t_rig_lidar: &Isometry3<f64>,
        beams: &Beams,
        head_rad: f64,
        footprint_rad: f64,
        turn_rad_per_ns: f64,
    ) -> Self {
        let mut sight = Self { spheres: [(Point3::origin(), 0.0); MAX_SPHERES], count: 0, inside: false };
        // Beams of this group point at most so far from where the head points.
        let half_turn_rad = 0.5 * turn_rad_per_ns * f64::from(beams.last_ns());
        let middle_rad = head_rad + half_turn_rad;
        let wide_rad = beams.widest_rad + half_turn_rad + footprint_rad;
        for sphere in world.at(t).spheres() {
            let centre = t_rig_lidar.inverse_transform_point(&sphere.centre);
            let radius = sphere.radius_m + SPHERE_SLACK_M;
            let level_m = (centre.x * centre.x + centre.y * centre.y).sqrt();
            let reach_m = radius + beams.reach_m;
            if centre.coords.norm() <= reach_m {
                sight.inside = true;
                continue;
            }
            // A sphere that stands over or under the sensor is at every azimuth.
            if level_m > reach_m {
                let away = libm::atan2(-centre.y, centre.x) - middle_rad;
                let away = (away - TAU * libm::round(away / TAU)).abs();
                if away > (wide_rad + libm::asin(reach_m / level_m)).min(PI) {
                    continue;
                }
            }
            match sight.spheres.get_mut(sight.count) {
                Some(place) => {
                    *place = (centre, radius);
                    sight.count += 1;
                }
                None => sight.inside = true,
            }
        }
        sight
    }

    /// Whether a beam passes through one of the spheres.
    fn meets(&self, aim: &Aim, footprint_rad: f64) -> bool {
        self.spheres.iter().take(self.count).any(|(centre, radius)| {
            let from = centre - aim.origin;
            let along = from.dot(&aim.direction);
            let radius = radius + footprint_rad * along.max(0.0);
            along > -radius && from.norm_squared() - along * along <= radius * radius
        })
    }
}

fn check(config: &LidarConfig) -> Result<(), LidarError> {
    if !(1..=1_200).contains(&config.rpm) {
        return Err(LidarError::Speed(config.rpm));
    }
    if let View::Sector { from_deg, to_deg } = config.view {
        let width = to_deg - from_deg;
        let a_part = width > 0.0 && width < 360.0 && from_deg.is_finite();
        if !a_part {
            return Err(LidarError::View { from_deg, to_deg });
        }
    }
    let parameters = &config.parameters;
    for (name, found) in [
        ("range_sigma_m", parameters.range_sigma_m),
        ("beam_bias_sigma_m", parameters.beam_bias_sigma_m),
        ("footprint_mrad", parameters.footprint_mrad),
        ("pulse_m", parameters.pulse_m),
        ("encoder_sigma_deg", parameters.encoder_sigma_deg),
        ("intensity_sigma", parameters.intensity_sigma),
    ] {
        if !found.is_finite() || found < 0.0 {
            return Err(LidarError::Number { name, found });
        }
    }
    if !config.start_azimuth_deg.is_finite() {
        return Err(LidarError::Number { name: "start_azimuth_deg", found: config.start_azimuth_deg });
    }
    Ok(())
}

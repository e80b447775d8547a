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
mod config;
mod echo;
mod position;
mod schedule;
mod sight;
mod surface;

pub use beams::{made_calibration, made_calibration_of};
pub use config::{Head, LidarConfig, LidarError, LidarParameters};
pub use position::Gps;
pub use schedule::View;
pub use surface::{Surface, Surfaces};

use crate::noise::Noise;
use crate::world::{Ray, Snapshot, World};
use beams::{Beam, Beams};
use bytes::Bytes;
use core::f64::consts::TAU;
use echo::{Echo, RING, Receiver, Returns};
use schedule::{GROUPS, Group, Schedule};
use sight::{Aim, Sight};
use tumbled_model::{CivilTime, RigNs, Span, UnixNs};
use tumbled_velodyne::ReturnMode;
use tumbled_velodyne::encode::{self, DataPacketBuilder};
use tumbled_velodyne::hdl64::encode::{Said, Slot};
use tumbled_velodyne::hdl64::{Hdl64Encoder, LASERS, Unit};
use tumbled_velodyne::wire::{BLOCKS, SLOTS};

/// A body nearer than this to the sensor's centre is its own housing, m.
const HOUSING_M: f64 = 0.06;

/// When an HDL-64E says it was calibrated.
const CALIBRATED: CivilTime =
    CivilTime { year: 2016, month: 11, day: 15, hour: 12, minute: 0, second: 0, nanosecond: 0 };

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
        config.check()?;
        let beams = Beams::new(&config.head, config.mode, config.vertical_offsets)?;
        let schedule = Schedule::new(config.rpm, beams.group_ns, beams.groups, config.start_azimuth_deg, config.view);
        let hdl64 = match &config.head {
            Head::BuiltIn(_) => None,
            Head::Hdl64e { generation, calibration } => {
                let unit = Unit {
                    // Readers of the calibration that a sensor sends take one without a date for none.
                    calibrated: Some(CALIBRATED),
                    rpm: config.rpm as i16,
                    view_to_cdeg: 36_000,
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

    /// From a packet's first firing, which its stamp tells, to its last, after which it leaves: in one go, without a
    /// blind sector between.
    pub fn packet_span(&self) -> Span {
        let groups = self.schedule.groups().saturating_sub(1) as i64;
        Span(groups * i64::from(self.beams.group_ns) + i64::from(self.beams.last_ns()))
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

/// One slot of a packet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Sent {
    raw: u16,
    intensity: u8,
}

/// By group, return and place.
type Slots = [[[Sent; LASERS]; 2]; GROUPS];

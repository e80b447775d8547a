//! A stage behind a serial line that speaks Zaber ASCII.

use super::commanded::CommandedStage;
use super::scripted::{ScriptedStage, StageState};
use crate::noise::Noise;
use tumbled_model::{RigNs, Span};
use tumbled_serial::lines::Lines;
use tumbled_serial::zaber::{
    Address, Alert, Command, Message, PACKET_BYTES, Rejection, Reply, RequestLine, Scale, Scope, Setting, Switch,
    Warning,
};

/// The stage behind the line.
#[derive(Clone, Debug)]
pub enum Stage {
    /// It follows a script and refuses every order to move or stop (`STATUSBUSY`): the scene has its motion already.
    Scripted(ScriptedStage),
    /// It goes where it is told.
    Commanded(CommandedStage),
}

/// What the emulated device is.
#[derive(Clone, Debug, PartialEq)]
pub struct EmulatorSettings {
    /// Its place on the chain, and its only axis.
    pub axis: Address,
    /// Counts of a turn and the encoder's step.
    pub scale: Scale,
    /// `device.id`.
    pub device_id: u32,
    /// `system.serial`.
    pub serial: u64,
    /// `version`: major and minor. Before 7.29 there is no `encoder.vel`.
    pub firmware: (u32, u32),
    /// White noise of the encoder before it is rounded, one standard deviation, counts.
    pub noise_counts: f64,
    /// The seed of that noise.
    pub seed: u64,
}

impl EmulatorSettings {
    /// Device 1, axis 1, 768 000 counts a turn (a stage that is common in laboratories), firmware 7.29, no noise.
    pub fn usual(seed: u64) -> Self {
        const SCALE: Scale = Scale::new(768_000, 1).expect("a turn has counts");
        Self {
            axis: Address { device: 1, axis: 1 },
            scale: SCALE,
            device_id: 50_919,
            serial: 1_000_000,
            firmware: (7, 29),
            noise_counts: 0.0,
            seed,
        }
    }
}

/// How long the device takes over an answer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Latency {
    /// From the request's last byte to the instant the position is taken.
    pub to_sample: Span,
    /// From there to the start of the reply's first byte.
    pub to_reply: Span,
}

/// Bytes on their way to the host.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Outgoing {
    /// When the first byte starts on the line, if the line is free.
    pub at: RigNs,
    /// A whole line.
    pub bytes: Vec<u8>,
}

/// A Zaber device with one rotary axis.
#[derive(Clone, Debug)]
pub struct ZaberEmulator {
    settings: EmulatorSettings,
    stage: Stage,
    lines: Lines,
    checksums: bool,
    alerts: bool,
    was_moving: bool,
    readings: u64,
}

/// A request, so far as an answer needs it.
struct Asked {
    address: Address,
    id: Option<tumbled_serial::zaber::MessageId>,
    checked: bool,
    command: Result<Command, Rejection>,
}

impl ZaberEmulator {
    /// A device that was just switched on: without alerts, with checksums only where it is asked with one.
    pub fn new(settings: EmulatorSettings, stage: Stage) -> Self {
        let lines = Lines::new(PACKET_BYTES);
        Self { settings, stage, lines, checksums: false, alerts: false, was_moving: false, readings: 0 }
    }

    /// Takes bytes whose last one arrives at `at`; what it answers is added to `out`. Like a device it says nothing to
    /// lines for others, lines with a wrong checksum, and noise.
    pub fn receive(&mut self, at: RigNs, bytes: &[u8], latency: Latency, out: &mut Vec<Outgoing>) {
        self.advance(at, out);
        let mut asked = Vec::new();
        let own = self.settings.axis.device;
        self.lines.push(at, bytes, |line| {
            let request = line.text.ok().and_then(RequestLine::parse);
            if let Some(line) = request.filter(|line| [0, own].contains(&line.address.device)) {
                let (address, id, checked, command) = (line.address, line.id, line.checked, line.command());
                asked.push(Asked { address, id, checked, command });
            }
        });
        for asked in asked {
            let sampled = at + latency.to_sample;
            let reply = self.answer(&asked, sampled);
            let bytes = Message::Reply(reply).encode(asked.checked || self.checksums);
            out.push(Outgoing { at: sampled + latency.to_reply, bytes });
        }
    }

    /// Time has come to `now`: where alerts are on and the stage has come to rest since the last look, it says so.
    pub fn advance(&mut self, now: RigNs, out: &mut Vec<Outgoing>) {
        let moving = self.moving(now);
        if core::mem::replace(&mut self.was_moving, moving) && !moving && self.alerts {
            let (address, warning) = (self.settings.axis, self.warning(now));
            let alert = Message::Alert(Alert { address, busy: false, warning, data: String::new() });
            out.push(Outgoing { at: now, bytes: alert.encode(self.checksums) });
        }
    }

    /// Where the table is at an instant, from the reference: what stands on it follows. For a commanded stage instants
    /// must not go back.
    pub fn table(&mut self, t: RigNs) -> StageState {
        match &mut self.stage {
            Stage::Scripted(stage) => stage.table(t),
            Stage::Commanded(stage) => stage.table(t),
        }
    }

    fn answer(&mut self, asked: &Asked, t: RigNs) -> Reply {
        let result = asked.command.and_then(|command| {
            self.check_axis(asked.address.axis, command)?;
            self.carry_out(command, t)
        });
        let address = Address { device: self.settings.axis.device, axis: asked.address.axis };
        let (accepted, data) = match result {
            Ok(data) => (true, data),
            Err(why) => (false, why.word().to_owned()),
        };
        Reply { address, id: asked.id, accepted, busy: self.moving(t), warning: self.warning(t), data }
    }

    /// Axis 0 is all axes, of which there is one.
    fn check_axis(&self, axis: u8, command: Command) -> Result<(), Rejection> {
        match (axis, command.scope()) {
            (0, _) => Ok(()),
            (axis, _) if axis != self.settings.axis.axis => Err(Rejection::BadAxis),
            (_, Scope::Device) => Err(Rejection::DeviceOnly),
            (_, Scope::Axis) => Ok(()),
        }
    }

    fn carry_out(&mut self, command: Command, t: RigNs) -> Result<String, Rejection> {
        let scale = self.settings.scale;
        match command {
            Command::Status => {}
            Command::Get(setting) => return self.value(setting, t),
            Command::Set(Switch::Alerts, on) => self.alerts = on,
            Command::Set(Switch::Checksums, on) => self.checksums = on,
            Command::Home
            | Command::MoveAbs(_)
            | Command::MoveRel(_)
            | Command::MoveVel(_)
            | Command::Stop
            | Command::EStop => {
                let Stage::Commanded(stage) = &mut self.stage else { return Err(Rejection::StatusBusy) };
                match command {
                    Command::Home => stage.home(t),
                    // Positions of a device have 32 bits.
                    Command::MoveAbs(counts) | Command::MoveRel(counts) if i32::try_from(counts).is_err() => {
                        return Err(Rejection::BadData);
                    }
                    Command::MoveAbs(counts) => stage.move_to(t, scale.angle_rad(counts)),
                    Command::MoveRel(counts) => {
                        let from = stage.counted(t).angle_rad;
                        stage.move_to(t, from + scale.angle_rad(counts));
                    }
                    Command::MoveVel(data) => {
                        let rate_rps = scale.rate_rps(data);
                        if rate_rps.abs() > stage.fastest_rps() {
                            return Err(Rejection::BadData);
                        }
                        stage.spin(t, rate_rps);
                    }
                    _ => stage.spin(t, 0.0),
                }
                self.was_moving |= command.moves();
            }
        }
        Ok("0".to_owned())
    }

    fn value(&mut self, setting: Setting, t: RigNs) -> Result<String, Rejection> {
        let (scale, (major, minor)) = (self.settings.scale, self.settings.firmware);
        let commanded = scale.counts(self.commanded(t).angle_rad);
        let number = match setting {
            Setting::DeviceId => i64::from(self.settings.device_id),
            Setting::SystemSerial => return Ok(self.settings.serial.to_string()),
            Setting::Version => return Ok(format!("{major}.{minor:02}")),
            Setting::Pos => commanded,
            Setting::EncoderPos => self.encoder(t),
            Setting::EncoderPosError => commanded.saturating_sub(self.encoder(t)),
            Setting::EncoderVel if (major, minor) >= (7, 29) => scale.velocity_data(self.table(t).rate_rps),
            Setting::EncoderVel => return Err(Rejection::BadCommand),
            Setting::MaxSpeed => scale.velocity_data(match &self.stage {
                Stage::Scripted(_) => core::f64::consts::TAU,
                Stage::Commanded(stage) => stage.fastest_rps(),
            }),
            Setting::LimitCycleDist => i64::from(scale.counts_per_turn()),
        };
        Ok(number.to_string())
    }

    /// What the encoder shows: the table's angle from where the counts are 0, with noise, on the encoder's own steps.
    fn encoder(&mut self, t: RigNs) -> i64 {
        let counted = match &mut self.stage {
            Stage::Scripted(stage) => stage.table(t),
            Stage::Commanded(stage) => stage.counted(t),
        };
        let scale = self.settings.scale;
        let mut noise = Noise::new(self.settings.seed, "turntable.encoder", self.readings);
        self.readings += 1;
        let noise_rad = self.settings.noise_counts * noise.normal() * scale.angle_rad(1);
        scale.encoder_counts(counted.angle_rad + noise_rad)
    }

    fn commanded(&mut self, t: RigNs) -> StageState {
        match &mut self.stage {
            Stage::Scripted(stage) => stage.commanded(t),
            Stage::Commanded(stage) => stage.counted(t),
        }
    }

    fn moving(&mut self, t: RigNs) -> bool {
        self.commanded(t).rate_rps != 0.0
    }

    fn warning(&self, t: RigNs) -> Warning {
        match &self.stage {
            Stage::Scripted(stage) if stage.stalled(t) => Warning::STALLED,
            Stage::Commanded(stage) if !stage.homed() => Warning::NO_REFERENCE,
            Stage::Scripted(_) | Stage::Commanded(_) => Warning::NONE,
        }
    }
}

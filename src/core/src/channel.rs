//! The rig's sensors, each with its way through the core. Kinects come first: of equal times theirs are.

use crate::config::CoreConfig;
use crate::epoch::{Epoch, RigCloud, Scan};
use crate::health::{SensorHealth, SensorState};
use crate::kinect::{Frame, KinectChannel};
use crate::lidar::{LidarChannel, Remark};
use crate::turntable::{TurntableChannel, TurntableSample};
use crate::vitals::Vitals;
use crate::workers::Workers;
use tumbled_model::{Body, Event, RigNs, SensorId, Span};

/// A sensor's way through the core.
#[derive(Debug)]
enum Channel {
    Kinect(Box<KinectChannel>),
    Lidar(Box<LidarChannel>),
    Turntable(Box<TurntableChannel>),
}

/// All sensors of the config, numbered in the order of ties.
#[derive(Debug)]
pub(crate) struct Channels {
    ids: Vec<SensorId>,
    channels: Vec<Channel>,
    /// By sensor: the newest whole second it has stepped over, in beats.
    seconds: Vec<i64>,
}

impl Channels {
    pub(crate) fn new(config: &CoreConfig) -> Self {
        let kinects = config
            .kinects
            .iter()
            .map(|setup| (setup.id.clone(), Channel::Kinect(Box::new(KinectChannel::new(setup, config)))));
        let lidars = config
            .lidars
            .iter()
            .map(|setup| (setup.id.clone(), Channel::Lidar(Box::new(LidarChannel::new(setup, config)))));
        let turntables = config
            .turntables
            .iter()
            .map(|setup| (setup.id.clone(), Channel::Turntable(Box::new(TurntableChannel::new(setup, config)))));
        let (ids, channels): (Vec<_>, Vec<_>) = kinects.chain(lidars).chain(turntables).unzip();
        let seconds = vec![0; ids.len()];
        Self { ids, channels, seconds }
    }

    pub(crate) fn len(&self) -> usize {
        self.channels.len()
    }

    pub(crate) fn find(&self, id: &SensorId) -> Option<usize> {
        self.ids.iter().position(|other| other == id)
    }

    /// The name of a sensor that [`Self::find`] found.
    pub(crate) fn id(&self, channel: usize) -> &SensorId {
        self.ids.get(channel).expect("channels are numbered by these")
    }

    pub(crate) fn configure(&mut self, config: &CoreConfig) {
        for (id, channel) in self.ids.iter().zip(&mut self.channels) {
            match channel {
                Channel::Kinect(kinect) => {
                    let setup = config.kinects.iter().find(|setup| setup.id == *id);
                    setup.into_iter().for_each(|setup| kinect.configure(setup, config));
                }
                Channel::Lidar(lidar) => {
                    let setup = config.lidars.iter().find(|setup| setup.id == *id);
                    setup.into_iter().for_each(|setup| lidar.configure(setup, config));
                }
                Channel::Turntable(_) => {}
            }
        }
    }

    /// Lets a sensor have its event.
    pub(crate) fn take(
        &mut self,
        channel: usize,
        event: &Event,
        begins_scan: bool,
        config: &CoreConfig,
        spare: &mut Vec<RigCloud>,
        workers: &Workers,
    ) {
        let Some(channel) = self.channels.get_mut(channel) else { return };
        match (&event.body, channel) {
            (Body::LidarPacket { bytes, .. }, Channel::Lidar(lidar)) => lidar.packet(bytes, event.arrived, begins_scan),
            (Body::DepthFrame { ticks, encoding, lost_packets, bytes, .. }, Channel::Kinect(kinect)) => {
                let frame = Frame { ticks: *ticks, encoding: *encoding, lost: lost_packets, bytes };
                kinect.frame(frame, event.arrived, spare, workers);
            }
            (Body::SerialChunk { bytes, .. }, Channel::Turntable(turntable)) => turntable.chunk(event.arrived, bytes),
            (Body::SensorState { state, .. }, Channel::Kinect(kinect)) => kinect.source(*state),
            (Body::SensorState { state, .. }, Channel::Lidar(lidar)) => lidar.source(*state),
            (Body::SensorState { state, .. }, Channel::Turntable(turntable)) => turntable.source(*state),
            (Body::Gap { lost, place, .. }, Channel::Lidar(lidar)) => lidar.gap(*place, *lost),
            (Body::Gap { lost, place, .. }, channel) => channel.vitals_mut().gap(*place, *lost),
            (Body::Skip { scans, .. }, Channel::Lidar(lidar)) if !config.ignore_skips => lidar.shedding.skip(*scans),
            (Body::Skip { scans, .. }, Channel::Kinect(kinect)) if !config.ignore_skips => kinect.shedding.skip(*scans),
            _ => {}
        }
    }

    /// Gives out the epochs that are complete.
    pub(crate) fn epochs(
        &mut self,
        channel: usize,
        spare: &mut Vec<RigCloud>,
        workers: &Workers,
        give: impl FnMut(Epoch),
    ) {
        match self.channels.get_mut(channel) {
            Some(Channel::Kinect(kinect)) => kinect.epochs().for_each(give),
            Some(Channel::Lidar(lidar)) => lidar.epochs(spare, workers, give),
            _ => {}
        }
    }

    pub(crate) fn watermark(&self, channel: usize) -> Option<RigNs> {
        match self.channels.get(channel)? {
            Channel::Kinect(kinect) => kinect.watermark(),
            Channel::Lidar(lidar) => lidar.watermark(),
            Channel::Turntable(_) => None,
        }
    }

    /// Whether others wait for this sensor at `t`. A turntable gives no epochs.
    pub(crate) fn may_come(&self, channel: usize, t: RigNs, silent_after: Span) -> bool {
        match self.channels.get(channel) {
            Some(Channel::Turntable(_)) | None => false,
            Some(channel) => channel.vitals().may_come(t, silent_after),
        }
    }

    /// Ends what a silence up to `t` has ended.
    pub(crate) fn silence(&mut self, channel: usize, t: RigNs) {
        if let Some(Channel::Lidar(lidar)) = self.channels.get_mut(channel) {
            lidar.silence(t);
        }
    }

    /// Gives out what is held back: nothing more comes.
    pub(crate) fn finish(&mut self, channel: usize) {
        if let Some(Channel::Lidar(lidar)) = self.channels.get_mut(channel) {
            lidar.finish();
        }
    }

    pub(crate) fn recycle(&mut self, channel: usize, scan: Scan) {
        match (self.channels.get_mut(channel), scan) {
            (Some(Channel::Kinect(kinect)), Scan::Kinect(scan)) => kinect.recycle(scan),
            (Some(Channel::Lidar(lidar)), Scan::Lidar(scan)) => lidar.recycle(*scan),
            _ => {}
        }
    }

    pub(crate) fn remarks(&mut self, channel: usize) -> Vec<Remark> {
        match self.channels.get_mut(channel) {
            Some(Channel::Kinect(kinect)) => kinect.remarks().collect(),
            Some(Channel::Lidar(lidar)) => lidar.remarks().collect(),
            Some(Channel::Turntable(turntable)) => turntable.remarks().collect(),
            None => Vec::new(),
        }
    }

    pub(crate) fn shed_scans(&self, channel: usize) -> u64 {
        match self.channels.get(channel) {
            Some(Channel::Kinect(kinect)) => kinect.shedding.scans(),
            Some(Channel::Lidar(lidar)) => lidar.shedding.scans(),
            _ => 0,
        }
    }

    /// Notes that a whole second (in beats) is behind a sensor.
    pub(crate) fn begin_second(&mut self, channel: usize, second: i64) {
        let Some(newest) = self.seconds.get_mut(channel) else { return };
        let seconds = (second - core::mem::replace(newest, second)) / crate::beat::BEATS_PER_SECOND;
        match self.channels.get_mut(channel) {
            Some(Channel::Kinect(kinect)) => kinect.seconds(seconds),
            Some(Channel::Lidar(lidar)) => lidar.seconds(seconds),
            Some(Channel::Turntable(turntable)) => turntable.seconds(seconds),
            None => {}
        }
    }

    pub(crate) fn state(&self, channel: usize, t: RigNs) -> SensorState {
        match self.channels.get(channel) {
            Some(Channel::Kinect(kinect)) => kinect.state(t),
            Some(Channel::Lidar(lidar)) => lidar.state(t),
            Some(Channel::Turntable(turntable)) => turntable.state(t),
            None => SensorState::Absent,
        }
    }

    /// A sensor's health at `t`, given everything it was fed; `None`: there is no such sensor.
    pub(crate) fn health(&self, channel: usize, t: RigNs) -> Option<SensorHealth> {
        Some(match self.channels.get(channel)? {
            Channel::Kinect(kinect) => kinect.health(t),
            Channel::Lidar(lidar) => lidar.health(t),
            Channel::Turntable(turntable) => turntable.health(t),
        })
    }

    /// Gives out where a turntable was since the last call.
    pub(crate) fn samples(&mut self, channel: usize, out: &mut Vec<TurntableSample>) {
        if let Some(Channel::Turntable(turntable)) = self.channels.get_mut(channel) {
            out.extend(turntable.samples());
        }
    }
}

impl Channel {
    fn vitals(&self) -> &Vitals {
        match self {
            Self::Kinect(kinect) => &kinect.vitals,
            Self::Lidar(lidar) => &lidar.vitals,
            Self::Turntable(turntable) => &turntable.vitals,
        }
    }

    fn vitals_mut(&mut self) -> &mut Vitals {
        match self {
            Self::Kinect(kinect) => &mut kinect.vitals,
            Self::Lidar(lidar) => &mut lidar.vitals,
            Self::Turntable(turntable) => &mut turntable.vitals,
        }
    }
}

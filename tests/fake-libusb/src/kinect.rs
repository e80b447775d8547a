//! One Kinect on its bus, and what happens to it.

use std::io;
use std::time::{Duration, Instant};

use fake_libusb_control::script::{Device, Model, Script, Timed, When};
use fake_libusb_control::{Audio, Busy, Fault};

use crate::camera::{self, Camera, register};
use crate::chronicle::Chronicle;
use crate::clock::{Clock, Nanos, SLOT, from_seconds};
use crate::depth::{Depth, Recovery};
use crate::isochronous::{Complete, Endpoint, Submitted};
use crate::motor::Motor;
use crate::source::Source;

/// A part of a Kinect that is a USB device of its own.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    Hub,
    Camera,
    Motor,
    Audio,
}

/// A camera's isochronous endpoints.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stream {
    Depth,
    Video,
}

impl Stream {
    pub(crate) fn of(endpoint: u8) -> Option<Self> {
        match endpoint {
            0x82 => Some(Self::Depth),
            0x81 => Some(Self::Video),
            _ => None,
        }
    }
}

/// One Kinect.
#[derive(Debug)]
pub(crate) struct Kinect {
    pub(crate) number: usize,
    pub(crate) device: Device,
    pub(crate) is_plugged: bool,
    /// How often it was plugged in: a device that comes back is another one.
    pub(crate) plug: u32,
    pub(crate) camera: Camera,
    pub(crate) motor: Motor,
    pub(crate) alternate: i32,
    pub(crate) is_mute: bool,
    pub(crate) has_no_bandwidth: bool,
    pub(crate) busy: Option<Busy>,
    /// Whether the kernel has a driver for it, and whether that holds it now.
    pub(crate) has_driver: bool,
    pub(crate) is_driven: bool,
    pub(crate) is_forbidden: bool,
    clock: Clock,
    /// The next slot of the bus.
    slot: u64,
    depth: Depth,
    depth_endpoint: Endpoint,
    video_endpoint: Endpoint,
    faults: Vec<Timed>,
    complete: Vec<Complete>,
}

impl Kinect {
    /// A device of the script, plugged in; an error if its frames cannot be opened.
    pub(crate) fn new(
        number: usize,
        device: &Device,
        script: &Script,
        began: Instant,
        woken: fn(),
    ) -> io::Result<Self> {
        let source = Source::open(device.frames.as_ref(), woken)?;
        let of_this = |timed: &&Timed| timed.device == number && timed.when != When::Start;
        Ok(Self {
            number,
            is_plugged: true,
            plug: 0,
            camera: Camera::default(),
            motor: Motor::new(device.accelerometer),
            alternate: 0,
            is_mute: false,
            has_no_bandwidth: false,
            busy: None,
            has_driver: false,
            is_driven: false,
            is_forbidden: false,
            clock: Clock::new(script.pace, began),
            slot: 0,
            depth: Depth::new(number, source),
            depth_endpoint: Endpoint::new(),
            video_endpoint: Endpoint::new(),
            faults: script.faults.iter().filter(of_this).cloned().collect(),
            complete: Vec::new(),
            device: device.clone(),
        })
    }

    /// Its parts on the bus, in the order of enumeration.
    pub(crate) fn parts(&self) -> Vec<Part> {
        let mut parts = Vec::new();
        if self.is_plugged {
            parts.extend([Part::Hub, Part::Camera]);
            if self.device.model == Model::Xbox1414 {
                parts.push(Part::Motor);
            }
            if self.device.audio != Audio::None {
                parts.push(Part::Audio);
            }
        }
        parts
    }

    /// Whether its camera streams at the alternate setting that is chosen.
    pub(crate) fn has_endpoints(&self) -> bool {
        self.device.model != Model::Windows || self.alternate == 1
    }

    /// Bytes of its fixed parameters.
    fn zero_plane(&self) -> usize {
        if self.device.model == Model::Xbox1414 { 322 } else { 334 }
    }

    fn works(&mut self) -> bool {
        self.depth_endpoint.in_flight() > 0 && self.depth.has_work()
    }

    /// The time on its bus.
    pub(crate) fn now(&mut self) -> Nanos {
        let works = self.clock.is_fast() && self.works();
        self.clock.now(works)
    }

    pub(crate) fn is_streaming(&self) -> bool {
        self.depth.is_running()
    }

    pub(crate) fn frames_begun(&self) -> u64 {
        self.depth.begun()
    }

    pub(crate) fn in_flight(&self) -> usize {
        self.depth_endpoint.in_flight() + self.video_endpoint.in_flight() + self.complete.len()
    }

    /// Brings the bus to the present, and does on the way what the script says.
    pub(crate) fn advance(&mut self, chronicle: &mut Chronicle) {
        let now = self.now();
        while let Some((index, time)) = self.next_fault().filter(|(_, time)| *time <= now) {
            self.run_bus(time, chronicle);
            let timed = self.faults.remove(index);
            self.happen(&timed.fault, chronicle);
        }
        self.run_bus(now, chronicle);
    }

    fn next_fault(&self) -> Option<(usize, Nanos)> {
        let time = |timed: &Timed| match timed.when {
            When::At(seconds) => Some(from_seconds(seconds)),
            When::Start | When::Frame(_) => None,
        };
        let times = self.faults.iter().enumerate().filter_map(|(index, timed)| Some((index, time(timed)?)));
        times.min_by_key(|(_, time)| *time)
    }

    fn run_bus(&mut self, until: Nanos, chronicle: &mut Chronicle) {
        let end = until / SLOT;
        while self.slot < end {
            if !self.depth.is_running() && self.depth_endpoint.in_flight() + self.video_endpoint.in_flight() == 0 {
                self.slot = end;
                return;
            }
            self.pass_slot(chronicle);
        }
    }

    fn pass_slot(&mut self, chronicle: &mut Chronicle) {
        let slot = self.slot;
        self.slot += 1;
        if self.depth.is_due(slot) {
            self.frame_faults(chronicle);
            if let Err(error) = self.depth.begin(slot, chronicle) {
                chronicle.journal(slot * SLOT, "error", format_args!("device={} frames: {error}", self.number));
            }
        }
        let packet = self.depth.packet(slot, chronicle);
        let (taken, complete) = self.depth_endpoint.pass(slot, packet.as_ref().map(|packet| packet.bytes));
        if let Some(packet) = packet
            && !taken
        {
            chronicle.late(self.number, packet.frame, packet.index);
        }
        self.complete.extend(complete);
        // The colour camera is dark: its packets are empty.
        self.complete.extend(self.video_endpoint.pass(slot, None).1);
    }

    fn frame_faults(&mut self, chronicle: &mut Chronicle) {
        let number = self.depth.begun();
        while let Some(index) = self.faults.iter().position(|timed| timed.when == When::Frame(number)) {
            let timed = self.faults.remove(index);
            self.happen(&timed.fault, chronicle);
        }
    }

    fn happen(&mut self, fault: &Fault, chronicle: &mut Chronicle) {
        if let Err(reason) = self.apply(fault, chronicle) {
            chronicle.journal(self.slot * SLOT, "script", format_args!("device={} refused: {reason}", self.number));
        }
    }

    /// Something happens now. Says which frame is concerned where that matters; an error if it makes no sense.
    pub(crate) fn apply(&mut self, fault: &Fault, chronicle: &mut Chronicle) -> Result<Option<u64>, String> {
        let time = self.slot * SLOT;
        chronicle.journal(time, "fault", format_args!("device={} {fault:?}", self.number));
        match fault {
            Fault::Drop(packets) => self.depth.drop_next(packets),
            Fault::DropRandom { probability, seed } => self.depth.drop_random(*probability, *seed),
            Fault::Corrupt(kind, packets) => self.depth.corrupt_next(*kind, packets),
            Fault::Stall(end) => self.depth.stall(*end, time),
            Fault::Unplug if !self.is_plugged => return Err("is not plugged in".to_owned()),
            Fault::Unplug => self.unplug(chronicle),
            Fault::Replug(_) if self.is_plugged => return Err("is plugged in".to_owned()),
            Fault::Replug(port) => self.replug(*port),
            Fault::Mute(on) => self.is_mute = *on,
            Fault::RefuseBandwidth(on) => self.has_no_bandwidth = *on,
            Fault::Busy(busy) => self.busy = *busy,
            Fault::KernelDriver(on) => (self.has_driver, self.is_driven) = (*on, *on),
            Fault::NoPermission(on) => self.is_forbidden = *on,
            Fault::Freeze(on) => self.depth.freeze(*on),
            Fault::Clock(ticks) => self.depth.set_clock(*ticks),
        }
        let next = matches!(fault, Fault::Drop(_) | Fault::Corrupt(..) | Fault::Clock(_) | Fault::Stall(_));
        Ok(next.then_some(self.depth.begun()))
    }

    fn unplug(&mut self, chronicle: &mut Chronicle) {
        self.is_plugged = false;
        self.depth.stop(chronicle);
        self.complete.extend(self.depth_endpoint.disappear());
        self.complete.extend(self.video_endpoint.disappear());
    }

    /// A device that had no power has forgotten everything, and whatever had befallen its firmware.
    fn replug(&mut self, port: Option<u8>) {
        self.is_plugged = true;
        self.plug += 1;
        self.device.port = port.unwrap_or(self.device.port);
        self.camera = Camera::default();
        self.alternate = 0;
        self.is_mute = false;
        self.is_driven = self.has_driver;
        self.depth.repower();
    }

    /// A request to the camera; `None` if it is not one.
    pub(crate) fn request(&mut self, bytes: &[u8], chronicle: &mut Chronicle) -> Option<()> {
        let time = self.slot * SLOT;
        match self.camera.request(bytes, self.zero_plane())? {
            camera::Done::Asked => {}
            camera::Done::Unknown(command) => {
                chronicle.journal(time, "unknown", format_args!("device={} command={command:#x}", self.number));
            }
            camera::Done::Wrote { register, value } => {
                let text = format_args!("device={} register={register:#x} value={value:#x}", self.number);
                chronicle.journal(time, "write", text);
                self.written(register, value, chronicle);
            }
        }
        Some(())
    }

    fn written(&mut self, register: u16, value: u16, chronicle: &mut Chronicle) {
        let time = self.slot * SLOT;
        match (register, value) {
            (register::DEPTH, 2) => {
                let ten_bits = self.camera.register(register::DEPTH_FORMAT) == 2;
                self.depth.start(self.slot, ten_bits, chronicle);
                chronicle.journal(time, "start", format_args!("device={} stream=depth", self.number));
            }
            (register::DEPTH, _) => {
                if self.depth.is_running() {
                    chronicle.journal(time, "stop", format_args!("device={} stream=depth", self.number));
                }
                self.depth.stop(chronicle);
            }
            (register::VIDEO, value) => {
                let event = if value == 0 { "stop" } else { "start" };
                chronicle.journal(time, event, format_args!("device={} stream=video", self.number));
            }
            _ => {}
        }
    }

    /// The host took hold of the camera anew.
    pub(crate) fn reopened(&mut self) {
        self.depth.recover(Recovery::Reopen);
    }

    /// The host reset the camera: it streams no more and has forgotten its registers.
    pub(crate) fn reset(&mut self, chronicle: &mut Chronicle) {
        self.depth.stop(chronicle);
        self.depth.recover(Recovery::Reset);
        self.camera = Camera::default();
        self.alternate = 0;
    }

    pub(crate) fn submit(&mut self, stream: Stream, transfer: Submitted, context: usize) {
        let slot = self.slot;
        self.endpoint(stream).submit(transfer, context, slot);
    }

    pub(crate) fn cancel(&mut self, stream: Stream, transfer: usize) -> bool {
        let cancelled = self.endpoint(stream).cancel(transfer);
        self.complete.extend(cancelled);
        cancelled.is_some()
    }

    /// Forgets a transfer that nobody will ask for any more.
    pub(crate) fn forget(&mut self, stream: Stream, transfer: usize) {
        self.endpoint(stream).forget(transfer);
        self.complete.retain(|complete| complete.transfer != transfer);
    }

    fn endpoint(&mut self, stream: Stream) -> &mut Endpoint {
        match stream {
            Stream::Depth => &mut self.depth_endpoint,
            Stream::Video => &mut self.video_endpoint,
        }
    }

    /// How many transfers of a context wait for their callbacks.
    pub(crate) fn waiting(&self, context: usize) -> usize {
        self.complete.iter().filter(|complete| complete.context == context).count()
    }

    /// Takes the first transfer of a context that waits for its callback.
    pub(crate) fn take(&mut self, context: usize) -> Option<usize> {
        let index = self.complete.iter().position(|complete| complete.context == context)?;
        Some(self.complete.remove(index).transfer)
    }

    /// At the fast pace: if it has packets for a context, it is the time now at which they have all been sent.
    pub(crate) fn hurry(&mut self, context: usize) -> bool {
        match self.depth_endpoint.next_end(context).filter(|_| self.clock.is_fast()) {
            Some(end) if self.works() => {
                self.clock.hurry(end * SLOT);
                true
            }
            _ => false,
        }
    }

    /// How long until something happens that a context would wait for.
    pub(crate) fn next_event(&mut self, context: usize) -> Option<Duration> {
        let ends = [self.depth_endpoint.next_end(context), self.video_endpoint.next_end(context)];
        let fault = self.next_fault().map(|(_, time)| time);
        let next = ends.into_iter().flatten().map(|end| end * SLOT).chain(fault).min()?;
        Some(Duration::from_nanos(next.saturating_sub(self.now())))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kinect(line: &str) -> Kinect {
        let script = Script::parse(line, std::path::Path::new("/")).expect("a script");
        Kinect::new(0, &script.devices[0], &script, Instant::now(), || ()).expect("no files")
    }

    #[test]
    fn a_kinect_for_windows_has_endpoints_on_its_alternate_setting_alone() {
        let mut windows = kinect("kinect k4w");
        assert!(!windows.has_endpoints());
        windows.alternate = 1;
        assert!(windows.has_endpoints());
        windows.reset(&mut Chronicle::default());
        assert!(!windows.has_endpoints());
        assert!(kinect("kinect 1414").has_endpoints());
    }

    #[test]
    fn parts_are_those_of_the_model() {
        use Part::{Audio, Camera, Hub, Motor};
        assert_eq!(kinect("kinect 1414").parts(), [Hub, Camera, Motor]);
        assert_eq!(kinect("kinect 1414 audio loader").parts(), [Hub, Camera, Motor, Audio]);
        assert_eq!(kinect("kinect 1473").parts(), [Hub, Camera, Audio]);
        let mut unplugged = kinect("kinect 1414");
        unplugged.apply(&Fault::Unplug, &mut Chronicle::default()).expect("is plugged in");
        assert_eq!(unplugged.parts(), []);
        assert!(unplugged.apply(&Fault::Unplug, &mut Chronicle::default()).is_err());
    }
}

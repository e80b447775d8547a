//! Everything there is, behind one lock.
//!
//! What the host gets for contexts, devices and handles are numbers in the form of pointers: it never looks behind them,
//! and a stale one is found out instead of followed.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::path::Path;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::ThreadId;
use std::time::Instant;
use std::{env, fmt, fs, io};

use fake_libusb_control::script::{VARIABLE, When};
use fake_libusb_control::{Fault, Script, Status};

use crate::chronicle::Chronicle;
use crate::clock::{Nanos, nanos};
use crate::kinect::{Kinect, Part, Stream};
use crate::remote;

static WORLD: Mutex<Option<World>> = Mutex::new(None);
/// Told whenever something changed that a thread in `handle_events` may wait for.
pub(crate) static CHANGED: Condvar = Condvar::new();

/// Everything there is.
#[derive(Debug)]
pub(crate) struct World {
    began: Instant,
    pub(crate) chronicle: Chronicle,
    pub(crate) kinects: Vec<Kinect>,
    pub(crate) contexts: BTreeMap<usize, Context>,
    /// The context that is used where none is given, and how often it was asked for.
    pub(crate) default_context: Option<(usize, usize)>,
    pub(crate) devices: BTreeMap<usize, Listed>,
    pub(crate) handles: BTreeMap<usize, Handle>,
    pub(crate) transfers: BTreeMap<usize, Allocated>,
    next_key: usize,
}

/// A libusb context.
#[derive(Debug)]
pub(crate) struct Context {
    /// The thread that handles its events.
    pub(crate) handling: Option<ThreadId>,
    /// A descriptor, as the real one costs: what leaks contexts leaks descriptors.
    _descriptor: File,
}

/// A device as it was listed.
#[derive(Debug)]
pub(crate) struct Listed {
    /// The context that listed it, and handles its events.
    pub(crate) context: usize,
    pub(crate) kinect: usize,
    pub(crate) part: Part,
    pub(crate) plug: u32,
    pub(crate) references: usize,
}

/// An open device.
#[derive(Debug)]
pub(crate) struct Handle {
    pub(crate) device: usize,
    pub(crate) kinect: usize,
    pub(crate) part: Part,
    pub(crate) plug: u32,
    pub(crate) context: usize,
    pub(crate) claimed: BTreeSet<i32>,
    /// Endpoints to which transfers were submitted since their last cancellation.
    pub(crate) active: BTreeSet<u8>,
    /// A descriptor, as the real one costs: what leaks handles leaks descriptors.
    _descriptor: File,
}

/// An allocated transfer.
#[derive(Debug)]
pub(crate) struct Allocated {
    pub(crate) packets: usize,
    /// Where it is in flight.
    pub(crate) place: Option<(usize, Stream, usize)>,
}

/// The world, if `libusb_init` was ever called.
pub(crate) fn lock() -> MutexGuard<'static, Option<World>> {
    // What a panicking thread left behind is still the best there is.
    WORLD.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Wakes the threads in `handle_events`.
pub(crate) fn wake() {
    CHANGED.notify_all();
}

impl World {
    /// The world of the script that the environment names; without one, a bus without devices.
    pub(crate) fn create() -> io::Result<Self> {
        let script = match env::var_os(VARIABLE) {
            None => Script::default(),
            Some(path) => {
                let path = Path::new(&path);
                let says = |reason: &dyn fmt::Display| io::Error::other(format!("{}: {reason}", path.display()));
                let text = fs::read_to_string(path).map_err(|error| says(&error))?;
                let folder = path.parent().unwrap_or(Path::new("."));
                Script::parse(&text, folder).map_err(|error| says(&error))?
            }
        };
        let began = Instant::now();
        let mut world = Self {
            began,
            chronicle: Chronicle::create(&script)?,
            kinects: Vec::new(),
            contexts: BTreeMap::new(),
            default_context: None,
            devices: BTreeMap::new(),
            handles: BTreeMap::new(),
            transfers: BTreeMap::new(),
            next_key: 0x1000,
        };
        for (number, device) in script.devices.iter().enumerate() {
            world.kinects.push(Kinect::new(number, device, &script, began, wake)?);
        }
        for timed in script.faults.iter().filter(|timed| timed.when == When::Start) {
            world.apply(timed.device, &timed.fault).map_err(io::Error::other)?;
        }
        if let Some(path) = &script.control {
            remote::listen(path)?;
        }
        Ok(world)
    }

    /// A number for something new.
    fn key(&mut self) -> usize {
        self.next_key += 0x10;
        self.next_key
    }

    /// Brings every bus to the present.
    pub(crate) fn advance(&mut self) {
        for kinect in &mut self.kinects {
            kinect.advance(&mut self.chronicle);
        }
    }

    /// Writes to the journal, now.
    pub(crate) fn journal(&mut self, event: &str, details: impl fmt::Display) {
        let now: Nanos = nanos(self.began.elapsed());
        self.chronicle.journal(now, event, details);
    }

    /// Something happens to a device now.
    pub(crate) fn apply(&mut self, device: usize, fault: &Fault) -> Result<Option<u64>, String> {
        self.advance();
        let count = self.kinects.len();
        let kinect = self.kinects.get_mut(device).ok_or_else(|| format!("there is no device {device} of {count}"))?;
        kinect.apply(fault, &mut self.chronicle)
    }

    pub(crate) fn add_context(&mut self) -> io::Result<usize> {
        let context = Context { handling: None, _descriptor: File::open("/dev/null")? };
        let key = self.key();
        self.contexts.insert(key, context);
        Ok(key)
    }

    /// The context meant by a number that may be 0.
    pub(crate) fn context(&self, key: usize) -> Option<usize> {
        let key = if key == 0 { self.default_context?.0 } else { key };
        self.contexts.contains_key(&key).then_some(key)
    }

    /// Lists a part of a device, with one more reference to it.
    pub(crate) fn list(&mut self, context: usize, kinect: usize, part: Part, plug: u32) -> usize {
        let same = |listed: &Listed| {
            (listed.context, listed.kinect, listed.part, listed.plug) == (context, kinect, part, plug)
        };
        if let Some((&key, listed)) = self.devices.iter_mut().find(|(_, listed)| same(listed)) {
            listed.references += 1;
            return key;
        }
        let key = self.key();
        self.devices.insert(key, Listed { context, kinect, part, plug, references: 1 });
        key
    }

    /// Gives back a reference.
    pub(crate) fn unlist(&mut self, device: usize) {
        let Some(listed) = self.devices.get_mut(&device) else {
            self.journal("error", format_args!("device={device:#x} given back once too often"));
            return;
        };
        listed.references -= 1;
        if listed.references == 0 {
            self.devices.remove(&device);
        }
    }

    /// Whether a device that was listed is still on the bus.
    pub(crate) fn is_there(&self, kinect: usize, plug: u32) -> bool {
        self.kinects.get(kinect).is_some_and(|kinect| kinect.is_plugged && kinect.plug == plug)
    }

    pub(crate) fn add_handle(&mut self, device: usize) -> io::Result<usize> {
        let descriptor = File::open("/dev/null")?;
        let Some(listed) = self.devices.get_mut(&device) else { return Err(io::ErrorKind::NotFound.into()) };
        listed.references += 1;
        let handle = Handle {
            device,
            kinect: listed.kinect,
            part: listed.part,
            plug: listed.plug,
            context: listed.context,
            claimed: BTreeSet::new(),
            active: BTreeSet::new(),
            _descriptor: descriptor,
        };
        let key = self.key();
        self.handles.insert(key, handle);
        Ok(key)
    }

    /// The device behind a handle, if both are still there. `what` is written down if the handle is not.
    pub(crate) fn behind(&mut self, handle: usize, what: &str) -> Option<(&mut Kinect, Part, &mut Chronicle)> {
        let Some(open) = self.handles.get(&handle) else {
            self.journal("error", format_args!("{what} with handle {handle:#x}, which is not open"));
            return None;
        };
        let (kinect, part, plug) = (open.kinect, open.part, open.plug);
        if !self.is_there(kinect, plug) {
            return None;
        }
        self.kinects.get_mut(kinect).map(|kinect| (kinect, part, &mut self.chronicle))
    }

    pub(crate) fn status(&self) -> Status {
        let listed: usize = self.devices.values().map(|listed| listed.references).sum();
        Status {
            contexts: self.contexts.len(),
            handles: self.handles.len(),
            claims: self.handles.values().map(|handle| handle.claimed.len()).sum(),
            transfers: self.transfers.len(),
            in_flight: self.kinects.iter().map(Kinect::in_flight).sum(),
            references: listed - self.handles.len(),
            frames: self.kinects.iter().map(Kinect::frames_begun).sum(),
            plugged: self.kinects.iter().filter(|kinect| kinect.is_plugged).count(),
            streaming: self.kinects.iter().filter(|kinect| kinect.is_streaming()).count(),
        }
    }
}

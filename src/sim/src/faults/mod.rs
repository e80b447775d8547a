//! Faults on purpose: a stream of events with what the script says done to it, and the count of what was done.
//!
//! Works on simulated streams and on recorded ledgers alike: it sees events and nothing else. Every chance is drawn from a
//! stream of its own for each fault and sensor, so that the same script does the same to a sensor however the others'
//! events lie between. Events come out in the order of their arrival as far as they came in so, numbered anew.
//!
//! ```toml
//! seed = 7
//!
//! [[fault]]
//! sensor = "front"
//! from_s = 10.0
//! until_s = 20.0
//! action.loss.probability = 0.02
//!
//! [[fault]]
//! sensor = "left"
//! from_s = 30.0
//! until_s = 33.0
//! action = "unplug"
//! ```

mod alter;
mod counts;
mod script;

pub use counts::{FaultCounts, FaultTruth};
pub use script::{Action, Fault, FaultError, FaultScript, Payload, Pulse};

use crate::noise::Noise;
use crate::scene::Scene;
use script::ns;
use std::collections::{BTreeMap, VecDeque};
use tumbled_model::{Body, Event, RigNs, SensorId, SourceState, Span, UnixNs};

/// After a reboot the first packet leaves a second after power-up.
const BOOTED_S: f64 = 1.0;

/// A stream of events with faults.
#[derive(Debug)]
pub struct FaultInjector<I> {
    source: I,
    script: FaultScript,
    upcoming: Option<Event>,
    /// What each fault remembers of each sensor.
    memories: BTreeMap<(usize, SensorId), Memory>,
    /// Overtaken items by sensor, and how many have still to pass.
    held: BTreeMap<SensorId, Vec<(u32, Body)>>,
    /// Delayed items by arrival.
    waiting: BTreeMap<(RigNs, u64), Body>,
    waited: u64,
    ready: VecDeque<(RigNs, Body)>,
    /// The newest arrival.
    newest: RigNs,
    seq: u64,
    truth: FaultTruth,
}

/// What a fault remembers of a sensor.
#[derive(Debug)]
struct Memory {
    noise: Noise,
    burst_left: u32,
    /// What is repeated while frozen.
    frozen: Option<Body>,
    /// How far the restarted clock is behind the other, s.
    rebooted: Option<f64>,
    silent: bool,
    was_told: bool,
}

/// An item on its way past the faults.
struct Passing {
    arrived: RigNs,
    body: Body,
    /// How many later ones pass it.
    overtaken_by: u32,
}

impl<I: Iterator<Item = Event>> FaultInjector<I> {
    /// The source's events with the script's faults.
    ///
    /// # Errors
    /// [`FaultError`]: a number in the script that means nothing.
    pub fn new(source: I, script: FaultScript) -> Result<Self, FaultError> {
        script.check()?;
        Ok(Self::checked(source, script))
    }

    /// The source's events with a scene's own faults, which were checked when the scene was built.
    pub fn of_scene(source: I, scene: &Scene) -> Self {
        Self::checked(source, scene.faults())
    }

    fn checked(source: I, script: FaultScript) -> Self {
        Self {
            source,
            script,
            upcoming: None,
            memories: BTreeMap::new(),
            held: BTreeMap::new(),
            waiting: BTreeMap::new(),
            waited: 0,
            ready: VecDeque::new(),
            newest: RigNs(i64::MIN),
            seq: 0,
            truth: FaultTruth::default(),
        }
    }

    /// Where the events come from.
    pub fn source(&self) -> &I {
        &self.source
    }

    /// The same, e.g. to ask it why it ended.
    pub fn source_mut(&mut self) -> &mut I {
        &mut self.source
    }

    /// What is done.
    pub fn script(&self) -> &FaultScript {
        &self.script
    }

    /// What has been done so far.
    pub fn truth(&self) -> &FaultTruth {
        &self.truth
    }

    fn event(&mut self, (arrived, body): (RigNs, Body)) -> Event {
        let seq = self.seq;
        self.seq += 1;
        self.newest = self.newest.max(arrived);
        Event { seq, arrived, body }
    }

    /// One event of the source past all faults.
    fn pass(&mut self, event: Event) {
        self.newest = self.newest.max(event.arrived);
        let sensor = match (event.body.sensor(), alter::payload(&event.body)) {
            (Some(sensor), Some(_)) => sensor.clone(),
            _ => {
                let body = self.stepped_anchor(event.arrived, event.body);
                self.ready.push_back((event.arrived, body));
                return;
            }
        };
        self.counts(&sensor).items += u64::from(!alter::is_position(&event.body));
        let mut items = vec![Passing { arrived: event.arrived, body: event.body, overtaken_by: 0 }];
        for number in 0..self.script.fault.len() {
            let Some(fault) = self.script.fault.get(number) else { break };
            if fault.sensor.as_deref().is_some_and(|name| name != sensor.as_str()) {
                continue;
            }
            let (covers, action, from) = (fault.covers(event.arrived), fault.action, ns(fault.from_s));
            if !covers {
                self.after(number, &sensor, event.arrived);
                continue;
            }
            let mut passed = Vec::with_capacity(items.len());
            for item in items {
                self.act(number, action, from, &sensor, item, &mut passed);
            }
            items = passed;
        }
        for item in items {
            self.send(&sensor, item);
        }
    }

    /// A fault meets an item: what becomes of it goes into `passed`.
    fn act(
        &mut self,
        number: usize,
        action: Action,
        from: RigNs,
        sensor: &SensorId,
        mut item: Passing,
        passed: &mut Vec<Passing>,
    ) {
        let seed = self.script.seed;
        let key = (number, sensor.clone());
        let memory = self.memories.entry(key).or_insert_with(|| Memory::new(seed, number, sensor));
        let counts = self.truth.sensors.entry(sensor.to_string()).or_default();
        match action {
            Action::Loss { probability } => {
                if memory.noise.chance(probability) {
                    return counts.lose(&item.body);
                }
            }
            Action::Burst { probability, items } => {
                if memory.burst_left == 0 && memory.noise.chance(probability) {
                    memory.burst_left = items;
                    counts.bursts += 1;
                }
                if memory.burst_left > 0 {
                    memory.burst_left -= 1;
                    return counts.lose(&item.body);
                }
            }
            Action::Duplicate { probability } => {
                if memory.noise.chance(probability) {
                    counts.duplicated += 1;
                    passed.push(Passing { body: item.body.clone(), ..item });
                }
            }
            Action::Reorder { probability, depth } => {
                if memory.noise.chance(probability) {
                    counts.overtaken += 1;
                    item.overtaken_by = 1 + (memory.noise.bits() % u64::from(depth.max(1))) as u32;
                }
            }
            Action::Corrupt { probability, bytes } => {
                if memory.noise.chance(probability) {
                    counts.corrupted += 1;
                    item.body = alter::corrupted(item.body, bytes, &mut memory.noise);
                }
            }
            Action::Resize { probability, bytes } => {
                if memory.noise.chance(probability) {
                    counts.resized += 1;
                    item.body = alter::edited(item.body, |payload| payload.resize(bytes as usize, 0));
                }
            }
            Action::Spoof { probability, payload } => {
                if memory.noise.chance(probability)
                    && let Some(body) = alter::spoofed(&item.body, payload, &mut memory.noise)
                {
                    counts.spoofed += 1;
                    let arrived = item.arrived;
                    passed.push(item);
                    item = Passing { arrived, body, overtaken_by: 0 };
                }
            }
            Action::Delay { delay_s, jitter_s } => {
                counts.delayed += 1;
                let late_s = delay_s + jitter_s * memory.noise.uniform();
                item.arrived = item.arrived + Span(ns(late_s).0);
            }
            Action::Reboot { silent_s } => {
                if !memory.was_told {
                    memory.was_told = true;
                    counts.reboots += 1;
                }
                if item.arrived < from + Span(ns(silent_s).0) {
                    counts.silenced += 1;
                    return;
                }
                if memory.rebooted.is_none() {
                    let ticks = alter::stamp(&item.body);
                    memory.rebooted = ticks.map(|ticks| f64::from(ticks) * alter::tick_s(&item.body) - BOOTED_S);
                }
                item.body = alter::shifted(item.body, -memory.rebooted.unwrap_or(0.0));
            }
            Action::Unplug => {
                counts.silenced += 1;
                let noticed = !matches!(item.body, Body::LidarPacket { .. });
                memory.silent = noticed;
                if noticed && !memory.was_told {
                    memory.was_told = true;
                    let body = Body::SensorState { sensor: sensor.clone(), state: SourceState::Lost };
                    self.put(item.arrived, body);
                }
                return;
            }
            Action::Freeze => match &memory.frozen {
                // Position packets and data packets of a LiDAR freeze by themselves; the data are meant.
                _ if alter::is_position(&item.body) => {}
                Some(first) => {
                    counts.frozen += 1;
                    let bytes = alter::payload(first).cloned().unwrap_or_default();
                    item.body = alter::with_payload(item.body, bytes);
                }
                None => memory.frozen = Some(item.body.clone()),
            },
            Action::Pps { state } => {
                if alter::is_position(&item.body) {
                    counts.pulses += 1;
                    item.body = alter::with_pulse(item.body, state);
                }
            }
            Action::ClockStep { step_s } => {
                counts.stepped += u64::from(alter::stamp(&item.body).is_some());
                item.body = alter::shifted(item.body, step_s);
            }
            Action::WallStep { .. } => {}
        }
        passed.push(item);
    }

    /// A fault whose window an item lies outside of: one that was unplugged is there again.
    fn after(&mut self, number: usize, sensor: &SensorId, arrived: RigNs) {
        let Some(memory) = self.memories.get_mut(&(number, sensor.clone())) else { return };
        if core::mem::take(&mut memory.silent) {
            memory.was_told = false;
            let body = Body::SensorState { sensor: sensor.clone(), state: SourceState::Opened };
            self.ready.push_back((arrived, body));
        }
        memory.burst_left = 0;
    }

    /// An item past all faults: out, or to wait.
    fn send(&mut self, sensor: &SensorId, item: Passing) {
        if item.overtaken_by > 0 {
            self.held.entry(sensor.clone()).or_default().push((item.overtaken_by, item.body));
            return;
        }
        self.put(item.arrived, item.body);
        let mut released = Vec::new();
        if let Some(held) = self.held.get_mut(sensor) {
            held.retain_mut(|(left, body)| {
                *left -= 1;
                if *left == 0 {
                    released.push(body.clone());
                }
                *left > 0
            });
        }
        for body in released {
            self.put(item.arrived, body);
        }
    }

    fn put(&mut self, arrived: RigNs, body: Body) {
        if arrived > self.newest {
            self.waiting.insert((arrived, self.waited), body);
            self.waited += 1;
        } else {
            self.ready.push_back((arrived, body));
        }
    }

    fn stepped_anchor(&mut self, arrived: RigNs, body: Body) -> Body {
        let Body::Anchor { unix } = body else { return body };
        let steps =
            self.script.fault.iter().filter(|fault| fault.covers(arrived)).filter_map(|fault| {
                if let Action::WallStep { step_s } = fault.action { Some(ns(step_s).0) } else { None }
            });
        let (count, step) = steps.fold((0u64, 0i64), |(count, sum), step| (count + 1, sum.saturating_add(step)));
        self.truth.anchors_stepped += u64::from(count > 0);
        Body::Anchor { unix: UnixNs(unix.0.saturating_add(step)) }
    }

    fn counts(&mut self, sensor: &SensorId) -> &mut FaultCounts {
        self.truth.sensors.entry(sensor.to_string()).or_default()
    }
}

impl<I: Iterator<Item = Event>> Iterator for FaultInjector<I> {
    type Item = Event;

    fn next(&mut self) -> Option<Event> {
        loop {
            if let Some(ready) = self.ready.pop_front() {
                return Some(self.event(ready));
            }
            if self.upcoming.is_none() {
                self.upcoming = self.source.next();
            }
            let due = self.upcoming.as_ref().map(|event| event.arrived);
            if let Some(entry) = self.waiting.first_entry()
                && due.is_none_or(|due| entry.key().0 <= due)
            {
                let ((arrived, _), body) = entry.remove_entry();
                return Some(self.event((arrived, body)));
            }
            match self.upcoming.take() {
                Some(event) => self.pass(event),
                None => {
                    // What should have been overtaken by items that never came comes last.
                    let (_, held) = self.held.pop_first()?;
                    let newest = self.newest;
                    self.ready.extend(held.into_iter().map(|(_, body)| (newest, body)));
                }
            }
        }
    }
}

impl Memory {
    fn new(seed: u64, number: usize, sensor: &SensorId) -> Self {
        Self {
            noise: Noise::new(seed, &format!("fault.{sensor}"), number as u64),
            burst_left: 0,
            frozen: None,
            rebooted: None,
            silent: false,
            was_told: false,
        }
    }
}

impl FaultCounts {
    fn lose(&mut self, body: &Body) {
        if alter::is_position(body) {
            self.lost_positions += 1;
        } else {
            self.lost += 1;
        }
    }
}

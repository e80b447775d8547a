//! An operator's orders, in force from their own time on: whatever the order in which sensors' data reach this machine.

use crate::notice::{Gravity, NoticeKind};
use crate::segment::Learned;
use std::collections::{BTreeMap, VecDeque};
use tumbled_model::{Command, RigNs, SensorId, Span};

/// Orders that wait for their time at most: a person gives one a second, a damaged recording may hold any number.
const WAITING: usize = 64;

/// What the estimation tells an operator.
pub(crate) type Told = (NoticeKind, Gravity, String);

/// Orders that wait for the first epoch that is not before them.
#[derive(Clone, Debug, Default)]
pub(super) struct Orders {
    waiting: VecDeque<(RigNs, Command)>,
}

impl Orders {
    /// Takes one; of too many the newest are left out.
    pub(super) fn push(&mut self, at: RigNs, command: &Command) {
        if self.waiting.len() < WAITING {
            self.waiting.push_back((at, command.clone()));
        }
    }

    /// The next that is in force at a time, and since when it was.
    pub(super) fn due(&mut self, t: RigNs) -> Option<(RigNs, Command)> {
        let (at, _) = self.waiting.front()?;
        if *at <= t { self.waiting.pop_front() } else { None }
    }
}

/// That learning begins.
pub(super) fn begun(lasts: Span) -> Told {
    let message = format!("the background is being learned for {:.1} s: the room has to be empty", lasts.as_secs_f64());
    (NoticeKind::Background, Gravity::Info, message)
}

/// That something beside the target was seen to stand still.
pub(super) fn stands(sensor: &SensorId, points: usize) -> Told {
    let message = format!(
        "{sensor}: something of {points} points beside the target stands still while the target moves: no sensor looks there \
         any more (`tumbled ctl forget-background` undoes it)"
    );
    (NoticeKind::Background, Gravity::Info, message)
}

/// What was learned, of these sensors of a rig.
pub(super) fn learned<'a>(
    report: &BTreeMap<SensorId, Learned>,
    sensors: impl Iterator<Item = &'a SensorId>,
) -> Vec<Told> {
    let tell = |id: &SensorId| match report.get(id) {
        Some(Learned { epochs, voxels, is_cut: false }) => {
            let message = format!("{id}: a background of {voxels} voxels of 5 cm is learned, from {epochs} epochs");
            (NoticeKind::Background, Gravity::Info, message)
        }
        Some(Learned { voxels, .. }) => {
            let message = format!(
                "{id}: the background is cut at {voxels} voxels of 5 cm, the rest of the room is not known: make \
                 target.roi_radius_m smaller"
            );
            (NoticeKind::Background, Gravity::Warn, message)
        }
        None => {
            let message = format!("{id} measured nothing while the background was learned: what it sees is not known");
            (NoticeKind::Background, Gravity::Warn, message)
        }
    };
    sensors.map(tell).collect()
}

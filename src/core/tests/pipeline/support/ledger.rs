//! From what each source does to one ledger, in the order of arrival or in any other that a host could have made of it.

use super::chance::Chance;
use super::compare::Record;
use tumbled_core::{CoreConfig, Epoch, Outputs, Pipeline, Workers};
use tumbled_model::{Body, Event, RigNs, UnixNs};

pub(crate) const US: i64 = 1_000;
pub(crate) const MS: i64 = 1_000 * US;
pub(crate) const S: i64 = 1_000 * MS;

/// One source's events, in their order, with their arrivals in ns.
pub(crate) type Source = Vec<(i64, Body)>;

/// Ticks from 0 to `until_ns`, a tenth of a second apart.
pub(crate) fn ticks(until_ns: i64) -> Source {
    (0..=until_ns / (100 * MS)).map(|n| (n * 100 * MS, Body::Tick)).collect()
}

/// Anchors, one a second, of a wall clock that was right at 0 and is set by so many ns at so many.
pub(crate) fn anchors(until_ns: i64, steps: &[(i64, i64)]) -> Source {
    let unix = |t: i64| 1_795_000_000 * S + t + steps.iter().filter(|(at, _)| *at <= t).map(|(_, by)| by).sum::<i64>();
    (0..=until_ns / S).map(|n| (n * S, Body::Anchor { unix: UnixNs(unix(n * S)) })).collect()
}

/// The ledger in the order of arrival; of equal arrivals the source named first goes first.
pub(crate) fn ledger(sources: &[Source]) -> Vec<Event> {
    in_order(sources, |_, arrived| arrived)
}

/// The ledger as another host might have made it: each source keeps its order and its arrivals, and lies up to
/// `shift_ns` earlier or later among the others than it arrived, other by other piece of `piece_ns`.
pub(crate) fn shifted(sources: &[Source], shift_ns: i64, piece_ns: i64, seed: u64) -> Vec<Event> {
    let mut chance = Chance::new(seed);
    let shifts: Vec<Vec<i64>> = sources
        .iter()
        .map(|source| {
            let pieces = source.iter().map(|(arrived, _)| arrived / piece_ns).max().unwrap_or(0) + 1;
            (0..pieces).map(|_| chance.around(shift_ns)).collect()
        })
        .collect();
    in_order(sources, |source, arrived| arrived + shifts[source][(arrived / piece_ns) as usize])
}

fn in_order(sources: &[Source], place: impl Fn(usize, i64) -> i64) -> Vec<Event> {
    let mut placed = Vec::new();
    for (source, events) in sources.iter().enumerate() {
        let mut newest = i64::MIN;
        for (arrived, body) in events {
            newest = newest.max(place(source, *arrived));
            placed.push((newest, *arrived, body));
        }
    }
    placed.sort_by_key(|(place, ..)| *place); // stable: a source keeps its order
    let event = |(seq, (_, arrived, body)): (usize, (i64, i64, &Body))| Event {
        seq: seq as u64,
        arrived: RigNs(arrived),
        body: body.clone(),
    };
    placed.into_iter().enumerate().map(event).collect()
}

/// Runs a ledger to its end and shows each epoch, once, as it is given out.
pub(crate) fn run_with(config: CoreConfig, events: &[Event], mut see: impl FnMut(&Epoch)) -> (Pipeline, Outputs) {
    let mut pipeline = Pipeline::new(config, Workers::none());
    let (mut out, mut all) = (Outputs::default(), Outputs::default());
    for event in events {
        pipeline.step(event, &mut out);
        keep(&mut out, &mut all, &mut see);
    }
    pipeline.finish(&mut out);
    keep(&mut out, &mut all, &mut see);
    (pipeline, all)
}

/// Notices and health are kept, epochs are seen.
fn keep(out: &mut Outputs, all: &mut Outputs, see: &mut impl FnMut(&Epoch)) {
    out.epochs.iter().for_each(see);
    all.notices.append(&mut out.notices);
    all.health.append(&mut out.health);
    out.clear();
}

/// Runs a ledger to its end and records all that came of it.
pub(crate) fn record(config: CoreConfig, events: &[Event], workers: Workers, clears: bool) -> Record {
    let mut pipeline = Pipeline::new(config, workers);
    let (mut out, mut record) = (Outputs::default(), Record::default());
    for event in events {
        pipeline.step(event, &mut out);
        if clears {
            record.take(&out);
            out.clear();
        }
    }
    pipeline.finish(&mut out);
    record.take(&out);
    record
}

/// Runs a ledger: each epoch's sensor, its time, and the newest arrival when it was given out, ms.
pub(crate) fn given_out_at(config: CoreConfig, events: &[Event]) -> Vec<(String, i64, i64)> {
    let mut pipeline = Pipeline::new(config, Workers::none());
    let (mut out, mut given, mut now) = (Outputs::default(), Vec::new(), 0);
    for event in events {
        pipeline.step(event, &mut out);
        now = event.arrived.0.max(now);
        given.extend(out.epochs.iter().map(|epoch| (epoch.sensor.to_string(), epoch.t.0 / MS, now / MS)));
        out.clear();
    }
    pipeline.finish(&mut out);
    given.extend(out.epochs.iter().map(|epoch| (epoch.sensor.to_string(), epoch.t.0 / MS, now / MS)));
    given
}

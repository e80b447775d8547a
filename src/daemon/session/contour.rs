//! The contour of the model, made beside the measurement: on a thread of its own, from a copy of the model.
//!
//! ```text
//!   core ── once a second at most, if the thread rests: a copy ─▶ slot ─▶ planes, edges ─▶ slot ─▶ told with the next model
//! ```
//! It is a view for people: when it comes depends on the machine, and nothing that is measured depends on it.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tumbled_core::recon::{FusedPoint, ReconSettings, reconstruct};
use tumbled_core::track::{Surfel, Surfels};
use tumbled_model::{RigNs, UnixNs};

use crate::stream::contour::ContourEdge;
use crate::stream::{ContourLine, ModelView, StreamOrigin};

/// After its work the thread rests so many times as long as it worked: it takes a tenth of a processor at most.
const RESTS: u32 = 9;
/// And never less than this.
const LEAST_REST: Duration = Duration::from_millis(900);

/// The thread that makes contours. Dropped, it ends after what it has begun.
#[derive(Debug)]
pub struct ContourMaker {
    shared: Arc<Shared>,
}

#[derive(Debug, Default)]
struct Shared {
    slot: Mutex<Slot>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct Slot {
    wanted: Option<Snapshot>,
    made: Option<ContourLine>,
    /// It works, or rests.
    busy: bool,
    ended: bool,
}

/// A model as it was.
#[derive(Debug)]
struct Snapshot {
    target: u32,
    epoch: u64,
    times: (RigNs, UnixNs),
    surfels: Surfels,
}

impl ContourMaker {
    /// Begins to wait for models.
    ///
    /// # Errors
    /// When the system gives no thread.
    pub fn start(origin: StreamOrigin) -> std::io::Result<Self> {
        let shared = Arc::new(Shared::default());
        let of_thread = Arc::clone(&shared);
        std::thread::Builder::new().name("contour".to_owned()).spawn(move || work(&of_thread, origin))?;
        Ok(Self { shared })
    }

    /// Hands a model over, unless the one before is still at work.
    pub fn offer(&self, model: &ModelView<'_>) {
        let mut slot = self.shared.lock();
        if slot.busy || slot.wanted.is_some() {
            return;
        }
        let times = (model.t, model.unix);
        slot.wanted =
            Some(Snapshot { target: model.target, epoch: model.epoch, times, surfels: model.surfels.clone() });
        self.shared.changed.notify_all();
    }

    /// The contour that was made since the last one was taken.
    pub fn take(&self) -> Option<ContourLine> {
        self.shared.lock().made.take()
    }
}

impl Drop for ContourMaker {
    fn drop(&mut self) {
        self.shared.lock().ended = true;
        self.shared.changed.notify_all();
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Slot> {
        // A slot is whole after every statement.
        self.slot.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits for a model; `None`: nobody wants a contour any more.
    fn next(&self) -> Option<Snapshot> {
        let mut slot = self.lock();
        slot.busy = false;
        loop {
            if slot.ended {
                return None;
            }
            if let Some(snapshot) = slot.wanted.take() {
                slot.busy = true;
                return Some(snapshot);
            }
            slot = self.changed.wait(slot).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn rest(&self, time: Duration) {
        let slot = self.lock();
        let rested = self.changed.wait_timeout_while(slot, time, |slot| !slot.ended);
        drop(rested.unwrap_or_else(PoisonError::into_inner));
    }
}

fn work(shared: &Shared, origin: StreamOrigin) {
    while let Some(snapshot) = shared.next() {
        let began = Instant::now();
        let line = contour(origin, &snapshot);
        shared.lock().made = Some(line);
        shared.rest((began.elapsed() * RESTS).max(LEAST_REST));
    }
}

fn contour(origin: StreamOrigin, snapshot: &Snapshot) -> ContourLine {
    let points: Vec<FusedPoint> = snapshot.surfels.rows().map(|surfel| point(&surfel)).collect();
    let made = reconstruct(&points, &[], &ReconSettings::default());
    let edges = made.edges.iter().map(ContourEdge::new).collect();
    ContourLine::new(origin, (snapshot.target, snapshot.epoch), snapshot.times, made.planes.len(), edges)
}

/// A piece of surface as a fused point. The tracker does not count who saw it, nor from where.
fn point(surfel: &Surfel) -> FusedPoint {
    FusedPoint {
        place: surfel.position,
        normal: surfel.normal,
        sigma_m: surfel.weight.sqrt().recip(),
        kinect: 0,
        lidar: 0,
        views_rad: 0.0,
        beside_cameras: false,
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;
    use crate::stream::contour::ContourKind;

    /// Two sides of a box of 0.4 m, 1 cm apart: they meet along z at x = 0, y = 0.
    fn two_sides() -> Surfels {
        let cells = || (1..40).flat_map(|n| (0..40).map(move |up| (0.01 * f64::from(n), 0.01 * f64::from(up))));
        let surfel = |position, normal| Surfel { position, normal, weight: 1e6 };
        let along_x = cells().map(|(along, up)| surfel(Point3::new(along, 0.0, up), -Vector3::y()));
        let along_y = cells().map(|(along, up)| surfel(Point3::new(0.0, along, up), -Vector3::x()));
        Surfels::of(along_x.chain(along_y))
    }

    #[test]
    fn two_sides_of_a_box_have_a_crease_where_they_meet_and_it_is_told_once() {
        let surfels = two_sides();
        let view = ModelView { target: 3, epoch: 9, t: RigNs(5), unix: UnixNs(7), frames: 4, surfels: &surfels };
        let maker = ContourMaker::start(StreamOrigin::Simulated).expect("a thread");
        assert_eq!(maker.take(), None);
        maker.offer(&view);
        let began = Instant::now();
        let line = loop {
            assert!(began.elapsed() < Duration::from_secs(60), "no contour came");
            match maker.take() {
                Some(line) => break line,
                None => std::thread::sleep(Duration::from_millis(5)),
            }
        };
        assert_eq!((line.target, line.epoch, line.t_ns, line.planes, maker.take()), (3, 9, 5, 2, None));
        let creases: Vec<&ContourEdge> = line.edges.iter().filter(|edge| edge.kind == ContourKind::Crease).collect();
        let [crease] = creases[..] else { panic!("one crease, not {creases:?}") };
        let [from, to] = crease.ends_m;
        // x = y = 0 to a centimetre, from z = 0 to z = 0.39.
        assert!(from[0].abs().max(from[1].abs()).max(to[0].abs()).max(to[1].abs()) < 0.01, "{crease:?}");
        assert!(((to[2] - from[2]).abs() - 0.39).abs() < 0.03, "{crease:?}");
    }
}

//! Threads that hang in the USB library.
//!
//! The library waits for a device's answer without a limit, in a call that nothing can end. A thread that is caught there is
//! left behind: told to close and end as soon as it comes back, counted, and not waited for.

use core::time::Duration;
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// With this many threads hanging nothing is opened any more.
const MOST_HANGING: u64 = 3;
/// With one hanging, the next attempt is made only after this time: until then the device is the same one.
const NEXT_AFTER: Duration = Duration::from_secs(30);

/// One sensor's abandoned threads. Clones count together.
#[derive(Clone, Debug, Default)]
pub struct Abandoned(Arc<Counts>);

#[derive(Debug, Default)]
struct Counts {
    total: AtomicU64,
    hanging: AtomicU64,
    latest: Mutex<Option<Instant>>,
}

impl Abandoned {
    /// Threads left behind so far.
    pub fn total(&self) -> u64 {
        self.0.total.load(Ordering::SeqCst)
    }

    /// Those that have not come back.
    pub fn hanging(&self) -> u64 {
        self.0.hanging.load(Ordering::SeqCst)
    }

    /// Whether another thread may be set at the device.
    pub(crate) fn allows_another(&self) -> bool {
        let latest = *self.0.latest.lock().unwrap_or_else(PoisonError::into_inner);
        match self.hanging() {
            0 => true,
            hanging => hanging < MOST_HANGING && latest.is_none_or(|latest| latest.elapsed() >= NEXT_AFTER),
        }
    }

    /// A thread's entry in this count.
    pub(crate) fn presence(&self) -> Presence {
        Presence { counts: Arc::clone(&self.0), state: Arc::new(AtomicU8::new(RUNNING)) }
    }
}

const RUNNING: u8 = 0;
const LEFT_BEHIND: u8 = 1;
const ENDED: u8 = 2;

/// Whether one thread runs, was left behind, or has ended. The thread and its owner each hold one.
#[derive(Clone, Debug)]
pub(crate) struct Presence {
    counts: Arc<Counts>,
    state: Arc<AtomicU8>,
}

impl Presence {
    /// The owner gives the thread up. Without effect on one that has just ended.
    pub(crate) fn abandon(&self) {
        // Counted before the state is changed: a thread that ends in between must find itself counted.
        self.counts.hanging.fetch_add(1, Ordering::SeqCst);
        if self.state.compare_exchange(RUNNING, LEFT_BEHIND, Ordering::SeqCst, Ordering::SeqCst).is_ok() {
            self.counts.total.fetch_add(1, Ordering::SeqCst);
            *self.counts.latest.lock().unwrap_or_else(PoisonError::into_inner) = Some(Instant::now());
        } else {
            self.counts.hanging.fetch_sub(1, Ordering::SeqCst);
        }
    }

    /// The thread has come to its end.
    pub(crate) fn ended(&self) {
        if self.state.swap(ENDED, Ordering::SeqCst) == LEFT_BEHIND {
            self.counts.hanging.fetch_sub(1, Ordering::SeqCst);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thread_left_behind_counts_until_it_comes_back() {
        let abandoned = Abandoned::default();
        let presence = abandoned.presence();
        assert!(abandoned.allows_another());
        presence.abandon();
        presence.abandon();
        assert_eq!((abandoned.total(), abandoned.hanging()), (1, 1));
        assert!(!abandoned.allows_another(), "the same device, a moment later");
        presence.clone().ended();
        assert_eq!((abandoned.total(), abandoned.hanging()), (1, 0));
        assert!(abandoned.allows_another());
    }

    #[test]
    fn a_thread_that_ended_first_was_not_left_behind() {
        let abandoned = Abandoned::default();
        let presence = abandoned.presence();
        presence.ended();
        presence.abandon();
        assert_eq!((abandoned.total(), abandoned.hanging()), (0, 0));
    }
}

//! The usb thread's priority while frames come.
//!
//! The bus holds 32 ms of packets. On a machine whose processors are all busy an ordinary thread may wait for longer than
//! that, and each packet sent meanwhile is lost. So the thread asks for real-time priority, or at least to be preferred to
//! ordinary threads, for as long as its stream runs: it works for a few per cent of the time and sleeps else. Opening and
//! closing, where a faulty device can keep the library busy without an end, are done without it.

use core::fmt;

/// Above ordinary threads, below the kernel's own (interrupts: 50).
const REAL_TIME: libc::c_int = 20;
/// Where real time is not permitted: 9.5 times the weight of an ordinary thread.
const NICE: libc::c_int = -10;

/// What the system granted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Priority {
    /// Before every ordinary thread.
    RealTime,
    /// Preferred to ordinary threads, and still waiting for them at times.
    Preferred,
    /// As every other thread: a busy machine loses packets.
    Ordinary,
}

impl fmt::Display for Priority {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::RealTime => "real-time",
            Self::Preferred => "preferred",
            Self::Ordinary => "ordinary",
        })
    }
}

/// The calling thread's raised priority, until it is dropped: on the same thread.
#[derive(Debug)]
pub(crate) struct Raised {
    granted: Priority,
    /// What was changed and has to be changed back.
    undo: Undo,
}

#[derive(Debug)]
enum Undo {
    Nothing,
    Policy,
    Nice(libc::c_int),
}

impl Raised {
    /// Asks for as much as the system grants.
    pub(crate) fn ask() -> Self {
        // SAFETY: 0 is the calling thread; nothing else is touched.
        let policy = unsafe { libc::sched_getscheduler(0) };
        if policy & !libc::SCHED_RESET_ON_FORK != libc::SCHED_OTHER {
            // The administrator has chosen one for the whole service.
            let real_time = [libc::SCHED_FIFO, libc::SCHED_RR].contains(&(policy & !libc::SCHED_RESET_ON_FORK));
            let granted = if real_time { Priority::RealTime } else { Priority::Ordinary };
            return Self { granted, undo: Undo::Nothing };
        }
        if set_policy(libc::SCHED_RR | libc::SCHED_RESET_ON_FORK, REAL_TIME) {
            return Self { granted: Priority::RealTime, undo: Undo::Policy };
        }
        // SAFETY: 0 is the calling thread. -1 is a priority as well as an error: both mean what stands there by default.
        let before = unsafe { libc::getpriority(libc::PRIO_PROCESS, 0) };
        // SAFETY: the same.
        if before > NICE && unsafe { libc::setpriority(libc::PRIO_PROCESS, 0, NICE) } == 0 {
            return Self { granted: Priority::Preferred, undo: Undo::Nice(before) };
        }
        let granted = if before <= NICE { Priority::Preferred } else { Priority::Ordinary };
        Self { granted, undo: Undo::Nothing }
    }

    pub(crate) fn granted(&self) -> Priority {
        self.granted
    }
}

impl Drop for Raised {
    fn drop(&mut self) {
        // What cannot be taken back stays: the thread is about to close its device and to end.
        match self.undo {
            Undo::Nothing => {}
            Undo::Policy => {
                set_policy(libc::SCHED_OTHER, 0);
            }
            Undo::Nice(before) => {
                // SAFETY: 0 is the calling thread.
                unsafe { libc::setpriority(libc::PRIO_PROCESS, 0, before) };
            }
        }
    }
}

fn set_policy(policy: libc::c_int, priority: libc::c_int) -> bool {
    let parameters = libc::sched_param { sched_priority: priority };
    // SAFETY: 0 is the calling thread, and the parameters live here.
    unsafe { libc::sched_setscheduler(0, policy, &parameters) == 0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scheduled() -> (libc::c_int, libc::c_int) {
        // SAFETY: 0 is the calling thread.
        unsafe { (libc::sched_getscheduler(0) & !libc::SCHED_RESET_ON_FORK, libc::getpriority(libc::PRIO_PROCESS, 0)) }
    }

    #[test]
    fn a_raised_priority_is_as_it_was_granted_and_ends_with_its_guard() {
        let thread = std::thread::spawn(|| {
            let before = scheduled();
            let raised = Raised::ask();
            let (policy, nice) = scheduled();
            match raised.granted() {
                Priority::RealTime => assert!([libc::SCHED_RR, libc::SCHED_FIFO].contains(&policy), "{policy}"),
                Priority::Preferred => assert!(nice <= NICE, "{nice}"),
                Priority::Ordinary => assert_eq!((policy, nice), before),
            }
            drop(raised);
            assert_eq!(scheduled(), before);
        });
        thread.join().expect("no panic");
    }
}

//! How a thread is told to stop, wherever it waits.

use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sys::eventfd::{EfdFlags, EventFd};
use std::io;
use std::os::fd::{AsFd, BorrowedFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Told once, seen by every clone: a flag to look at and a descriptor to poll beside a socket.
#[derive(Clone, Debug)]
pub struct StopToken {
    shared: Arc<Shared>,
}

#[derive(Debug)]
struct Shared {
    stopped: AtomicBool,
    /// Readable from the stop on and for ever: it is never read, so it wakes every waiting thread.
    bell: EventFd,
}

impl StopToken {
    /// A token that nobody has stopped yet.
    ///
    /// # Errors
    /// When the process has no file descriptor left.
    pub fn new() -> io::Result<Self> {
        let bell = EventFd::from_flags(EfdFlags::EFD_CLOEXEC | EfdFlags::EFD_NONBLOCK)?;
        Ok(Self { shared: Arc::new(Shared { stopped: AtomicBool::new(false), bell }) })
    }

    /// Tells every holder to stop; again is without effect.
    pub fn stop(&self) {
        if !self.shared.stopped.swap(true, Ordering::SeqCst) {
            // A counter of 0 has room for 1: the write cannot fail.
            let rung = self.shared.bell.write(1);
            debug_assert!(rung.is_ok(), "an eventfd at 0 takes 1: {rung:?}");
        }
    }

    /// Whether it was told.
    pub fn is_stopped(&self) -> bool {
        self.shared.stopped.load(Ordering::SeqCst)
    }

    /// Waits until told, at most `time` (to the next millisecond up); whether it was told.
    pub fn wait(&self, time: Duration) -> bool {
        let until = Instant::now() + time;
        while !self.is_stopped() {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return false;
            }
            let millis = u16::try_from(left.as_nanos().div_ceil(1_000_000)).unwrap_or(u16::MAX);
            let mut bell = [PollFd::new(self.as_fd(), PollFlags::POLLIN)];
            match poll(&mut bell, PollTimeout::from(millis)) {
                Ok(_) | Err(Errno::EINTR) => {}
                // Without memory for a poll the wait still keeps its time.
                Err(_) => std::thread::sleep(left.min(Duration::from_millis(10))),
            }
        }
        true
    }

    /// Sleeps until an instant, exact to some 0.06 ms, or until told; how late it is then. A stop is noticed within
    /// 20 ms.
    pub fn sleep_until(&self, due: Instant) -> Duration {
        /// A poll wakes at whole milliseconds: the last part of a wait is a plain sleep.
        const SLEEP: Duration = Duration::from_millis(20);
        loop {
            let now = Instant::now();
            let left = due.saturating_duration_since(now);
            if left.is_zero() || self.is_stopped() {
                return now.saturating_duration_since(due);
            }
            if left <= SLEEP {
                std::thread::sleep(left);
            } else {
                self.wait(left - SLEEP);
            }
        }
    }
}

impl AsFd for StopToken {
    /// Readable once stopped.
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.shared.bell.as_fd()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stop_wakes_every_thread_that_waits() {
        let token = StopToken::new().expect("a descriptor");
        let waiting: Vec<_> = (0..3)
            .map(|_| {
                let token = token.clone();
                // Far beyond any test's time: only the stop can end it.
                std::thread::spawn(move || token.wait(Duration::from_secs(3_600)))
            })
            .collect();
        token.stop();
        token.stop();
        assert!(waiting.into_iter().all(|thread| thread.join().expect("no panic")));
        assert!(token.is_stopped());
    }

    #[test]
    fn without_a_stop_the_wait_keeps_its_time() {
        let token = StopToken::new().expect("a descriptor");
        let before = Instant::now();
        assert!(!token.wait(Duration::from_millis(20)));
        assert!(before.elapsed() >= Duration::from_millis(20));
    }
}

//! What a machine that is too slow leaves out of a scene.

use std::sync::atomic::{AtomicBool, AtomicI64, AtomicU64, Ordering};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tumbled_model::{RigNs, Span};

/// For so long after it was behind, health speaks of it.
const RECENT: Span = Span(10_000_000_000);

/// The counts, written by the simulation's two threads.
#[derive(Debug, Default)]
pub struct Shortfall {
    left_out_ns: AtomicU64,
    late: AtomicU64,
    refused: AtomicU64,
    latest_ns: AtomicI64,
    /// When something was left out last, plus 1; 0: never.
    last: AtomicI64,
    told: AtomicBool,
}

/// What a scene in real time left out because this machine was too slow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ShortfallReport {
    /// Time of the scene that was not made, s.
    pub left_out_s: f64,
    /// Packets and frames that were made and came too late to be sent.
    pub late: u64,
    /// Packets that the system did not send.
    pub refused: u64,
    /// The furthest that anything sent was behind its time, ms.
    pub latest_ms: f64,
}

impl Shortfall {
    /// A stretch of the scene was not made.
    pub(super) fn left_out(&self, now: RigNs, time: Span) {
        self.left_out_ns.fetch_add(time.0.max(0).unsigned_abs(), Ordering::Relaxed);
        self.behind(now);
    }

    /// An item came too late to be sent.
    pub(super) fn late(&self, now: RigNs) {
        self.late.fetch_add(1, Ordering::Relaxed);
        self.behind(now);
    }

    /// The system did not send a datagram.
    pub(super) fn refused(&self) {
        self.refused.fetch_add(1, Ordering::Relaxed);
    }

    /// An item was sent so late.
    pub(super) fn sent(&self, late: Span) {
        self.latest_ns.fetch_max(late.0, Ordering::Relaxed);
    }

    /// The counts now.
    pub fn report(&self) -> ShortfallReport {
        ShortfallReport {
            left_out_s: self.left_out_ns.load(Ordering::Relaxed) as f64 / 1e9,
            late: self.late.load(Ordering::Relaxed),
            refused: self.refused.load(Ordering::Relaxed),
            latest_ms: self.latest_ns.load(Ordering::Relaxed) as f64 / 1e6,
        }
    }

    /// Whether something was left out in the last ten seconds.
    pub fn is_recent(&self, now: RigNs) -> bool {
        let last = self.last.load(Ordering::Relaxed);
        last > 0 && now - RigNs(last) <= RECENT
    }

    fn behind(&self, now: RigNs) {
        self.last.store(now.0.saturating_add(1), Ordering::Relaxed);
        if !self.told.swap(true, Ordering::Relaxed) {
            tracing::warn!(
                "this machine is too slow for the simulated sensors at the moment: data are left out, as if they had been \
                 lost on the way; health counts them"
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_left_out_is_counted_and_recent_for_ten_seconds() {
        let (shortfall, s) = (Shortfall::default(), |s: i64| RigNs(s * 1_000_000_000));
        assert!(!shortfall.is_recent(s(0)));
        shortfall.sent(Span(2_500_000));
        shortfall.sent(Span(1_000_000));
        assert!(!shortfall.is_recent(s(1)), "late and sent is nothing left out");
        shortfall.left_out(s(2), Span(300_000_000));
        shortfall.late(s(4));
        let expected = ShortfallReport { left_out_s: 0.3, late: 1, refused: 0, latest_ms: 2.5 };
        assert_eq!(shortfall.report(), expected);
        assert!(shortfall.is_recent(s(14)) && !shortfall.is_recent(s(15)));
    }
}

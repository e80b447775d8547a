//! What following a stream of packets tells: each packet's place in it, and the running totals.

/// Running totals of one sensor's packet stream.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StreamTotals {
    /// Packets seen.
    pub received: u64,
    /// Packets that the stamps say were sent and that never came, late ones taken off again.
    pub lost: u64,
    /// Places where packets are missing.
    pub gaps: u64,
    /// Most packets missing in one place.
    pub longest_gap: u64,
    /// Packets that came twice.
    pub duplicates: u64,
    /// Packets that came after a later one.
    pub late: u64,
    /// Packets whose stamps fitted nothing before them: broken, forged, or the first of a counter that was set anew.
    pub doubtful: u64,
    /// Times the counter was set anew.
    pub resets: u64,
    /// Silences of a limited field of view.
    pub pauses: u64,
}

/// How a packet stands to the ones before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// The first, or the next after `lost` missing ones.
    Next {
        /// Packets missing just before it.
        lost: u64,
    },
    /// Its stamp has been seen before.
    Duplicate,
    /// Older than the newest one seen.
    Late,
    /// Its stamp fits nothing before it: broken, forged, or the first of a counter that was set anew.
    Doubtful,
    /// The counter was set anew just before this packet or the doubtful ones that it agrees with; what was lost there
    /// cannot be known.
    Reset,
}

/// What the tracker says of a packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Observation {
    /// Its place in the stream.
    pub order: Order,
    /// The silence inside the packet before this one, if that had an azimuth jump, ns.
    pub previous_pause_ns: Option<i64>,
}

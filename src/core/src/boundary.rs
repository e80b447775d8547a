//! Where a scan begins, told from raw bytes alone: cheap enough for the ledger, which sheds whole scans under load, and
//! the same in the core, which has to know where a shed scan ends.

use crate::config::CoreConfig;
use crate::sector::{Sector, TURN_CDEG};
use std::collections::BTreeMap;
use tumbled_model::{Body, LidarTime, SensorId};
use tumbled_velodyne::DataPacket;

/// Follows every sensor's data and tells where a scan begins: a Kinect's with each frame, a LiDAR's with the packet
/// after its head has passed the cut behind the region of interest.
#[derive(Clone, Debug)]
pub struct ScanBoundaries {
    lidars: BTreeMap<SensorId, Cut>,
}

/// A packet that starts so little behind the newest one was overtaken by it (three packets of 1200 rpm), unless its stamp
/// says that it is a narrow view's next pass.
const BACKWARDS_CDEG: i32 = 1_500;
/// So little behind, it is jitter of a slow or standing motor, whatever the stamp says.
const JITTER_CDEG: i32 = 50;
/// A stamp that lies up to 1 s behind the newest is of a packet that was overtaken; farther, of a clock that was set.
const OVERTAKEN_NS: i64 = 1_000_000_000;
/// From scan to scan the head turns at least so far: jitter of the encoder at the cut begins none.
const LEAST_SCAN_CDEG: i32 = TURN_CDEG / 2;

#[derive(Clone, Debug)]
struct Cut {
    sector: Sector,
    /// Where the head stood at the newest packet's start, and its stamp.
    newest: Option<(i32, LidarTime)>,
    /// How far it has turned since the last scan began, 0.01°; a little over two turns at most.
    turned: i32,
}

impl ScanBoundaries {
    /// Boundaries for a rig.
    pub fn new(config: &CoreConfig) -> Self {
        let cut = |setup: &crate::config::LidarSetup| Cut {
            sector: Sector::new(&config.roi, &setup.t_rig_lidar),
            newest: None,
            turned: LEAST_SCAN_CDEG,
        };
        Self { lidars: config.lidars.iter().map(|setup| (setup.id.clone(), cut(setup))).collect() }
    }

    /// Whether a scan of its sensor begins with this item. Show it every item, in the ledger's order.
    pub fn begins(&mut self, body: &Body) -> bool {
        match body {
            Body::DepthFrame { .. } => true,
            Body::LidarPacket { sensor, bytes } => self.lidars.get_mut(sensor).is_some_and(|cut| cut.begins(bytes)),
            _ => false,
        }
    }
}

impl Cut {
    fn begins(&mut self, payload: &[u8]) -> bool {
        let Ok(packet) = DataPacket::new(payload) else { return false };
        let Some(azimuth) = packet.azimuths().ok().and_then(|azimuths| azimuths.first().copied()) else {
            return false;
        };
        let (offset, stamp) = (self.sector.offset(azimuth), packet.stamp());
        let Some((from, before)) = self.newest else {
            self.newest = Some((offset, stamp));
            return true;
        };
        let way = (offset - from).rem_euclid(TURN_CDEG);
        let later = stamp.since(before).0;
        let is_overtaken = (-OVERTAKEN_NS..0).contains(&later);
        if is_overtaken || way > TURN_CDEG - JITTER_CDEG || (way > TURN_CDEG - BACKWARDS_CDEG && later <= 0) {
            return false;
        }
        self.newest = Some((offset, stamp));
        self.turned += way;
        let begins = way >= self.sector.to_cut(from) && self.turned >= LEAST_SCAN_CDEG;
        if begins {
            self.turned = 0;
        }
        begins
    }
}

/// Which of a sensor's scans a live session shed.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Shedding {
    owed: u32,
    active: bool,
    scans: u64,
}

impl Shedding {
    /// Takes note of a skip: it stands in the ledger ahead of the scans it covers.
    pub(crate) fn skip(&mut self, scans: u16) {
        self.owed = self.owed.saturating_add(u32::from(scans));
    }

    /// Whether an item belongs to a shed scan.
    pub(crate) fn covers(&mut self, begins_scan: bool) -> bool {
        if begins_scan {
            self.active = self.owed > 0;
            self.owed = self.owed.saturating_sub(1);
            self.scans += u64::from(self.active);
        }
        self.active
    }

    /// Scans shed so far.
    pub(crate) fn scans(&self) -> u64 {
        self.scans
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_skip_covers_the_next_scan_and_no_more() {
        let mut shedding = Shedding::default();
        assert!(!shedding.covers(true) && !shedding.covers(false));
        shedding.skip(1);
        assert!(!shedding.covers(false), "the scan it stands in is not shed");
        assert!(shedding.covers(true) && shedding.covers(false));
        assert!(!shedding.covers(true));
        assert_eq!(shedding.scans(), 1);
    }
}

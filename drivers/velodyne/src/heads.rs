//! Where the sensor's head stood during a packet, whether or not anything came back.

use crate::azimuth::Turning;
use crate::wire::BLOCKS;

/// The head at the start of one firing group.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Head {
    /// Azimuth, 0.01°, clockwise from above.
    pub cdeg: u16,
    /// Time after the packet's own stamp, ns, as [`crate::LidarPoint::dt_ns`].
    pub dt_ns: i32,
}

/// The head at each firing group of one packet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Heads {
    heads: [Head; BLOCKS],
    groups: u8,
    /// Columns ([`crate::LidarPoint::column`]) of one group: 1, for the VLP-16 and for the HDL-64E in dual return 2.
    columns: u8,
    step_cdeg: i32,
}

/// How a packet's firing groups lie in time.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GroupTimes {
    /// From the packet's first firing to the next packet's, ns.
    pub(crate) period_ns: i64,
    /// Of the first firing, after the stamp.
    pub(crate) shift_ns: i32,
    /// Silence at the azimuth jumps.
    pub(crate) pause_ns: i64,
    /// Columns of one group.
    pub(crate) columns: u8,
}

impl Heads {
    pub(crate) fn new(turning: &Turning, times: GroupTimes) -> Self {
        let mut heads = [Head::default(); BLOCKS];
        let groups = turning.groups.clamp(1, BLOCKS);
        for (group, (head, cdeg)) in heads.iter_mut().zip(&turning.base_cdeg).take(groups).enumerate() {
            let start_ns = times.period_ns * group as i64 / groups as i64;
            let pause_ns = turning.jumps.pause_before_ns(group, times.pause_ns);
            *head = Head { cdeg: *cdeg, dt_ns: (i64::from(times.shift_ns) + start_ns + pause_ns) as i32 };
        }
        Self { heads, groups: groups as u8, columns: times.columns.max(1), step_cdeg: turning.median_cdeg }
    }

    /// The groups' heads, in firing order.
    pub fn as_slice(&self) -> &[Head] {
        self.heads.get(..usize::from(self.groups)).unwrap_or_default()
    }

    /// The first column that belongs to a group.
    pub fn first_column(&self, group: usize) -> u8 {
        group.min(BLOCKS) as u8 * self.columns
    }

    /// How far the head turns from group to group, 0.01°, jumps left out.
    pub fn step_cdeg(&self) -> i32 {
        self.step_cdeg
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_behind_a_jump_come_later_by_the_pause() {
        let mut azimuth = [0u16; BLOCKS];
        for (group, azimuth) in azimuth.iter_mut().enumerate() {
            // 20 cdeg a group, and 180 degrees more from the sixth on.
            *azimuth = 20 * group as u16 + if group < 6 { 0 } else { 18_000 };
        }
        let turning = Turning::measure(&azimuth, 1);
        let times = GroupTimes { period_ns: 663_552, shift_ns: 0, pause_ns: 50_000_000, columns: 1 };
        let heads = Heads::new(&turning, times);
        assert_eq!(heads.as_slice().len(), 12);
        // 5/12 and 6/12 of 663,552 ns.
        assert_eq!(heads.as_slice()[5], Head { cdeg: 100, dt_ns: 276_480 });
        assert_eq!(heads.as_slice()[6], Head { cdeg: 18_120, dt_ns: 331_776 + 50_000_000 });
        assert_eq!(heads.step_cdeg(), 20);
    }
}

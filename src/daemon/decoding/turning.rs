//! How fast a LiDAR's head turns, and whether a whole turn was seen.

use tumbled_velodyne::azimuth::forward_cdeg;

/// Adds up the turning from packet to packet where nothing is missing between them.
#[derive(Debug, Default)]
pub struct HeadTurning {
    last: Option<(i64, u16)>,
    turned_cdeg: i64,
    span_ns: i64,
    last_packet_cdeg: i64,
}

impl HeadTurning {
    /// Takes one packet: its time (any origin, ns), the azimuths of its first and last firings, 0.01°, and whether it
    /// follows the packet before it without loss, so that less than a turn lies between them.
    pub fn packet(&mut self, t_ns: i64, (first_cdeg, last_cdeg): (u16, u16), follows: bool) {
        if let (Some((before_ns, before_cdeg)), true) = (self.last, follows) {
            self.turned_cdeg += i64::from(forward_cdeg(before_cdeg, first_cdeg));
            self.span_ns += t_ns - before_ns;
        }
        self.last_packet_cdeg = i64::from(forward_cdeg(first_cdeg, last_cdeg));
        self.last = Some((t_ns, first_cdeg));
    }

    /// Time of the newest packet.
    pub fn last_ns(&self) -> Option<i64> {
        self.last.map(|(t_ns, _)| t_ns)
    }

    /// Mean speed, turns per minute; `None` before two packets in a row.
    pub fn rpm(&self) -> Option<f64> {
        (self.span_ns > 0).then(|| self.turned_cdeg as f64 / 36_000.0 * 60e9 / self.span_ns as f64)
    }

    /// Whether a whole turn was seen without loss in it.
    pub fn whole_turn(&self) -> bool {
        self.turned_cdeg + self.last_packet_cdeg >= 36_000
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn speed_is_that_of_the_steps_without_loss() {
        let mut head = HeadTurning::default();
        head.packet(0, (35_900, 35_990), true);
        head.packet(1_000_000, (260, 350), true); // 3.6° in 1 ms: 10 turns a second
        head.packet(90_000_000, (100, 190), false); // loss: says nothing
        head.packet(91_000_000, (460, 550), true);
        assert_eq!(head.rpm(), Some(600.0));
        assert!(!head.whole_turn());
    }

    #[test]
    fn a_motor_that_stands_does_not_turn() {
        let mut head = HeadTurning::default();
        for k in 0..100 {
            head.packet(k * 1_000_000, (17_000 + (k as u16 & 1), 17_000), true);
        }
        // Jitter of 0.01° cancels but for the last step: 0.01° in 99 ms is 0.017 rpm.
        assert!(head.rpm().is_some_and(|rpm| rpm.abs() < 0.02), "{:?}", head.rpm());
        assert!(!head.whole_turn());
    }
}

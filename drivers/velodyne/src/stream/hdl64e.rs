//! The HDL-64E's way through the stream decoder: its own decoder places the points, the rest is shared.

use super::{Arrival, Decoded, Held, PacketInfo, Rejection, StreamDecoder};
use crate::azimuth::Turning;
use crate::hdl64::{Hdl64Decoder, Hdl64Packet};
use crate::heads::{GroupTimes, Heads};
use crate::models::ReturnMode;
use crate::track::Order;
use crate::wire::{BLOCKS, DataPacket};

impl StreamDecoder {
    pub(super) fn push_hdl64(
        &mut self,
        packet: &DataPacket<'_>,
        azimuths: &[u16; BLOCKS],
        payload: &[u8],
        arrival: Arrival,
        out: &mut Decoded,
    ) -> Result<(), Rejection> {
        let mode = match self.hdl64_newest {
            Some(newest) if newest.dual => ReturnMode::Dual,
            _ => ReturnMode::Strongest,
        };
        // A firing is two blocks, upper and lower bank, in dual return four. An S1 fires by the block, and has no clock.
        let turning = Turning::measure(azimuths, 2 * mode.blocks_per_firing());
        let clocked = self.hdl64_newest.filter(|newest| newest.stamped);
        let order = match clocked {
            Some(newest) => self.observe(packet, arrival, i64::from(newest.period_ns), &turning, out),
            None => Order::Next { lost: 0 },
        };
        let held = Held { arrival, mode, turning, order };
        if clocked.is_some() && self.hold(held, payload) {
            return Ok(());
        }
        let pause_ns = match clocked {
            Some(newest) if !turning.jumps.is_empty() => {
                self.tracker.pause_of_ns(&turning, i64::from(newest.period_ns))
            }
            _ => 0,
        };
        let read = self.decode_hdl64(packet, held, pause_ns, out)?;
        if clocked.is_none() {
            if read.stamped {
                self.tracker.observe(packet.stamp(), arrival.arrived, i64::from(read.period_ns), &turning);
            } else {
                self.tracker.count_unstamped();
            }
        }
        Ok(())
    }

    pub(super) fn decode_hdl64(
        &mut self,
        packet: &DataPacket<'_>,
        held: Held,
        pause_ns: i64,
        out: &mut Decoded,
    ) -> Result<Hdl64Packet, Rejection> {
        let calibration = &self.settings.hdl64e_calibration;
        let decoder = self.hdl64.get_or_insert_with(|| Hdl64Decoder::new(calibration.clone()));
        let start = out.points.len();
        let read = decoder.decode(packet, &mut out.points)?;
        self.hdl64_newest = Some(read);
        if read.stamped {
            match decoder.status().gps_time() {
                Some(utc) => self.clock.update_utc(packet.stamp(), utc),
                None if decoder.status().gps.is_some() => self.clock.invalidate(),
                None => {}
            }
        }
        if read.uncalibrated {
            return Err(Rejection::Uncalibrated);
        }
        if pause_ns != 0 {
            let times = out.points.dt_ns.iter_mut().zip(&out.points.column).skip(start);
            for (dt_ns, column) in times {
                *dt_ns += held.turning.jumps.pause_before_ns(usize::from(*column), pause_ns) as i32;
            }
        }
        let mode = if read.dual { ReturnMode::Dual } else { ReturnMode::Strongest };
        // An S1's times count from the packet's end.
        let shift_ns = if read.stamped { 0 } else { -read.period_ns };
        let columns = mode.blocks_per_firing() as u8;
        let times = GroupTimes { period_ns: i64::from(read.period_ns), shift_ns, pause_ns, columns };
        self.keep_in_range(start, &mut out.points);
        out.packets.push(PacketInfo {
            index: held.arrival.index,
            arrived: held.arrival.arrived,
            stamp: read.stamped.then(|| packet.stamp()),
            points: start..out.points.len(),
            mode,
            azimuth_cdeg: (read.azimuth_first_cdeg, read.azimuth_last_cdeg),
            azimuth_jump: read.azimuth_jump,
            pause_ns,
            heads: Heads::new(&held.turning, times),
            order: held.order,
        });
        self.counts.data_packets += 1;
        *self.counts.modes.entry(mode).or_default() += 1;
        Ok(read)
    }
}

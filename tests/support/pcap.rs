//! Captures made for tests.

/// One UDP datagram to the rig.
pub(crate) struct Datagram {
    /// Host stamp, ns after the capture's start.
    pub(crate) t_ns: i64,
    /// Destination port.
    pub(crate) port: u16,
    pub(crate) payload: Vec<u8>,
}

/// 22 November 2026, 10:00:00 UTC: the wall time of every made capture's start, s.
pub(crate) const START_UNIX_S: i64 = 1_795_341_600;

/// A pcap with nanosecond stamps, Ethernet frames from a LiDAR's default address to the broadcast address.
pub(crate) fn write_pcap(datagrams: &[Datagram]) -> Vec<u8> {
    let mut file = Vec::new();
    // Magic of nanosecond files, version 2.4, no time zone, whole packets, Ethernet.
    for word in [0xa1b2_3c4d_u32, 2 | 4 << 16, 0, 0, 65_535, 1] {
        file.extend(word.to_le_bytes());
    }
    for Datagram { t_ns, port, payload } in datagrams {
        let frame = frame(*port, payload);
        let seconds = START_UNIX_S + t_ns.div_euclid(1_000_000_000);
        for word in [seconds as u32, t_ns.rem_euclid(1_000_000_000) as u32, frame.len() as u32, frame.len() as u32] {
            file.extend(word.to_le_bytes());
        }
        file.extend(frame);
    }
    file
}

fn frame(port: u16, payload: &[u8]) -> Vec<u8> {
    let udp_len = (8 + payload.len()) as u16;
    let mut ip = Vec::new();
    ip.extend([0x45, 0]);
    ip.extend((20 + udp_len).to_be_bytes());
    ip.extend([0, 0, 0x40, 0, 64, 17, 0, 0, 192, 168, 1, 201, 255, 255, 255, 255]);
    let sum: u32 = ip.chunks(2).map(|pair| u32::from(u16::from_be_bytes([pair[0], pair[1]]))).sum();
    let checksum = !((sum & 0xFFFF) + (sum >> 16)) as u16;
    ip[10..12].copy_from_slice(&checksum.to_be_bytes());
    let mut frame = vec![0xFF; 6];
    frame.extend([0x60, 0x76, 0x88, 0, 0, 1, 8, 0]);
    frame.extend(ip);
    frame.extend(2368u16.to_be_bytes());
    frame.extend(port.to_be_bytes());
    frame.extend(udp_len.to_be_bytes());
    frame.extend([0, 0]);
    frame.extend(payload);
    frame
}

//! From a captured frame of the network to the UDP datagram in it.

use etherparse::{EtherType, LaxNetSlice, LaxSlicedPacket, TransportSlice, ip_number};
use std::net::IpAddr;

/// Layer below IP, by the numbers of <https://www.tcpdump.org/linktypes.html>.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LinkType {
    /// 1: Ethernet II, VLAN tags included.
    Ethernet,
    /// 113: Linux cooked, 16-byte header, protocol at byte 14.
    LinuxCooked,
    /// 276: Linux cooked version 2, 20-byte header, protocol at byte 0.
    LinuxCooked2,
    /// 101, 228, 229 (and 12, 14 of some BSDs): IP without anything before it.
    RawIp,
    /// 0, 108: four bytes with the address family, in the capturing host's or in network order.
    Loopback,
}

impl LinkType {
    pub(crate) fn from_number(number: u16) -> Option<Self> {
        match number {
            1 => Some(Self::Ethernet),
            113 => Some(Self::LinuxCooked),
            276 => Some(Self::LinuxCooked2),
            12 | 14 | 101 | 228 | 229 => Some(Self::RawIp),
            0 | 108 => Some(Self::Loopback),
            _ => None,
        }
    }
}

/// What a frame carries.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Content<'a> {
    /// A datagram; `payload` may be shorter than `claimed` when the capture cut it.
    Udp {
        source: IpAddr,
        destination_port: u16,
        /// Payload length by the UDP header, bytes.
        claimed: usize,
        /// What the file has of it, never more than `claimed`.
        payload: &'a [u8],
    },
    /// A part of a fragmented IP packet.
    Fragment,
    /// Anything that is not UDP over IP.
    NotUdp,
    /// Headers that end early or contradict themselves.
    Malformed,
}

/// Address families of IPv4 (2) and IPv6 (10, 23, 24, 28, 30: every system chose its own).
const IP_FAMILIES: [u32; 6] = [2, 10, 23, 24, 28, 30];

/// Finds the datagram in a frame. Never fails: what it cannot read it names.
pub(crate) fn dissect(link: LinkType, frame: &[u8]) -> Content<'_> {
    let sliced = match link {
        LinkType::Ethernet => LaxSlicedPacket::from_ethernet(frame).ok(),
        LinkType::LinuxCooked => behind_cooked_header(frame, 14, 16),
        LinkType::LinuxCooked2 => behind_cooked_header(frame, 0, 20),
        LinkType::RawIp => LaxSlicedPacket::from_ip(frame).ok(),
        LinkType::Loopback => {
            let Some((family, packet)) = frame.split_first_chunk::<4>() else {
                return Content::Malformed;
            };
            let is_ip = |family| IP_FAMILIES.contains(&family);
            if !is_ip(u32::from_le_bytes(*family)) && !is_ip(u32::from_be_bytes(*family)) {
                return Content::NotUdp;
            }
            LaxSlicedPacket::from_ip(packet).ok()
        }
    };
    sliced.map_or(Content::Malformed, content)
}

fn behind_cooked_header(frame: &[u8], protocol_at: usize, header: usize) -> Option<LaxSlicedPacket<'_>> {
    let protocol = frame.get(protocol_at..)?.first_chunk::<2>()?;
    Some(LaxSlicedPacket::from_ether_type(EtherType(u16::from_be_bytes(*protocol)), frame.get(header..)?))
}

fn content(packet: LaxSlicedPacket<'_>) -> Content<'_> {
    let (source, ip_payload) = match &packet.net {
        Some(LaxNetSlice::Ipv4(ip)) => (IpAddr::V4(ip.header().source_addr()), ip.payload()),
        Some(LaxNetSlice::Ipv6(ip)) => (IpAddr::V6(ip.header().source_addr()), ip.payload()),
        Some(LaxNetSlice::Arp(_)) => return Content::NotUdp,
        None if packet.stop_err.is_some() => return Content::Malformed,
        None => return Content::NotUdp,
    };
    if ip_payload.fragmented {
        return Content::Fragment;
    }
    match packet.transport {
        Some(TransportSlice::Udp(udp)) => {
            let payload = udp.payload();
            let claimed = match usize::from(udp.length()) {
                // IPv6 jumbograms and offloading cards leave 0 there: the IP length then holds.
                0 => payload.len(),
                length if length < 8 => return Content::Malformed,
                length => length - 8,
            };
            Content::Udp { source, destination_port: udp.destination_port(), claimed, payload }
        }
        Some(_) => Content::NotUdp,
        None if ip_payload.ip_number == ip_number::UDP || packet.stop_err.is_some() => Content::Malformed,
        None => Content::NotUdp,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use etherparse::PacketBuilder;
    use proptest::prelude::*;

    const SOURCE: [u8; 4] = [192, 168, 1, 201];

    fn ip_packet(payload: &[u8]) -> Vec<u8> {
        let builder = PacketBuilder::ipv4(SOURCE, [255; 4], 64).udp(443, 2368);
        let mut packet = Vec::new();
        builder.write(&mut packet, payload).unwrap();
        packet
    }

    fn udp<'a>(content: &Content<'a>) -> (IpAddr, u16, usize, &'a [u8]) {
        match *content {
            Content::Udp { source, destination_port, claimed, payload } => (source, destination_port, claimed, payload),
            ref other => panic!("{other:?} where UDP was expected"),
        }
    }

    #[test]
    fn every_link_type_leads_to_the_same_datagram() {
        let payload = [7u8; 1206];
        let ip = ip_packet(&payload);
        let ethernet = [&[0xff; 6][..], &[2; 6], &[0x08, 0x00], &ip].concat();
        let vlan = [&[0xff; 6][..], &[2; 6], &[0x81, 0x00, 0x00, 0x05, 0x08, 0x00], &ip].concat();
        let cooked = [&[0, 0, 0, 1, 0, 6, 1, 2, 3, 4, 5, 6, 0, 0, 0x08, 0x00][..], &ip].concat();
        let cooked2 = [&[0x08, 0x00, 0, 0, 0, 0, 0, 2, 0, 1, 0, 6, 1, 2, 3, 4, 5, 6, 0, 0][..], &ip].concat();
        let loopback_le = [&2u32.to_le_bytes()[..], &ip].concat();
        let loopback_be = [&2u32.to_be_bytes()[..], &ip].concat();
        for (number, frame) in [
            (1, &ethernet),
            (1, &vlan),
            (113, &cooked),
            (276, &cooked2),
            (101, &ip),
            (228, &ip),
            (0, &loopback_le),
            (108, &loopback_be),
        ] {
            let link = LinkType::from_number(number).unwrap();
            let expected = (IpAddr::from(SOURCE), 2368, 1206, &payload[..]);
            assert_eq!(udp(&dissect(link, frame)), expected, "link type {number}");
        }
    }

    #[test]
    fn ip_options_ipv6_and_ethernet_padding_do_not_reach_the_payload() {
        // 3 payload bytes make a 45-byte frame, which the wire pads to 60: the padding is no data.
        let mut frame = Vec::new();
        let options = etherparse::Ipv4Options::try_from(&[1u8, 1, 1, 0][..]).unwrap();
        let ip = etherparse::Ipv4Header { options, ..ipv4_header(3) };
        PacketBuilder::ethernet2([2; 6], [255; 6])
            .ip(etherparse::IpHeaders::Ipv4(ip, etherparse::Ipv4Extensions::default()))
            .udp(443, 2368)
            .write(&mut frame, &[1, 2, 3])
            .unwrap();
        frame.resize(60, 0xee);
        assert_eq!(udp(&dissect(LinkType::Ethernet, &frame)).3, [1, 2, 3]);

        let mut frame = Vec::new();
        PacketBuilder::ipv6([1; 16], [2; 16], 64).udp(443, 2368).write(&mut frame, &[1, 2, 3]).unwrap();
        frame.extend([0xee; 5]);
        let content = dissect(LinkType::RawIp, &frame);
        assert_eq!(udp(&content), (IpAddr::from([1u8; 16]), 2368, 3, &[1u8, 2, 3][..]));
    }

    fn ipv4_header(payload: u16) -> etherparse::Ipv4Header {
        etherparse::Ipv4Header::new(payload + 8, 64, ip_number::UDP, SOURCE, [255; 4]).unwrap()
    }

    #[test]
    fn fragments_tcp_arp_and_broken_headers_are_told_apart() {
        let mut fragment = ip_packet(&[0; 100]);
        fragment[6] = 0x20; // more fragments
        assert_eq!(dissect(LinkType::RawIp, &fragment), Content::Fragment);
        let mut tcp = Vec::new();
        PacketBuilder::ipv4(SOURCE, [255; 4], 64).tcp(1, 2368, 0, 0).write(&mut tcp, &[]).unwrap();
        assert_eq!(dissect(LinkType::RawIp, &tcp), Content::NotUdp);
        let arp = [&[0xff; 12][..], &[0x08, 0x06], &[0; 46]].concat();
        assert_eq!(dissect(LinkType::Ethernet, &arp), Content::NotUdp);
        let mut short_length = ip_packet(&[0; 100]);
        short_length[25] = 7; // the UDP header alone has 8 bytes
        short_length[24] = 0;
        assert_eq!(dissect(LinkType::RawIp, &short_length), Content::Malformed);
        assert_eq!(dissect(LinkType::Ethernet, &[1, 2, 3]), Content::Malformed);
        assert_eq!(dissect(LinkType::Loopback, &[7, 0, 0, 0, 0x45]), Content::NotUdp);
    }

    #[test]
    fn a_cut_datagram_still_says_how_long_it_was() {
        let ip = ip_packet(&[9; 1206]);
        let (_, port, claimed, payload) = udp(&dissect(LinkType::RawIp, &ip[..96]));
        // 96 bytes less 20 of IP and 8 of UDP.
        assert_eq!((port, claimed, payload.len()), (2368, 1206, 68));
    }

    proptest! {
        #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::default() })]
        #[test]
        fn any_frame_gives_a_payload_no_longer_than_its_header_says(
            number in prop::sample::select(vec![0u16, 1, 101, 113, 276]),
            mut frame in prop::collection::vec(any::<u8>(), 0..200),
            make_ip in any::<bool>(),
        ) {
            if make_ip && frame.len() > 40 {
                // Steer half of the inputs past the first headers.
                let base = match number { 1 => 14, 113 => 16, 276 => 20, 0 => 4, _ => 0 };
                match number { 1 => frame[12..14].copy_from_slice(&[8, 0]), 113 => frame[14..16].copy_from_slice(&[8, 0]),
                    276 => frame[..2].copy_from_slice(&[8, 0]), 0 => frame[..4].copy_from_slice(&[2, 0, 0, 0]), _ => {} }
                frame[base] = 0x45;
                frame[base + 9] = 17;
            }
            if let Content::Udp { claimed, payload, .. } = dissect(LinkType::from_number(number).unwrap(), &frame) {
                prop_assert!(payload.len() <= claimed);
                prop_assert!(payload.len() + 8 <= frame.len());
            }
        }
    }
}

//! Network interfaces and the networks they are in.

use core::fmt;
use nix::ifaddrs::getifaddrs;
use nix::net::if_::InterfaceFlags;
use nix::sys::socket::SockaddrStorage;
use std::collections::BTreeMap;
use std::io;
use std::net::IpAddr;

/// A network interface.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Interface {
    /// Its name, e.g. `eth0`.
    pub name: String,
    /// It is switched on and has a carrier.
    pub running: bool,
    /// It leads to this machine alone.
    pub loopback: bool,
    /// Its addresses.
    pub networks: Vec<Network>,
}

/// An interface's address and the network around it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Network {
    /// The address.
    pub address: IpAddr,
    /// Leading bits that all addresses of the network share, 0 to 32 or 128.
    pub prefix: u32,
}

impl Network {
    /// Whether an address is of this network, so that it is reached without a router.
    pub fn contains(&self, other: IpAddr) -> bool {
        let (mine, theirs, bits) = match (self.address, other.to_canonical()) {
            (IpAddr::V4(mine), IpAddr::V4(theirs)) => (u128::from(mine.to_bits()), u128::from(theirs.to_bits()), 32),
            (IpAddr::V6(mine), IpAddr::V6(theirs)) => (mine.to_bits(), theirs.to_bits(), 128),
            _ => return false,
        };
        let host_bits = bits - self.prefix.min(bits);
        (mine ^ theirs).checked_shr(host_bits).is_none_or(|different| different == 0)
    }
}

/// `192.168.1.5/24`.
impl fmt::Display for Network {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.address, self.prefix)
    }
}

/// The interfaces of this machine, by name.
///
/// # Errors
/// What the system says.
pub fn interfaces() -> io::Result<Vec<Interface>> {
    let mut found: BTreeMap<String, Interface> = BTreeMap::new();
    for entry in getifaddrs()? {
        let interface = found.entry(entry.interface_name.clone()).or_insert_with(|| Interface {
            name: entry.interface_name.clone(),
            running: entry.flags.contains(InterfaceFlags::IFF_UP | InterfaceFlags::IFF_RUNNING),
            loopback: entry.flags.contains(InterfaceFlags::IFF_LOOPBACK),
            networks: Vec::new(),
        });
        if let Some(address) = entry.address.as_ref().and_then(ip) {
            let prefix = entry.netmask.as_ref().and_then(ip).map_or(0, ones);
            interface.networks.push(Network { address, prefix });
        }
    }
    Ok(found.into_values().collect())
}

fn ip(address: &SockaddrStorage) -> Option<IpAddr> {
    let v4 = address.as_sockaddr_in().map(|v4| IpAddr::V4(v4.ip()));
    v4.or_else(|| address.as_sockaddr_in6().map(|v6| IpAddr::V6(v6.ip())))
}

fn ones(mask: IpAddr) -> u32 {
    match mask {
        IpAddr::V4(mask) => mask.to_bits().count_ones(),
        IpAddr::V6(mask) => mask.to_bits().count_ones(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn network(address: &str, prefix: u32) -> Network {
        Network { address: address.parse().expect("an address"), prefix }
    }

    #[test]
    fn a_network_is_the_addresses_that_share_its_prefix() {
        let contains = |network: Network, other: &str| network.contains(other.parse().expect("an address"));
        let lab = network("192.168.1.5", 24);
        assert!(contains(lab, "192.168.1.201") && !contains(lab, "192.168.2.201"));
        // 20 bits: 192.168.0.0 to 192.168.15.255.
        assert!(
            contains(network("192.168.1.5", 20), "192.168.15.1")
                && !contains(network("192.168.1.5", 20), "192.168.16.1")
        );
        assert!(contains(network("10.0.0.1", 0), "192.168.1.1") && !contains(network("10.0.0.1", 32), "10.0.0.2"));
        assert!(contains(lab, "::ffff:192.168.1.9"), "an IPv4 address in IPv6 clothes");
        assert!(!contains(lab, "fe80::1") && contains(network("fe80::5", 64), "fe80::1"));
        assert!(contains(network("fe80::5", 0), "2001:db8::1"), "no bit to share");
        assert_eq!(lab.to_string(), "192.168.1.5/24");
    }

    #[test]
    fn loopback_is_among_the_interfaces() {
        let all = interfaces().expect("they are told");
        let loopback = all.iter().find(|interface| interface.loopback).expect("every machine has it");
        assert!(loopback.networks.contains(&network("127.0.0.1", 8)), "{loopback:?}");
    }
}

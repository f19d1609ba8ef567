//! Ports and addresses of RTPS (DDSI-RTPS 2.5, section 9.6.2).

use std::net::{Ipv4Addr, SocketAddrV4};

use network_interface::{Addr, Error, NetworkInterface, NetworkInterfaceConfig as _};
use tracing::warn;

/// Where participants announce themselves.
pub(super) const MULTICAST_GROUP: Ipv4Addr = Ipv4Addr::new(239, 255, 0, 1);
/// Participants of one domain on one machine that find each other by unicast; as many as ROS 2 looks for.
pub(super) const MAX_PARTICIPANTS: u16 = 32;

const PORT_BASE: u16 = 7400;
const DOMAIN_GAIN: u16 = 250;
const PARTICIPANT_GAIN: u16 = 2;

/// The port of announcements by multicast.
pub(super) const fn multicast_port(domain: u16) -> u16 {
    PORT_BASE + DOMAIN_GAIN * domain
}

/// The port of discovery of a participant.
pub(super) const fn discovery_port(domain: u16, participant: u16) -> u16 {
    multicast_port(domain) + 10 + PARTICIPANT_GAIN * participant
}

/// The port of data of a participant.
pub(super) const fn data_port(domain: u16, participant: u16) -> u16 {
    multicast_port(domain) + 11 + PARTICIPANT_GAIN * participant
}

/// All participants that `machine` can have.
pub(super) fn participants_on(machine: Ipv4Addr, domain: u16) -> impl Iterator<Item = SocketAddrV4> {
    (0..MAX_PARTICIPANTS)
        .map(move |participant| SocketAddrV4::new(machine, discovery_port(domain, participant)))
}

/// An address of this machine with its network.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct OwnAddress {
    pub(super) ip: Ipv4Addr,
    pub(super) netmask: Ipv4Addr,
}

impl OwnAddress {
    /// The loopback.
    pub(super) const LOCALHOST: Self = Self { ip: Ipv4Addr::LOCALHOST, netmask: Ipv4Addr::new(255, 0, 0, 0) };

    fn is_in_network(self, other: Ipv4Addr) -> bool {
        let mask = self.netmask.to_bits();
        mask != 0 && self.ip.to_bits() & mask == other.to_bits() & mask
    }
}

/// The addresses of this machine, without loopback. If there are none, other machines cannot be reached, and
/// a warning says so.
pub(super) fn own_addresses() -> Vec<OwnAddress> {
    let listed = NetworkInterface::show().map(addresses_of);
    if let Some((reason, hint)) = isolation(&listed) {
        warn!(hint, "{reason}: ROS 2 nodes on other machines and this one do not find each other");
    }
    listed.unwrap_or_default()
}

/// Why no other machine can be reached, with a hint; `None` if there is an address.
fn isolation(listed: &Result<Vec<OwnAddress>, Error>) -> Option<(String, &'static str)> {
    match listed {
        Ok(own) if own.is_empty() => Some((
            "no network interface has an IPv4 address".to_owned(),
            "restart when one has; if it is intended, set ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST",
        )),
        Ok(_) => None,
        // The library knows neither the call's errno nor more than its name.
        Err(error) => Some((
            format!("cannot list the network interfaces: {error}"),
            "under systemd, add RestrictAddressFamilies=AF_NETLINK to the unit",
        )),
    }
}

fn addresses_of(interfaces: Vec<NetworkInterface>) -> Vec<OwnAddress> {
    let addresses = interfaces.into_iter().flat_map(|interface| interface.addr);
    let addresses = addresses.filter_map(|address| match address {
        Addr::V4(v4) => Some(OwnAddress { ip: v4.ip, netmask: v4.netmask.unwrap_or(Ipv4Addr::BROADCAST) }),
        Addr::V6(_) => None,
    });
    addresses.filter(|address| !address.ip.is_loopback()).collect()
}

/// Whether `ip` is of this machine, which has the addresses `own` besides loopback.
pub(super) fn is_own(ip: Ipv4Addr, own: &[OwnAddress]) -> bool {
    ip.is_loopback() || own.iter().any(|address| address.ip == ip)
}

/// The address by which a participant that states `candidates` is reached.
///
/// An address in a network of this machine comes first, then one of this machine itself: other machines have
/// the same addresses in the networks of their containers. Without either, routing decides about the first.
pub(super) fn reachable(candidates: &[SocketAddrV4], own: &[OwnAddress]) -> Option<SocketAddrV4> {
    let is_own = |ip| is_own(ip, own);
    let is_near = |ip: Ipv4Addr| own.iter().any(|address| address.is_in_network(ip));
    let near = candidates.iter().find(|candidate| is_near(*candidate.ip()) && !is_own(*candidate.ip()));
    let on_this_machine = || candidates.iter().find(|candidate| is_own(*candidate.ip()));
    near.or_else(on_this_machine).or(candidates.first()).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn address(text: &str) -> SocketAddrV4 {
        text.parse().unwrap()
    }

    #[test]
    fn every_domain_has_ports() {
        assert_eq!((multicast_port(0), discovery_port(0, 0), data_port(0, 1)), (7400, 7410, 7413));
        assert_eq!(data_port(232, MAX_PARTICIPANTS - 1), 65_473);
    }

    #[test]
    fn a_machine_without_addresses_is_reported_and_a_failure_to_list_them_is_another_reason() {
        let own = OwnAddress { ip: Ipv4Addr::new(192, 168, 1, 2), netmask: Ipv4Addr::new(255, 255, 255, 0) };
        assert_eq!(isolation(&Ok(vec![own])), None);
        let unplugged = isolation(&Ok(Vec::new())).unwrap();
        let refused = isolation(&Err(Error::GetIfAddrsError("getifaddrs".to_owned(), -1))).unwrap();
        assert!(refused.0.contains("getifaddrs"), "{}", refused.0);
        assert_ne!(unplugged.1, refused.1, "only one of them is a matter of permissions");
    }

    #[test]
    fn a_participant_is_reached_by_the_network_that_both_are_in() {
        let mask = Ipv4Addr::new(255, 255, 0, 0);
        let own = [
            OwnAddress { ip: Ipv4Addr::new(192, 168, 1, 2), netmask: mask },
            OwnAddress { ip: Ipv4Addr::new(172, 17, 0, 1), netmask: mask },
        ];
        let remote = [address("172.17.0.1:7411"), address("192.168.1.7:7411")];
        assert_eq!(
            reachable(&remote, &own),
            Some(remote[1]),
            "the other machine has the same container network"
        );
        let same = [address("192.168.1.2:7413"), address("172.17.0.1:7413")];
        assert_eq!(reachable(&same, &own), Some(same[0]));
        let far = [address("10.0.0.1:7411"), address("10.1.0.1:7411")];
        assert_eq!(reachable(&far, &own), Some(far[0]));
        assert_eq!(reachable(&[], &own), None);
    }
}

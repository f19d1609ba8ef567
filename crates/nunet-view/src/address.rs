//! Addresses of servers, before a server uses them.

use std::io::ErrorKind;
use std::net::{IpAddr, SocketAddr, TcpListener};

use crate::error::ViewError;

/// The names of two servers that cannot listen at the same time, because one uses the address and port of the
/// other; the first two. Port 0 takes a free port each time.
#[must_use]
pub fn overlapping_addresses<'a>(servers: &[(&'a str, SocketAddr)]) -> Option<[&'a str; 2]> {
    let mut rest = servers;
    while let [(name, address), others @ ..] = rest {
        let other = others.iter().find(|(_, other)| overlap(*address, *other));
        if let Some((other, _)) = other {
            return Some([*name, *other]);
        }
        rest = others;
    }
    None
}

fn overlap(one: SocketAddr, other: SocketAddr) -> bool {
    let (ip, other_ip) = (one.ip().to_canonical(), other.ip().to_canonical());
    let includes = |all: IpAddr, ip: IpAddr| match all {
        IpAddr::V4(all) => all.is_unspecified() && ip.is_ipv4(),
        // Linux receives IPv4 there, too.
        IpAddr::V6(all) => all.is_unspecified(),
    };
    let is_shared = ip == other_ip || includes(ip, other_ip) || includes(other_ip, ip);
    one.port() == other.port() && one.port() != 0 && is_shared
}

/// Whether this process may listen on an address of this machine. The port is free again afterward; a port in
/// use is not an error.
///
/// # Errors
/// The address is not one of this machine, or needs privileges.
pub fn probe_address(address: SocketAddr) -> Result<(), ViewError> {
    match TcpListener::bind(address) {
        Err(source) if source.kind() != ErrorKind::AddrInUse => Err(ViewError::Listen { address, source }),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use nunet_types::Hint as _;

    use super::*;

    fn address(text: &str) -> SocketAddr {
        text.parse().unwrap()
    }

    #[test]
    fn servers_overlap_if_the_second_could_not_listen() {
        for (one, other) in [
            ("127.0.0.1:8080", "127.0.0.1:8080"),
            ("127.0.0.1:8080", "0.0.0.0:8080"),
            ("0.0.0.0:8080", "[::]:8080"),
            ("[::]:8080", "127.0.0.1:8080"),
            ("[::1]:8080", "[::]:8080"),
            ("[::ffff:127.0.0.1]:8080", "127.0.0.1:8080"),
        ] {
            let servers = [("a", address("127.0.0.1:1")), ("b", address(one)), ("c", address(other))];
            assert_eq!(overlapping_addresses(&servers), Some(["b", "c"]), "{one} {other}");
        }
        for (one, other) in [
            ("127.0.0.1:8080", "127.0.0.1:8081"),
            ("127.0.0.1:8080", "127.0.0.2:8080"),
            ("127.0.0.1:0", "127.0.0.1:0"),
            ("0.0.0.0:8080", "[::1]:8080"),
            ("[::1]:8080", "127.0.0.1:8080"),
        ] {
            let servers = [("b", address(one)), ("c", address(other))];
            assert_eq!(overlapping_addresses(&servers), None, "{one} {other}");
        }
    }

    #[test]
    fn an_address_of_another_machine_is_refused_and_a_port_in_use_is_not() {
        let error = probe_address(address("192.0.2.1:8080")).unwrap_err();
        assert!(error.hint().unwrap().contains("an address of this machine"), "{error}");
        let taken = TcpListener::bind("127.0.0.1:0").unwrap();
        assert!(probe_address(taken.local_addr().unwrap()).is_ok());
    }

    #[test]
    fn a_port_is_free_after_it_was_probed() {
        let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
        probe_address(free).unwrap();
        assert!(TcpListener::bind(free).is_ok());
    }
}

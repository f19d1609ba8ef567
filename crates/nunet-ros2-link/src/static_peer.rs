//! Machines that are contacted beside those that are found: `ROS_STATIC_PEERS`.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, ToSocketAddrs as _};
use std::str::FromStr;

use crate::error::Ros2Error;

/// The variable that names them.
pub(crate) const STATIC_PEERS: &str = "ROS_STATIC_PEERS";

/// A machine, by its address or its name.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum StaticPeer {
    /// Its address, that of one machine.
    Address(Ipv4Addr),
    /// Its name, which is looked up when the connection is opened.
    Name(String),
}

impl FromStr for StaticPeer {
    type Err = Ros2Error;

    fn from_str(text: &str) -> Result<Self, Ros2Error> {
        let peer = match text.parse::<Ipv4Addr>() {
            Ok(address) => is_of_one_machine(address).then_some(Self::Address(address)),
            Err(_) => is_name(text).then(|| Self::Name(text.to_owned())),
        };
        peer.ok_or_else(|| {
            let expected = "IPv4 addresses or names of machines, separated by `;`";
            Ros2Error::Variable { variable: STATIC_PEERS, value: text.to_owned(), expected }
        })
    }
}

impl StaticPeer {
    /// Its IPv4 addresses.
    ///
    /// # Errors
    /// No machine of this name is known, or it has no such address.
    pub fn addresses(&self) -> Result<Vec<Ipv4Addr>, Ros2Error> {
        let name = match self {
            Self::Address(address) => return Ok(vec![*address]),
            Self::Name(name) => name,
        };
        let unknown = |source| Ros2Error::StaticPeer { name: name.clone(), source };
        let found = (name.as_str(), 0_u16).to_socket_addrs().map_err(unknown)?;
        let mut addresses: Vec<_> =
            found.filter_map(ipv4).filter(|found| is_of_one_machine(*found)).collect();
        addresses.sort_unstable();
        addresses.dedup();
        if addresses.is_empty() {
            return Err(unknown(io::Error::new(io::ErrorKind::NotFound, "it has no IPv4 address")));
        }
        Ok(addresses)
    }
}

fn ipv4(address: SocketAddr) -> Option<Ipv4Addr> {
    match address {
        SocketAddr::V4(address) => Some(*address.ip()),
        SocketAddr::V6(_) => None,
    }
}

/// Neither `0.0.0.0/8` nor a group nor all machines.
fn is_of_one_machine(address: Ipv4Addr) -> bool {
    matches!(address.octets(), [1..=223, ..])
}

/// Whether a machine can have this name. A name whose last part is a number would be a wrong address.
fn is_name(text: &str) -> bool {
    let is_part = |part: &str| {
        let is_known = |character: char| character.is_ascii_alphanumeric() || "-_".contains(character);
        !part.is_empty() && part.chars().all(is_known)
    };
    let name = text.strip_suffix('.').unwrap_or(text);
    let has_number_last =
        name.rsplit('.').next().is_some_and(|part| part.bytes().all(|byte| byte.is_ascii_digit()));
    !has_number_last && name.split('.').all(is_part)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Ros2ErrorKind;

    #[test]
    fn a_peer_is_one_machine_by_its_address_or_its_name() {
        let peer = |text: &str| text.parse::<StaticPeer>();
        assert_eq!(peer("10.0.0.1").unwrap(), StaticPeer::Address(Ipv4Addr::new(10, 0, 0, 1)));
        for text in ["robot", "robot.local", "robot_2.local.", "ip-10-0-0-1"] {
            assert_eq!(peer(text).unwrap(), StaticPeer::Name(text.to_owned()));
        }
        for text in [
            "0.0.0.0",
            "255.255.255.255",
            "224.0.0.1",
            "240.0.0.1",
            "10.0.0",
            "10.0.0.256",
            "7",
            "::1",
            "robot:7447",
            "robot..local",
            "ro bot",
            ".",
            "",
        ] {
            assert_eq!(peer(text).unwrap_err().kind(), Ros2ErrorKind::Argument, "{text}");
        }
    }

    #[test]
    fn a_name_is_looked_up() {
        let addresses = |text: &str| text.parse::<StaticPeer>().unwrap().addresses();
        assert_eq!(addresses("localhost").unwrap(), [Ipv4Addr::LOCALHOST]);
        assert_eq!(addresses("10.0.0.1").unwrap(), [Ipv4Addr::new(10, 0, 0, 1)]);
        // No part of a name has more than 63 characters, so that no server is asked.
        assert_eq!(addresses(&"a".repeat(64)).unwrap_err().kind(), Ros2ErrorKind::Network);
    }
}

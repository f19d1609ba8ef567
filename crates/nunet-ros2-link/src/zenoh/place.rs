//! Where a router is expected.

use std::fmt;
use std::path::Path;

/// The network interfaces of this machine.
const INTERFACES: &str = "/sys/class/net";

/// Where a router is expected.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum RouterPlace {
    /// At one of these addresses, such as `tcp/localhost:7447`.
    At(String),
    /// Anywhere in the networks of this machine.
    Anywhere,
    /// The configuration states none, and does not look for one.
    Nowhere,
}

impl fmt::Display for RouterPlace {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::At(routers) => write!(out, "at {routers}"),
            Self::Anywhere => out.write_str("in the network (multicast)"),
            Self::Nowhere => out.write_str("in the configuration (connect/endpoints is empty)"),
        }
    }
}

impl RouterPlace {
    /// What to do if it is not there.
    pub(super) fn hint(&self) -> String {
        let start = "start one, such as `ros2 run rmw_zenoh_cpp rmw_zenohd`";
        match self {
            Self::At(routers) => {
                if let Some(absent) = interfaces(routers).find(|name| is_absent(name)) {
                    return format!("name an interface of this machine, which has no `{absent}`");
                }
                if routers.contains("tls/") {
                    return format!("{start}, or check the certificates: `transport/link/tls`");
                }
                start.to_owned()
            }
            Self::Anywhere => format!("{start}, in a network that forwards multicast"),
            Self::Nowhere => {
                "name one in `connect/endpoints`, or set ZENOH_ROUTER_CHECK_ATTEMPTS to -1 if there is none"
                    .to_owned()
            }
        }
    }
}

/// The interfaces that endpoints name: `tcp/10.0.0.1:7447#iface=eth0`.
fn interfaces(routers: &str) -> impl Iterator<Item = &str> {
    routers.split("iface=").skip(1).filter_map(|rest| rest.split([';', ',', ' ']).next())
}

/// Whether this machine has no such interface.
fn is_absent(interface: &str) -> bool {
    let interfaces = Path::new(INTERFACES);
    interfaces.is_dir() && !interfaces.join(interface).exists()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hint_names_what_is_wrong_with_the_endpoint() {
        let hint = |routers: &str| RouterPlace::At(routers.to_owned()).hint();
        let start = hint("tcp/10.0.0.1:7447");
        assert_eq!(hint("tcp/127.0.0.1:7447#iface=lo"), start);
        let absent = hint("tcp/127.0.0.1:7447#iface=lo, tcp/10.0.0.1:7447#bind=10.0.0.2:0;iface=nope");
        assert!(absent.contains("`nope`"), "{absent}");
        assert!(hint("tls/10.0.0.1:7447").contains("transport/link/tls"));
        assert!(RouterPlace::Nowhere.hint().contains("connect/endpoints"));
    }
}

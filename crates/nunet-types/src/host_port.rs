//! Addresses of the form `HOST:PORT`.

use std::net::SocketAddrV6;

/// Whether a text is `HOST:PORT`: a name or an address, one of IPv6 in brackets, and a port from 1 to 65535.
/// The host is not looked up.
#[must_use]
pub fn is_host_and_port(text: &str) -> bool {
    if text.starts_with('[') {
        return text.parse::<SocketAddrV6>().is_ok_and(|address| address.port() > 0);
    }
    text.rsplit_once(':').is_some_and(|(host, port)| {
        let is_foreign = |character: char| character.is_whitespace() || ":/[]".contains(character);
        let is_number = port.bytes().all(|byte| byte.is_ascii_digit());
        let is_port = is_number && port.parse::<u16>().is_ok_and(|port| port > 0);
        !host.is_empty() && !host.contains(is_foreign) && is_port
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_host_and_a_port_are_both_needed() {
        for text in ["robot:1", "10.0.0.1:65535", "[::1]:7447", "[fe80::1%2]:7447"] {
            assert!(is_host_and_port(text), "{text}");
        }
        for text in [
            "",
            "robot",
            "robot:",
            ":1",
            "robot:0",
            "robot:65536",
            "robot:+1",
            "::1:7447",
            "a/b:1",
            "ro bot:1",
            "[zz]:7447",
            "[]:7447",
            "[::1%]:7447",
            "[::1]:0",
            "[::1:7447",
            "::1]:7447",
            "[10.0.0.1]:7447",
        ] {
            assert!(!is_host_and_port(text), "{text}");
        }
    }
}

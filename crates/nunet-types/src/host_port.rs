//! Addresses of the form `HOST:PORT`.

/// Whether a text is `HOST:PORT`: a name or an address, one of IPv6 in brackets, and a port from 1 to 65535.
/// The host is not looked up.
#[must_use]
pub fn is_host_and_port(text: &str) -> bool {
    text.rsplit_once(':').is_some_and(|(host, port)| {
        let is_bracketed = host.starts_with('[') && host.ends_with(']');
        let is_host = !host.is_empty() && (is_bracketed || !host.contains([':', '/']));
        is_host && port.parse::<u16>().is_ok_and(|port| port > 0)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_host_and_a_port_are_both_needed() {
        for text in ["robot:1", "10.0.0.1:65535", "[::1]:7447"] {
            assert!(is_host_and_port(text), "{text}");
        }
        for text in ["", "robot", "robot:", ":1", "robot:0", "robot:65536", "::1:7447", "a/b:1"] {
            assert!(!is_host_and_port(text), "{text}");
        }
    }
}

//! Which network a connection uses.

use std::fmt;
use std::str::FromStr;

use nunet_types::is_host_and_port;

use crate::environment::{self, Environment};
use crate::error::Ros2Error;

/// Protocols of Zenoh endpoints with an address of the form HOST:PORT.
const IP_PROTOCOLS: [&str; 3] = ["tcp", "udp", "tls"];
/// The protocol whose address is a path.
const UNIX_PROTOCOL: &str = "unixsock-stream";
/// The lowest priority of Zenoh; the highest is 0.
const LAST_PRIORITY: u8 = 7;
/// Zenoh keeps endpoints in strings of this length.
const MAX_ENDPOINT_BYTES: usize = 255;

/// A connection to ROS 2: `dds`, `dds:DOMAIN`, `zenoh` or `zenoh:ENDPOINT`.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub enum LinkName {
    /// DDS, the default of ROS 2.
    Dds {
        /// The domain; `None` for that of the environment.
        domain: Option<u16>,
    },
    /// Zenoh, as `rmw_zenoh` uses it. The domain is that of the environment.
    Zenoh {
        /// The router; `None` for that of the environment, by default the one on this machine.
        endpoint: Option<ZenohEndpoint>,
    },
}

impl LinkName {
    /// What this connection uses of the environment of this process. Variables of the other transport are not
    /// read.
    ///
    /// # Errors
    /// A variable has a value that it does not take.
    pub fn environment(&self) -> Result<Environment, Ros2Error> {
        match self {
            Self::Dds { domain } => Environment::for_dds(*domain),
            Self::Zenoh { .. } => Environment::for_zenoh(),
        }
    }
}

/// The address of a Zenoh router or peer, such as `tcp/192.168.1.5:7447`.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct ZenohEndpoint(String);

impl ZenohEndpoint {
    /// The address as text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for ZenohEndpoint {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(&self.0)
    }
}

impl FromStr for LinkName {
    type Err = Ros2Error;

    fn from_str(text: &str) -> Result<Self, Ros2Error> {
        match text.split_once(':') {
            None if text == "dds" => Ok(Self::Dds { domain: None }),
            None if text == "zenoh" => Ok(Self::Zenoh { endpoint: None }),
            Some(("dds", domain)) => {
                let domain = environment::domain("the domain", domain);
                domain.map(|domain| Self::Dds { domain: Some(domain) })
            }
            Some(("zenoh", endpoint)) => {
                endpoint.parse().map(|endpoint| Self::Zenoh { endpoint: Some(endpoint) })
            }
            _ => Err(Ros2Error::Unknown {
                what: "transport",
                value: text.to_owned(),
                expected: "`dds`, `dds:DOMAIN`, `zenoh` or `zenoh:ENDPOINT`".to_owned(),
            }),
        }
    }
}

impl FromStr for ZenohEndpoint {
    type Err = Ros2Error;

    fn from_str(text: &str) -> Result<Self, Ros2Error> {
        let is_plain = |character: char| character.is_ascii_graphic() && !"\"'\\".contains(character);
        if is_endpoint(text) && text.len() <= MAX_ENDPOINT_BYTES && text.chars().all(is_plain) {
            Ok(Self(text.to_owned()))
        } else {
            Err(Ros2Error::Endpoint { value: text.to_owned() })
        }
    }
}

/// Whether a text has a protocol of this build, an address of that protocol, and metadata that Zenoh takes.
pub(crate) fn is_endpoint(text: &str) -> bool {
    let (protocol, rest) = text.split_once('/').unwrap_or((text, ""));
    // Metadata and settings may follow, such as `?prio=6-7` and `#iface=eth0`.
    let without_settings = rest.split('#').next().unwrap_or_default();
    let (address, metadata) = match without_settings.split_once('?') {
        Some((address, metadata)) => (address, Some(metadata)),
        None => (without_settings, None),
    };
    let is_address = match protocol {
        UNIX_PROTOCOL => !address.is_empty(),
        _ => IP_PROTOCOLS.contains(&protocol) && is_host_and_port(address),
    };
    is_address && metadata.is_none_or(is_metadata)
}

/// Whether metadata such as `prio=6-7;rel=1` have values that Zenoh takes: a range of priorities, and whether
/// a link is reliable. Zenoh itself notices others only when it connects, and then tries without end.
fn is_metadata(metadata: &str) -> bool {
    metadata.split(';').all(|setting| match setting.split_once('=') {
        Some(("prio", range)) => is_range(range),
        Some(("rel", value)) => ["0", "1"].contains(&value),
        Some((key, _)) => !key.is_empty(),
        None => false,
    })
}

/// Whether a text is `FIRST-LAST`, or one priority.
fn is_range(text: &str) -> bool {
    let (first, last) = text.split_once('-').unwrap_or((text, text));
    let priority = |text: &str| text.parse::<u8>().ok().filter(|priority| *priority <= LAST_PRIORITY);
    matches!((priority(first), priority(last)), (Some(first), Some(last)) if first <= last)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::Ros2ErrorKind;

    #[test]
    fn links_are_parsed_and_mistakes_are_named() {
        assert_eq!("dds".parse::<LinkName>().unwrap(), LinkName::Dds { domain: None });
        assert_eq!("dds:7".parse::<LinkName>().unwrap(), LinkName::Dds { domain: Some(7) });
        assert_eq!("zenoh".parse::<LinkName>().unwrap(), LinkName::Zenoh { endpoint: None });
        for text in ["dds:233", "dds:-1", "dds:", "dds:x", "ros", "", "DDS", "zenoh:", "zenoh:7"] {
            assert_eq!(text.parse::<LinkName>().unwrap_err().kind(), Ros2ErrorKind::Argument, "{text}");
        }
        let error = "dds:300".parse::<LinkName>().unwrap_err();
        assert_eq!(error.to_string(), "the domain is `300`, expected a ROS 2 domain from 0 to 232");
    }

    #[test]
    fn endpoints_have_a_protocol_and_an_address() {
        for text in [
            "tcp/localhost:7447",
            "udp/192.168.1.5:7447",
            "tls/robot.local:7447",
            "tcp/[::1]:7447",
            "tcp/10.0.0.1:7447#iface=eth0",
            "tcp/10.0.0.1:7447?prio=6-7;rel=1#iface=eth0",
            "tcp/10.0.0.1:7447?prio=5",
            "unixsock-stream//run/zenoh.sock",
        ] {
            let link = format!("zenoh:{text}").parse::<LinkName>().unwrap();
            assert_eq!(link, LinkName::Zenoh { endpoint: Some(ZenohEndpoint(text.to_owned())) });
        }
        for text in [
            "robot",
            "tcp/robot",
            "tcp/robot:0",
            "tcp/robot:70000",
            "tcp/:7447",
            "tcp/::1:7447",
            "tcp/[zz]:7447",
            "tcp/10.0.0.1:7447?",
            "tcp/10.0.0.1:7447?prio",
            "tcp/10.0.0.1:7447?prio=9-1",
            "tcp/10.0.0.1:7447?prio=1-8",
            "tcp/10.0.0.1:7447?rel=yes",
            "http/robot:80",
            "tcp:robot:7447",
            "tcp/ro\"bot:7447",
            "unixsock-stream/",
        ] {
            let error = text.parse::<ZenohEndpoint>().unwrap_err();
            assert!(error.to_string().starts_with(&format!("`{text}` is not a Zenoh endpoint")), "{error}");
        }
        assert!(format!("tcp/{}:7447", "a".repeat(255)).parse::<ZenohEndpoint>().is_err());
    }
}

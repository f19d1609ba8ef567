//! The address of the autopilot.

use std::borrow::Cow;
use std::fmt;
use std::net::Ipv6Addr;
use std::path::PathBuf;
use std::str::FromStr;

use nunet_types::{Hint, is_host_and_port};

/// The address of the autopilot: `udpout:HOST:PORT`, `tcpout:HOST:PORT` or `serial:DEVICE:BAUD`, as other
/// MAVLink programs write it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum MavlinkAddress {
    /// Datagrams to a host and port.
    Udp(String),
    /// A TCP server.
    Tcp(String),
    /// A serial line.
    Serial {
        /// The device, such as `/dev/ttyACM0`.
        device: PathBuf,
        /// Bits per second.
        baud: u32,
    },
}

/// A text that is not an address.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is not a MAVLink address")]
pub struct AddressError(String);

/// The kind of an error of this crate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum MavlinkErrorKind {
    /// A value that the user chose.
    Argument,
}

impl AddressError {
    /// [`MavlinkErrorKind::Argument`].
    #[must_use]
    pub fn kind(&self) -> MavlinkErrorKind {
        MavlinkErrorKind::Argument
    }
}

impl Hint for AddressError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        let forms = "pass udpout:HOST:PORT, tcpout:HOST:PORT or serial:DEVICE:BAUD";
        Some(match with_brackets(&self.0) {
            Some(address) => format!("{forms}, with an IPv6 address in brackets: {address}").into(),
            None => forms.into(),
        })
    }
}

impl FromStr for MavlinkAddress {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let wrong = || AddressError(text.to_owned());
        let (kind, rest) = text.split_once(':').ok_or_else(wrong)?;
        match kind {
            "udpout" if is_host_and_port(rest) => Ok(Self::Udp(rest.to_owned())),
            "tcpout" if is_host_and_port(rest) => Ok(Self::Tcp(rest.to_owned())),
            "serial" => serial(rest).ok_or_else(wrong),
            _ => Err(wrong()),
        }
    }
}

/// An address whose host is an IPv6 address without brackets, with them.
fn with_brackets(text: &str) -> Option<String> {
    let (kind, rest) = text.split_once(':')?;
    let (host, port) = rest.rsplit_once(':')?;
    let host: Ipv6Addr = host.parse().ok()?;
    let address = format!("{kind}:[{host}]:{port}");
    address.parse::<MavlinkAddress>().is_ok().then_some(address)
}

/// `DEVICE:BAUD`
fn serial(text: &str) -> Option<MavlinkAddress> {
    let (device, baud) = text.rsplit_once(':').filter(|(device, _)| !device.is_empty())?;
    let baud = baud.parse::<u32>().ok().filter(|baud| *baud > 0)?;
    Some(MavlinkAddress::Serial { device: device.into(), baud })
}

impl fmt::Display for MavlinkAddress {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Udp(address) => write!(formatter, "udpout:{address}"),
            Self::Tcp(address) => write!(formatter, "tcpout:{address}"),
            Self::Serial { device, baud } => write!(formatter, "serial:{}:{baud}", device.display()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_written_as_they_are_read() {
        for text in ["udpout:127.0.0.1:14550", "tcpout:[::1]:5760", "serial:/dev/ttyACM0:921600"] {
            assert_eq!(text.parse::<MavlinkAddress>().unwrap().to_string(), text);
        }
    }

    #[test]
    fn a_text_that_is_no_address_is_refused_with_the_forms_that_are() {
        let wrong =
            ["", "udpout", "udpout:14550", "udpout::14550", "udpout:a:0", "udpout:a:70000", "tcpin:a:1"];
        let wrong = wrong.into_iter().chain(["udp:127.0.0.1:1", "tcpout:::1:5760", "serial:/dev/a"]);
        for text in wrong.chain(["serial:/dev/a:fast", "serial:/dev/a:0", "serial::57600"]) {
            let error = text.parse::<MavlinkAddress>().unwrap_err();
            assert_eq!(error.to_string(), format!("`{text}` is not a MAVLink address"));
            assert_eq!(error.kind(), MavlinkErrorKind::Argument);
            assert!(error.hint().unwrap().contains("udpout:HOST:PORT"));
        }
    }

    #[test]
    fn an_ipv6_address_without_brackets_is_shown_with_them() {
        let hint = |text: &str| text.parse::<MavlinkAddress>().unwrap_err().hint().unwrap().into_owned();
        assert!(hint("udpout:::1:14550").ends_with(": udpout:[::1]:14550"));
        assert!(hint("tcpout:fe80::1:5760").ends_with(": tcpout:[fe80::1]:5760"));
        for other in ["udpout:::1:0", "udp:::1:14550", "serial::57600", "udpout:1:14550:"] {
            assert!(!hint(other).contains('['), "{other}");
        }
    }
}

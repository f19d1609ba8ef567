//! The address of the autopilot.

use std::borrow::Cow;
use std::fmt;
use std::net::Ipv6Addr;
use std::path::PathBuf;
use std::str::FromStr;

use nunet_types::{Hint, is_host_and_port};

use crate::messages::{COMPONENT_ID, SYSTEM_ID};

/// The address of the autopilot, and what this computer is in its network.
///
/// Written as `udpout:HOST:PORT`, `tcpout:HOST:PORT` or `serial:DEVICE:BAUD`, as other MAVLink programs write
/// it. `,system=N` and `,component=N` may follow.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MavlinkAddress {
    /// The connection.
    pub transport: MavlinkTransport,
    /// The system, 1 to 255: that of the autopilot, to which a companion computer belongs.
    pub system_id: u8,
    /// The component, 1 to 255: one for each program of the system.
    pub component_id: u8,
}

/// How an autopilot is reached.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum MavlinkTransport {
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
        let forms = "pass udpout:HOST:PORT, tcpout:HOST:PORT or serial:DEVICE:BAUD; \
                     `,system=N` and `,component=N` of 1 to 255 may follow";
        Some(match with_brackets(&self.0) {
            Some(address) => format!("{forms}; write an IPv6 address in brackets: {address}").into(),
            None => forms.into(),
        })
    }
}

impl From<MavlinkTransport> for MavlinkAddress {
    fn from(transport: MavlinkTransport) -> Self {
        Self { transport, system_id: SYSTEM_ID, component_id: COMPONENT_ID }
    }
}

impl FromStr for MavlinkAddress {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let wrong = || AddressError(text.to_owned());
        let (mut rest, mut system_id, mut component_id) = (text, None, None);
        while let Some((before, name, id)) = last_setting(rest) {
            let place = match name {
                "system" => &mut system_id,
                "component" => &mut component_id,
                _ => return Err(wrong()),
            };
            let id = id.parse::<u8>().ok().filter(|id| *id > 0).ok_or_else(wrong)?;
            if place.replace(id).is_some() {
                return Err(wrong());
            }
            rest = before;
        }
        Ok(Self {
            transport: transport(rest).ok_or_else(wrong)?,
            system_id: system_id.unwrap_or(SYSTEM_ID),
            component_id: component_id.unwrap_or(COMPONENT_ID),
        })
    }
}

/// What is before `,NAME=VALUE`, the name and the value. The name of a device may have commas.
fn last_setting(text: &str) -> Option<(&str, &str, &str)> {
    let (before, setting) = text.rsplit_once(',')?;
    let (name, value) = setting.split_once('=')?;
    Some((before, name, value))
}

fn transport(text: &str) -> Option<MavlinkTransport> {
    let (kind, rest) = text.split_once(':')?;
    match kind {
        "udpout" if is_host_and_port(rest) => Some(MavlinkTransport::Udp(rest.to_owned())),
        "tcpout" if is_host_and_port(rest) => Some(MavlinkTransport::Tcp(rest.to_owned())),
        "serial" => serial(rest),
        _ => None,
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
fn serial(text: &str) -> Option<MavlinkTransport> {
    let (device, baud) = text.rsplit_once(':').filter(|(device, _)| !device.is_empty())?;
    let baud = baud.parse::<u32>().ok().filter(|baud| *baud > 0)?;
    Some(MavlinkTransport::Serial { device: device.into(), baud })
}

impl fmt::Display for MavlinkAddress {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.transport {
            MavlinkTransport::Udp(host) => write!(formatter, "udpout:{host}")?,
            MavlinkTransport::Tcp(host) => write!(formatter, "tcpout:{host}")?,
            MavlinkTransport::Serial { device, baud } => {
                write!(formatter, "serial:{}:{baud}", device.display())?;
            }
        }
        for (name, id, usual) in
            [("system", self.system_id, SYSTEM_ID), ("component", self.component_id, COMPONENT_ID)]
        {
            if id != usual {
                write!(formatter, ",{name}={id}")?;
            }
        }
        Ok(())
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
    fn system_and_component_follow_the_address() {
        let ids = |text: &str| {
            let MavlinkAddress { system_id, component_id, .. } = text.parse().unwrap();
            (system_id, component_id)
        };
        assert_eq!(ids("udpout:127.0.0.1:14550"), (1, 196));
        assert_eq!(ids("serial:/dev/a,b:57600,system=7"), (7, 196));
        assert_eq!(ids("tcpout:[::1]:5760,component=197,system=255"), (255, 197));
        for text in ["udpout:127.0.0.1:14550,system=2,component=197", "serial:/dev/a,b:57600,component=1"] {
            assert_eq!(text.parse::<MavlinkAddress>().unwrap().to_string(), text);
        }
        for wrong in ["system=0", "system=256", "system=", "system=1,system=2", "name=1", "system"] {
            let text = format!("udpout:127.0.0.1:14550,{wrong}");
            assert!(text.parse::<MavlinkAddress>().is_err(), "{text}");
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

//! The environment variables of ROS 2.

use std::ffi::OsString;
use std::path::PathBuf;

use crate::error::Ros2Error;
use crate::static_peer::{STATIC_PEERS, StaticPeer};

/// Higher domains have no ports.
const MAX_DOMAIN: u16 = 232;
const RANGE: &str = "ROS_AUTOMATIC_DISCOVERY_RANGE";

/// How far participants of a domain look for each other.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum DiscoveryRange {
    /// Not at all.
    Off,
    /// On this machine.
    Localhost,
    /// In the networks of this machine's interfaces, by multicast.
    #[default]
    Subnet,
}

/// What the environment says about the network of ROS 2.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Environment {
    /// `ROS_DOMAIN_ID`, 0 by default.
    pub domain: u16,
    /// `ROS_AUTOMATIC_DISCOVERY_RANGE`, or localhost if `ROS_LOCALHOST_ONLY` is 1. For DDS only.
    pub range: DiscoveryRange,
    /// `ROS_STATIC_PEERS`: machines beyond the range. For DDS only.
    pub static_peers: Vec<StaticPeer>,
    /// What concerns Zenoh only.
    pub zenoh: ZenohVariables,
}

/// The variables of `rmw_zenoh`.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ZenohVariables {
    /// `ZENOH_SESSION_CONFIG_URI`: a file that takes the place of the default configuration.
    pub session_config: Option<PathBuf>,
    /// `ZENOH_CONFIG_OVERRIDE`: settings such as `mode="client";scouting/multicast/enabled=true`.
    pub config_override: Option<String>,
    /// `ZENOH_ROUTER_CHECK_ATTEMPTS`: if it is negative, no router is expected.
    pub router_check_attempts: i64,
}

/// Reads a variable, which may contain any bytes.
type Variables<'a> = &'a dyn Fn(&'static str) -> Option<OsString>;

/// Reads those of this process.
fn of_process(name: &'static str) -> Option<OsString> {
    std::env::var_os(name)
}

impl Environment {
    /// What DDS uses of the environment of this process; nothing else is read. A `domain` that is stated
    /// takes the place of `ROS_DOMAIN_ID`.
    ///
    /// # Errors
    /// A variable has a value that it does not take.
    pub fn for_dds(domain: Option<u16>) -> Result<Self, Ros2Error> {
        Self::read_for_dds(domain, &of_process)
    }

    /// What Zenoh uses of the environment of this process; nothing else is read.
    ///
    /// # Errors
    /// A variable has a value that it does not take.
    pub fn for_zenoh() -> Result<Self, Ros2Error> {
        Self::read_for_zenoh(&of_process)
    }

    /// The same in another domain, if one is given.
    #[must_use]
    pub fn in_domain(self, domain: Option<u16>) -> Self {
        Self { domain: domain.unwrap_or(self.domain), ..self }
    }

    fn read_for_dds(stated: Option<u16>, variables: Variables<'_>) -> Result<Self, Ros2Error> {
        let domain = stated.map_or_else(|| domain_id(variables), Ok)?;
        let is_local = text(variables, "ROS_LOCALHOST_ONLY")?.as_deref() == Some("1");
        let range = if is_local {
            DiscoveryRange::Localhost
        } else {
            text(variables, RANGE)?.map_or(Ok(DiscoveryRange::default()), range)?
        };
        let peers = text(variables, STATIC_PEERS)?.unwrap_or_default();
        let peers = peers.split(';').map(str::trim).filter(|peer| !peer.is_empty());
        let static_peers = peers.map(str::parse::<StaticPeer>).collect::<Result<_, _>>()?;
        Ok(Self { domain, range, static_peers, ..Self::default() })
    }

    fn read_for_zenoh(variables: Variables<'_>) -> Result<Self, Ros2Error> {
        let zenoh = ZenohVariables::read(variables)?;
        Ok(Self { domain: domain_id(variables)?, zenoh, ..Self::default() })
    }
}

impl ZenohVariables {
    fn read(variables: Variables<'_>) -> Result<Self, Ros2Error> {
        const ATTEMPTS: &str = "ZENOH_ROUTER_CHECK_ATTEMPTS";
        let attempts = text(variables, ATTEMPTS)?.map_or(Ok(1), |value| {
            let expected = "a number; if it is negative, no router is expected";
            value.parse().map_err(|_| Ros2Error::Variable { variable: ATTEMPTS, value, expected })
        });
        Ok(Self {
            // A path need not be text.
            session_config: stated(variables, "ZENOH_SESSION_CONFIG_URI").map(PathBuf::from),
            config_override: text(variables, "ZENOH_CONFIG_OVERRIDE")?,
            router_check_attempts: attempts?,
        })
    }
}

/// The value of a variable that is set to something.
fn stated(variables: Variables<'_>, name: &'static str) -> Option<OsString> {
    variables(name).filter(|value| !value.is_empty())
}

/// The same as text.
fn text(variables: Variables<'_>, name: &'static str) -> Result<Option<String>, Ros2Error> {
    let value = stated(variables, name).map(OsString::into_string).transpose();
    value.map_err(|value| {
        let (value, expected) = (value.to_string_lossy().into_owned(), "text in UTF-8");
        Ros2Error::Variable { variable: name, value, expected }
    })
}

fn domain_id(variables: Variables<'_>) -> Result<u16, Ros2Error> {
    const NAME: &str = "ROS_DOMAIN_ID";
    text(variables, NAME)?.map_or(Ok(0), |value| domain(NAME, &value))
}

/// A domain that `origin` states as `value`.
///
/// # Errors
/// ROS 2 has no such domain.
pub fn domain(origin: &'static str, value: &str) -> Result<u16, Ros2Error> {
    let domain = value.parse().ok().filter(|domain| *domain <= MAX_DOMAIN);
    domain.ok_or_else(|| Ros2Error::Domain { origin, value: value.to_owned() })
}

fn range(value: String) -> Result<DiscoveryRange, Ros2Error> {
    match value.as_str() {
        "OFF" => Ok(DiscoveryRange::Off),
        "LOCALHOST" => Ok(DiscoveryRange::Localhost),
        "SUBNET" | "SYSTEM_DEFAULT" => Ok(DiscoveryRange::Subnet),
        _ => {
            let expected = "OFF, LOCALHOST, SUBNET or SYSTEM_DEFAULT";
            Err(Ros2Error::Variable { variable: RANGE, value, expected })
        }
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::ffi::OsStringExt as _;

    use super::*;

    fn value(variables: &[(&str, &str)], name: &str) -> Option<OsString> {
        variables.iter().find(|(key, _)| *key == name).map(|(_, value)| (*value).into())
    }

    fn dds(variables: &[(&str, &str)]) -> Result<Environment, Ros2Error> {
        Environment::read_for_dds(None, &|name| value(variables, name))
    }

    fn zenoh(variables: &[(&str, &str)]) -> Result<Environment, Ros2Error> {
        Environment::read_for_zenoh(&|name| value(variables, name))
    }

    #[test]
    fn the_variables_of_ros_are_read_as_ros_reads_them() {
        let default = dds(&[("ROS_DOMAIN_ID", "")]).unwrap();
        assert_eq!((default.domain, default.range), (0, DiscoveryRange::Subnet));
        let set = dds(&[
            ("ROS_DOMAIN_ID", "42"),
            ("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST"),
            ("ROS_STATIC_PEERS", "10.0.0.1; 10.0.0.2;robot.local;"),
        ]);
        let set = set.unwrap();
        assert_eq!((set.domain, set.range, set.static_peers.len()), (42, DiscoveryRange::Localhost, 3));
        let only = [("ROS_LOCALHOST_ONLY", "1"), ("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")];
        assert_eq!(dds(&only).unwrap().range, DiscoveryRange::Localhost);
    }

    #[test]
    fn the_variables_of_zenoh_are_read() {
        let default = zenoh(&[("ZENOH_CONFIG_OVERRIDE", "")]).unwrap().zenoh;
        assert_eq!(default, ZenohVariables { router_check_attempts: 1, ..ZenohVariables::default() });
        let set = zenoh(&[
            ("ROS_DOMAIN_ID", "42"),
            ("ZENOH_SESSION_CONFIG_URI", "/etc/session.json5"),
            ("ZENOH_CONFIG_OVERRIDE", "mode=\"client\""),
            ("ZENOH_ROUTER_CHECK_ATTEMPTS", "-1"),
        ]);
        let Environment { domain, zenoh: set, .. } = set.unwrap();
        assert_eq!((domain, set.session_config.unwrap()), (42, PathBuf::from("/etc/session.json5")));
        assert_eq!(
            (set.config_override.as_deref(), set.router_check_attempts),
            (Some("mode=\"client\""), -1)
        );
    }

    #[test]
    fn a_value_that_a_variable_does_not_take_is_an_error() {
        for (name, value) in [
            ("ROS_DOMAIN_ID", "233"),
            ("ROS_DOMAIN_ID", "one"),
            ("ROS_AUTOMATIC_DISCOVERY_RANGE", "NEAR"),
            ("ROS_STATIC_PEERS", "10.0.0.256"),
            ("ROS_STATIC_PEERS", "224.0.0.1"),
        ] {
            let error = dds(&[(name, value)]).unwrap_err();
            assert!(error.to_string().starts_with(&format!("{name} is `{value}`, expected ")), "{error}");
        }
        for (name, value) in [("ROS_DOMAIN_ID", "233"), ("ZENOH_ROUTER_CHECK_ATTEMPTS", "never")] {
            let error = zenoh(&[(name, value)]).unwrap_err();
            assert!(error.to_string().starts_with(&format!("{name} is `{value}`, expected ")), "{error}");
        }
    }

    #[test]
    fn variables_that_a_connection_does_not_use_are_not_read() {
        let of_dds = [
            ("ROS_AUTOMATIC_DISCOVERY_RANGE", "localhost"),
            ("ROS_LOCALHOST_ONLY", "1"),
            ("ROS_STATIC_PEERS", "10.0.0.256"),
        ];
        assert_eq!(zenoh(&of_dds).unwrap(), zenoh(&[]).unwrap());
        assert_eq!(dds(&[("ZENOH_ROUTER_CHECK_ATTEMPTS", "abc")]).unwrap(), dds(&[]).unwrap());
        let high = [("ROS_DOMAIN_ID", "300")];
        let stated = Environment::read_for_dds(Some(7), &|name| value(&high, name));
        assert_eq!(stated.unwrap().domain, 7);
    }

    #[test]
    fn a_value_that_is_not_text_is_an_error() {
        let bytes = |name: &str, bad: &str| (name == bad).then(|| OsString::from_vec(vec![b'7', 0xff]));
        for bad in
            ["ROS_DOMAIN_ID", "ROS_LOCALHOST_ONLY", "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_STATIC_PEERS"]
        {
            let error = Environment::read_for_dds(None, &|name| bytes(name, bad)).unwrap_err();
            assert!(matches!(error, Ros2Error::Variable { variable, .. } if variable == bad), "{error}");
        }
        for bad in ["ROS_DOMAIN_ID", "ZENOH_CONFIG_OVERRIDE", "ZENOH_ROUTER_CHECK_ATTEMPTS"] {
            let error = Environment::read_for_zenoh(&|name| bytes(name, bad)).unwrap_err();
            assert!(matches!(error, Ros2Error::Variable { variable, .. } if variable == bad), "{error}");
        }
        let file = Environment::read_for_zenoh(&|name| bytes(name, "ZENOH_SESSION_CONFIG_URI")).unwrap();
        assert!(file.zenoh.session_config.is_some(), "a path may have any bytes");
    }
}

//! The environment variables of ROS 2.

use std::net::Ipv4Addr;
use std::path::PathBuf;

use crate::error::Ros2Error;

/// Higher domains have no ports.
const MAX_DOMAIN: u16 = 232;

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
    pub static_peers: Vec<Ipv4Addr>,
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

impl Environment {
    /// That of this process.
    ///
    /// # Errors
    /// A variable has a value that it does not take.
    pub fn of_process() -> Result<Self, Ros2Error> {
        Self::from_variables(&|name| std::env::var(name).ok())
    }

    /// The same in another domain, if one is given.
    #[must_use]
    pub fn in_domain(self, domain: Option<u16>) -> Self {
        Self { domain: domain.unwrap_or(self.domain), ..self }
    }

    /// As `variable` states it.
    fn from_variables(variable: &dyn Fn(&str) -> Option<String>) -> Result<Self, Ros2Error> {
        let text = |name: &'static str| variable(name).filter(|value| !value.is_empty());
        let stated = text("ROS_DOMAIN_ID").map_or(Ok(0), |value| domain("ROS_DOMAIN_ID", &value))?;
        let range = match text("ROS_AUTOMATIC_DISCOVERY_RANGE") {
            _ if text("ROS_LOCALHOST_ONLY").as_deref() == Some("1") => DiscoveryRange::Localhost,
            None => DiscoveryRange::Subnet,
            Some(value) => range(value)?,
        };
        let peers = text("ROS_STATIC_PEERS").unwrap_or_default();
        let peers = peers.split(';').map(str::trim).filter(|peer| !peer.is_empty());
        let static_peers = peers.map(peer).collect::<Result<_, _>>()?;
        let zenoh = ZenohVariables::from_texts(&text)?;
        Ok(Self { domain: stated, range, static_peers, zenoh })
    }
}

impl ZenohVariables {
    /// As `text` states them.
    fn from_texts(text: &dyn Fn(&'static str) -> Option<String>) -> Result<Self, Ros2Error> {
        const ATTEMPTS: &str = "ZENOH_ROUTER_CHECK_ATTEMPTS";
        let attempts = text(ATTEMPTS).map_or(Ok(1), |value| {
            let expected = "a number; if it is negative, no router is expected";
            value.parse().map_err(|_| Ros2Error::Variable { variable: ATTEMPTS, value, expected })
        });
        Ok(Self {
            session_config: text("ZENOH_SESSION_CONFIG_URI").map(PathBuf::from),
            config_override: text("ZENOH_CONFIG_OVERRIDE"),
            router_check_attempts: attempts?,
        })
    }
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
            Err(Ros2Error::Variable { variable: "ROS_AUTOMATIC_DISCOVERY_RANGE", value, expected })
        }
    }
}

fn peer(text: &str) -> Result<Ipv4Addr, Ros2Error> {
    let expected = "IPv4 addresses separated by `;`";
    let error = |_| Ros2Error::Variable { variable: "ROS_STATIC_PEERS", value: text.to_owned(), expected };
    text.parse().map_err(error)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn environment(variables: &[(&str, &str)]) -> Result<Environment, Ros2Error> {
        Environment::from_variables(&|name| {
            variables.iter().find(|(key, _)| *key == name).map(|(_, value)| (*value).to_owned())
        })
    }

    #[test]
    fn the_variables_of_ros_are_read_as_ros_reads_them() {
        let default = environment(&[("ROS_DOMAIN_ID", "")]).unwrap();
        assert_eq!((default.domain, default.range), (0, DiscoveryRange::Subnet));
        let set = environment(&[
            ("ROS_DOMAIN_ID", "42"),
            ("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST"),
            ("ROS_STATIC_PEERS", "10.0.0.1; 10.0.0.2"),
        ]);
        let set = set.unwrap();
        assert_eq!((set.domain, set.range, set.static_peers.len()), (42, DiscoveryRange::Localhost, 2));
        let only = [("ROS_LOCALHOST_ONLY", "1"), ("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")];
        assert_eq!(environment(&only).unwrap().range, DiscoveryRange::Localhost);
    }

    #[test]
    fn the_variables_of_zenoh_are_read() {
        let default = environment(&[("ZENOH_CONFIG_OVERRIDE", "")]).unwrap().zenoh;
        assert_eq!(default, ZenohVariables { router_check_attempts: 1, ..ZenohVariables::default() });
        let set = environment(&[
            ("ZENOH_SESSION_CONFIG_URI", "/etc/session.json5"),
            ("ZENOH_CONFIG_OVERRIDE", "mode=\"client\""),
            ("ZENOH_ROUTER_CHECK_ATTEMPTS", "-1"),
        ]);
        let set = set.unwrap().zenoh;
        assert_eq!(set.session_config.unwrap(), PathBuf::from("/etc/session.json5"));
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
            ("ROS_STATIC_PEERS", "robot.local"),
            ("ZENOH_ROUTER_CHECK_ATTEMPTS", "never"),
        ] {
            let error = environment(&[(name, value)]).unwrap_err();
            assert!(error.to_string().starts_with(&format!("{name} is `{value}`, expected ")), "{error}");
        }
    }
}

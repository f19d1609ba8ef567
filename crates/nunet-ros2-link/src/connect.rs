//! Opens connections.

use std::sync::Arc;

use crate::environment::Environment;
use crate::error::Ros2Error;
use crate::link::Link;
use crate::link_name::LinkName;

/// Checks what can be checked of a connection without the network: the values of variables, and the file of
/// Zenoh's configuration.
///
/// # Errors
/// One of them cannot be used, or this build does not have the transport.
pub fn check(name: &LinkName, environment: &Environment) -> Result<(), Ros2Error> {
    match name {
        LinkName::Dds { .. } if cfg!(feature = "ros2-dds") => Ok(()),
        LinkName::Dds { .. } => Err(Ros2Error::Transport { name: "dds" }),
        LinkName::Zenoh { .. } => zenoh_link::check(name, environment),
    }
}

/// A connection that all users in this process share.
///
/// # Errors
/// The network cannot be used, or this build does not have the transport.
pub fn connect(name: &LinkName, environment: &Environment) -> Result<Arc<dyn Link>, Ros2Error> {
    match name {
        LinkName::Dds { domain } => dds_link::shared(&environment.clone().in_domain(*domain)),
        LinkName::Zenoh { .. } => zenoh_link::shared(name, environment),
    }
}

/// A connection that nothing else in this process shares: tests are two nodes by it.
///
/// # Errors
/// As [`connect`].
pub fn connect_alone(name: &LinkName, environment: &Environment) -> Result<Arc<dyn Link>, Ros2Error> {
    match name {
        LinkName::Dds { domain } => dds_link::alone(&environment.clone().in_domain(*domain)),
        LinkName::Zenoh { .. } => zenoh_link::alone(name, environment),
    }
}

#[cfg(feature = "ros2-dds")]
use crate::dds as dds_link;
#[cfg(feature = "ros2-zenoh")]
use crate::zenoh as zenoh_link;

/// Stands in for DDS in a build without it.
#[cfg(not(feature = "ros2-dds"))]
mod dds_link {
    use super::{Arc, Environment, Link, Ros2Error};

    const MISSING: Ros2Error = Ros2Error::Transport { name: "dds" };

    pub(super) fn shared(_: &Environment) -> Result<Arc<dyn Link>, Ros2Error> {
        Err(MISSING)
    }

    pub(super) fn alone(_: &Environment) -> Result<Arc<dyn Link>, Ros2Error> {
        Err(MISSING)
    }
}

/// Stands in for Zenoh in a build without it.
#[cfg(not(feature = "ros2-zenoh"))]
mod zenoh_link {
    use super::{Arc, Environment, Link, LinkName, Ros2Error};

    const MISSING: Ros2Error = Ros2Error::Transport { name: "zenoh" };

    pub(super) fn check(_: &LinkName, _: &Environment) -> Result<(), Ros2Error> {
        Err(MISSING)
    }

    pub(super) fn shared(_: &LinkName, _: &Environment) -> Result<Arc<dyn Link>, Ros2Error> {
        Err(MISSING)
    }

    pub(super) fn alone(_: &LinkName, _: &Environment) -> Result<Arc<dyn Link>, Ros2Error> {
        Err(MISSING)
    }
}

#[cfg(test)]
#[cfg(feature = "ros2-dds")]
mod tests {
    use super::*;
    use crate::environment::DiscoveryRange;

    #[test]
    fn names_of_one_domain_share_a_connection() {
        let environment =
            Environment { domain: 86, range: DiscoveryRange::Localhost, ..Environment::default() };
        let open = |name: &str| connect(&name.parse().unwrap(), &environment).unwrap();
        let default = open("dds");
        assert!(Arc::ptr_eq(&default, &open("dds:86")));
        assert!(!Arc::ptr_eq(&default, &open("dds:85")));
    }
}

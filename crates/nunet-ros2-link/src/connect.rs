//! Opens connections.

use std::sync::Arc;

use crate::environment::Environment;
use crate::error::Ros2Error;
use crate::link::Link;

/// A connection over DDS that nothing else in this process shares: tests are two nodes by it.
///
/// # Errors
/// As [`connect`].
pub fn connect_alone(environment: &Environment) -> Result<Arc<dyn Link>, Ros2Error> {
    #[cfg(feature = "ros2-dds")]
    return crate::dds::alone(environment);
    #[cfg(not(feature = "ros2-dds"))]
    {
        let _ = environment;
        Err(Ros2Error::Transport { name: "dds" })
    }
}

/// The connection over DDS to the domain of `environment`. All users in this process share it.
///
/// # Errors
/// The network cannot be used, or this build has no DDS.
pub fn connect(environment: &Environment) -> Result<Arc<dyn Link>, Ros2Error> {
    #[cfg(feature = "ros2-dds")]
    return crate::dds::shared(environment);
    #[cfg(not(feature = "ros2-dds"))]
    {
        let _ = environment;
        Err(Ros2Error::Transport { name: "dds" })
    }
}

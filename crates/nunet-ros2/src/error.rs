//! Why there is no connection to ROS 2.

use std::borrow::Cow;
use std::io;

use nunet_types::Hint;

/// Why there is no connection to ROS 2.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Ros2Error {
    /// A domain that ROS 2 does not have.
    #[error("{origin} is `{value}`, expected a ROS 2 domain from 0 to 232")]
    Domain {
        /// What states it.
        origin: &'static str,
        /// What it states.
        value: String,
    },
    /// A value that is not one of those that are known.
    #[error("unknown {what} `{value}`, expected {expected}")]
    Unknown {
        /// What it is.
        what: &'static str,
        /// The value.
        value: String,
        /// Those that are known.
        expected: String,
    },
    /// A variable of ROS 2 with a value that it does not take.
    #[error("{variable} is `{value}`, expected {expected}")]
    Variable {
        /// Its name.
        variable: &'static str,
        /// Its value.
        value: String,
        /// The values that it takes.
        expected: &'static str,
    },
    /// A camera whose name cannot be part of a topic.
    #[error(
        "camera name `{name}` cannot be part of a ROS 2 topic, expected letters, digits and single underscores, and no digit first"
    )]
    CameraName {
        /// The name.
        name: String,
    },
    /// A topic that the camera does not have.
    #[error("topic `{topic}` needs {needed}")]
    Missing {
        /// The topic.
        topic: &'static str,
        /// What it needs.
        needed: &'static str,
    },
    /// Another transport than those of this build.
    #[error("this build has no transport `{name}`")]
    Transport {
        /// The transport.
        name: &'static str,
    },
    /// All ports of the domain are taken, or the network cannot be used.
    #[error("cannot open the network of ROS 2 domain {domain}")]
    Network {
        /// The domain.
        domain: u16,
        /// Why.
        source: io::Error,
    },
    /// The library refused something.
    #[error("cannot {action}: {reason}")]
    Middleware {
        /// What was to be done.
        action: &'static str,
        /// Why not.
        reason: String,
    },
    /// A thread cannot be started.
    #[error("cannot start a thread for ROS 2")]
    Thread(#[source] io::Error),
}

/// A kind of [`Ros2Error`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Ros2ErrorKind {
    /// A value that the user chose.
    Arguments,
    /// The network cannot be used.
    Network,
    /// The system has no resources left, or a library failed.
    System,
}

impl Ros2Error {
    /// What kind of failure it is.
    #[must_use]
    pub fn kind(&self) -> Ros2ErrorKind {
        match self {
            Self::Domain { .. }
            | Self::Unknown { .. }
            | Self::Variable { .. }
            | Self::CameraName { .. }
            | Self::Missing { .. }
            | Self::Transport { .. } => Ros2ErrorKind::Arguments,
            Self::Network { .. } => Ros2ErrorKind::Network,
            Self::Middleware { .. } | Self::Thread(_) => Ros2ErrorKind::System,
        }
    }
}

impl Hint for Ros2Error {
    fn hint(&self) -> Option<Cow<'static, str>> {
        match self {
            Self::Domain { .. } => {
                Some("use the domain of the nodes that are to receive, 0 by default".into())
            }
            Self::CameraName { name } => Some(format!("use a name like `{}`", valid_name(name)).into()),
            Self::Network { .. } => Some("another domain has other ports".into()),
            _ => None,
        }
    }
}

/// Whether ROS 2 accepts `name` as a part of a topic.
pub(crate) fn is_valid_name(name: &str) -> bool {
    let is_word = |character: char| character.is_ascii_alphanumeric() || character == '_';
    !name.is_empty()
        && name.chars().all(is_word)
        && !name.contains("__")
        && !name.starts_with(|first: char| first.is_ascii_digit())
}

fn valid_name(name: &str) -> String {
    let word = |character: char| if character.is_ascii_alphanumeric() { character } else { '_' };
    let mut valid: String = name.chars().map(word).collect();
    while valid.contains("__") {
        valid = valid.replace("__", "_");
    }
    if is_valid_name(&valid) { valid } else { format!("camera_{valid}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_that_ros_does_not_take_gets_one_that_it_takes() {
        for name in ["front", "_a", "left_arm0"] {
            assert!(is_valid_name(name), "{name}");
        }
        for name in ["left-arm.0", "0", "a__b", "", "é", "9-"] {
            assert!(!is_valid_name(name), "{name}");
            assert!(is_valid_name(&valid_name(name)), "{name}: {}", valid_name(name));
        }
    }
}

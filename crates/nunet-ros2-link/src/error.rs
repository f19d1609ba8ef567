//! Why there is no connection to ROS 2.

use std::borrow::Cow;
use std::io;
use std::path::PathBuf;

use nunet_types::Hint;

use crate::name::valid_part;

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
    /// An address that Zenoh does not have.
    #[error("`{value}` is not a Zenoh endpoint, expected PROTOCOL/ADDRESS such as `tcp/192.168.1.5:7447`")]
    Endpoint {
        /// The address.
        value: String,
    },
    /// The file that `ZENOH_SESSION_CONFIG_URI` names.
    #[error("cannot read the Zenoh configuration `{}` (ZENOH_SESSION_CONFIG_URI): {reason}", path.display())]
    ZenohFile {
        /// The file.
        path: PathBuf,
        /// Why not.
        reason: String,
    },
    /// A setting that Zenoh does not have, or with a value that it does not take.
    #[error("ZENOH_CONFIG_OVERRIDE cannot set `{setting}`: {reason}")]
    ZenohSetting {
        /// The setting.
        setting: String,
        /// Why not.
        reason: String,
    },
    /// A Zenoh client that can have no connection.
    #[error("a Zenoh client needs a router, but `connect/endpoints` is empty and multicast is off")]
    NoZenohRouter,
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
    /// A machine of `ROS_STATIC_PEERS` that has no address.
    #[error("cannot look up `{name}` (ROS_STATIC_PEERS)")]
    StaticPeer {
        /// Its name.
        name: String,
        /// Why not.
        source: io::Error,
    },
    /// A camera whose name cannot be part of a topic.
    #[error(
        "camera name `{name}` cannot be part of a ROS 2 topic, expected letters, digits and single underscores, and no digit first"
    )]
    CameraName {
        /// The name.
        name: String,
    },
    /// A name that no topic can have.
    #[error("`{name}` cannot be the name of a ROS 2 topic, expected parts like `camera` separated by `/`")]
    TopicName {
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
    Argument,
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
            | Self::Endpoint { .. }
            | Self::ZenohFile { .. }
            | Self::ZenohSetting { .. }
            | Self::NoZenohRouter
            | Self::Variable { .. }
            | Self::CameraName { .. }
            | Self::TopicName { .. }
            | Self::Missing { .. }
            | Self::Transport { .. } => Ros2ErrorKind::Argument,
            Self::Network { .. } | Self::StaticPeer { .. } => Ros2ErrorKind::Network,
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
            Self::CameraName { name } => Some(format!("use a name like `{}`", valid_part(name)).into()),
            Self::TopicName { .. } => {
                Some("a part has letters, digits and single underscores, and no digit first".into())
            }
            Self::Endpoint { .. } => {
                Some("the protocols are tcp, udp, tls (HOST:PORT) and unixsock-stream (a path)".into())
            }
            Self::ZenohFile { .. } => {
                Some("name a .json5 file like DEFAULT_RMW_ZENOH_SESSION_CONFIG.json5 of rmw_zenoh_cpp".into())
            }
            Self::ZenohSetting { .. } => {
                Some("separate settings of the form KEY=VALUE by `;`, such as `mode=\"client\"`".into())
            }
            Self::NoZenohRouter => {
                Some("name a router in `connect/endpoints`, such as `tcp/192.168.1.5:7447`".into())
            }
            Self::StaticPeer { .. } => Some("state the IPv4 address of the machine".into()),
            Self::Network { .. } => Some("another domain has other ports".into()),
            Self::Transport { name } => {
                Some(format!("build nunetd with the Cargo feature `ros2-{name}`").into())
            }
            _ => None,
        }
    }

    fn is_usage(&self) -> bool {
        self.kind() == Ros2ErrorKind::Argument
    }
}

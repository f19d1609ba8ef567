//! Why the server cannot be opened.

use std::borrow::Cow;
use std::io;
use std::net::SocketAddr;

use nunet_ros2::Ros2Error;
use nunet_types::{Hint, hint_of_listen};

/// Why the server cannot be opened, or a camera not be added.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FoxgloveServerError {
    /// The address is in use, is not one of this machine, or needs privileges.
    #[error("cannot listen on `{address}`")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// Why.
        source: io::Error,
    },
    /// Other machines can reach the address, and the user did not allow that.
    #[error("other machines can reach `{address}`, and Foxglove sends no password")]
    Exposed {
        /// The address.
        address: SocketAddr,
    },
    /// The library refused something.
    #[error("the server failed: {reason}")]
    Library {
        /// Its message.
        reason: String,
    },
    /// The server's thread cannot be started.
    #[error("cannot start the thread of the server")]
    Thread(#[source] io::Error),
    /// A camera cannot be added.
    #[error("cannot add camera `{camera}`")]
    Camera {
        /// Its name.
        camera: String,
        /// Why.
        source: Ros2Error,
    },
    /// This build has no server.
    #[error("this build has no server for Foxglove")]
    NotBuilt,
}

/// A kind of [`FoxgloveServerError`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum FoxgloveServerErrorKind {
    /// The address cannot be used.
    Address,
    /// A value that the user chose.
    Argument,
    /// The system has no resources left, or a library failed.
    System,
}

impl FoxgloveServerError {
    /// What kind of failure it is.
    #[must_use]
    pub fn kind(&self) -> FoxgloveServerErrorKind {
        match self {
            Self::Listen { .. } => FoxgloveServerErrorKind::Address,
            Self::Exposed { .. } | Self::NotBuilt => FoxgloveServerErrorKind::Argument,
            Self::Library { .. } | Self::Thread(_) | Self::Camera { .. } => FoxgloveServerErrorKind::System,
        }
    }
}

impl Hint for FoxgloveServerError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        match self {
            Self::Listen { source, .. } => hint_of_listen(source, "127.0.0.1"),
            Self::Exposed { .. } => Some("listen on 127.0.0.1, and forward the port with ssh".into()),
            Self::NotBuilt => Some("build nunetd with the Cargo feature `foxglove`".into()),
            _ => None,
        }
    }

    fn is_usage(&self) -> bool {
        self.kind() == FoxgloveServerErrorKind::Argument
    }
}

//! Why the server cannot be opened.

use std::borrow::Cow;
use std::io;
use std::net::SocketAddr;

use nunet_types::{Hint, hint_of_listen};

/// Why the server cannot be opened.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ViewError {
    /// The address is in use, is not one of this machine, or needs privileges.
    #[error("cannot listen on `{address}`")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// Why.
        source: io::Error,
    },
    /// Other machines can reach the address, and there is no token.
    #[error("cannot listen on `{address}` without a token: other machines can reach it")]
    TokenRequired {
        /// The address.
        address: SocketAddr,
    },
    /// A token is empty, too long, or has a character that URLs or cookies do not take.
    #[error("the token {reason}")]
    Token {
        /// What is wrong with it. The token itself is never part of a message.
        reason: &'static str,
    },
    /// The server's thread cannot be started.
    #[error("cannot start the thread of the server")]
    Thread(#[source] io::Error),
}

/// A kind of [`ViewError`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ViewErrorKind {
    /// The address cannot be used.
    Address,
    /// The token is missing or malformed.
    Token,
    /// The system has no resources left.
    System,
}

impl ViewError {
    /// What kind of failure it is.
    #[must_use]
    pub fn kind(&self) -> ViewErrorKind {
        match self {
            Self::Listen { .. } => ViewErrorKind::Address,
            Self::TokenRequired { .. } | Self::Token { .. } => ViewErrorKind::Token,
            Self::Thread(_) => ViewErrorKind::System,
        }
    }
}

impl Hint for ViewError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        match self {
            Self::Listen { source, .. } => hint_of_listen(source, "127.0.0.1 or 0.0.0.0"),
            Self::TokenRequired { .. } => Some("set a token, or listen on 127.0.0.1".into()),
            Self::Token { .. } => Some("use 1 to 256 letters, digits or -._~+/=".into()),
            Self::Thread(_) => None,
        }
    }
}

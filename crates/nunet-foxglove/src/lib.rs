//! Results live in [Foxglove](https://foxglove.dev), over a WebSocket.
//!
//! | module | what it contains |
//! |---|---|
//! | `server` | the server: one thread, and the sinks of its cameras |
//! | `relay` | connections: how many, how long without a request, how many bytes |
//! | `library` | the library's server behind it |
//! | `channels` | a channel for each topic of a recording, with the same messages |
//! | `kept` | messages for clients that subscribe later, such as transforms |
//! | `parameters` | what clients can read beside messages: rate, scale |
//!
//! Frames are copied and encoded by `nunet-ros2`, on a thread of its own and only for topics that a client
//! has subscribed to. Foxglove is a transport of that crate, like DDS and Zenoh.

#[cfg(not(feature = "server"))]
mod absent;
#[cfg(feature = "server")]
mod channels;
mod error;
#[cfg(feature = "server")]
mod kept;
#[cfg(feature = "server")]
mod library;
#[cfg(feature = "server")]
mod parameters;
#[cfg(feature = "server")]
mod relay;
#[cfg(feature = "server")]
pub mod server;
#[cfg(feature = "server")]
mod sink;

use std::net::SocketAddr;

#[cfg(not(feature = "server"))]
pub use absent::FoxgloveServer;
pub use error::{FoxgloveServerError, FoxgloveServerErrorKind};
#[cfg(feature = "server")]
pub use server::FoxgloveServer;

/// More clients at a time are refused.
pub const MAX_CLIENTS: usize = 16;
/// A client that has sent this many bytes is disconnected, so that the library cannot collect more of one.
/// The requests of a session have a few kilobytes.
pub const MAX_CLIENT_BYTES: u64 = 1 << 20;

/// Where the server listens.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FoxgloveConfig {
    /// The address.
    pub address: SocketAddr,
    /// Whether other machines may reach it. Foxglove sends no password, so everyone who reaches it sees all
    /// images.
    pub is_public: bool,
}

impl FoxgloveConfig {
    /// Checks the address without using it.
    ///
    /// # Errors
    /// Other machines can reach the address, and the user did not allow that.
    pub fn check(&self) -> Result<(), FoxgloveServerError> {
        let is_loopback = self.address.ip().to_canonical().is_loopback();
        if is_loopback || self.is_public {
            Ok(())
        } else {
            Err(FoxgloveServerError::Exposed { address: self.address })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_address_that_other_machines_reach_must_be_allowed() {
        let check = |address: &str, is_public| {
            FoxgloveConfig { address: address.parse().unwrap(), is_public }.check()
        };
        for address in ["0.0.0.0:8765", "192.168.1.5:8765", "[::]:8765"] {
            let error = check(address, false).unwrap_err();
            assert_eq!(error.kind(), FoxgloveServerErrorKind::Argument, "{address}");
            assert!(check(address, true).is_ok());
        }
        for address in ["127.0.0.1:8765", "127.8.8.8:1", "[::1]:8765", "[::ffff:127.0.0.1]:8765"] {
            assert!(check(address, false).is_ok(), "{address}");
        }
    }
}

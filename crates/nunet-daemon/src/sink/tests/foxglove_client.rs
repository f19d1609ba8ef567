//! A client of the server for Foxglove.

#[path = "../../../tests/foxglove_subscription.rs"]
mod foxglove_subscription;

use std::net::SocketAddr;

use tokio::runtime::{Builder, Runtime};

use self::foxglove_subscription::{Socket, subscribe};
use super::TIMEOUT;

/// A client that subscribes to a topic and reads no message of it.
pub(super) struct SilentClient {
    _socket: Socket,
    /// It runs only in [`SilentClient::subscribe`].
    _runtime: Runtime,
}

impl SilentClient {
    /// Connects, and subscribes to a topic.
    pub(super) fn subscribe(address: SocketAddr, topic: &str) -> Self {
        let runtime = Builder::new_current_thread().enable_all().build().unwrap();
        let socket = runtime.block_on(async {
            tokio::time::timeout(TIMEOUT, subscribe(address, topic)).await.expect("it takes too long")
        });
        Self { _socket: socket, _runtime: runtime }
    }
}

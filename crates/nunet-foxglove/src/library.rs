//! The library's server: it listens on loopback only, for the relay.

use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use foxglove::websocket::Parameter;
use foxglove::{Context, FoxgloveError, WebSocketServer, WebSocketServerHandle};
use tokio::net::{TcpSocket, TcpStream};
use tracing::warn;

use crate::kept::KeptMessages;
use crate::parameters::Parameters;

/// A connection over loopback needs no time; one that needs more is given up.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(1);
/// Small, because what waits here for a slow client is not replaced by newer messages. The kernel's default
/// grows to several megabytes.
const RECEIVE_BUFFER_BYTES: u32 = 64 << 10;

/// What the server is started with, each time.
pub(crate) struct LibrarySetup {
    pub(crate) context: Arc<Context>,
    pub(crate) kept: Arc<KeptMessages>,
    pub(crate) parameters: Arc<Parameters>,
    /// Messages that wait for each client.
    pub(crate) backlog: usize,
}

impl LibrarySetup {
    async fn start(&self) -> Result<WebSocketServerHandle, FoxgloveError> {
        let server = WebSocketServer::new()
            .name("nunetd")
            .bind(Ipv4Addr::LOCALHOST.to_string(), 0)
            .message_backlog_size(self.backlog)
            .listener(self.kept.clone())
            .parameter_handler(self.parameters.clone())
            .context(&self.context);
        server.start().await
    }
}

/// The running server.
pub(crate) struct Library {
    setup: LibrarySetup,
    server: WebSocketServerHandle,
    /// Where it listens.
    address: SocketAddr,
    /// What clients know of the parameters.
    published: Vec<Parameter>,
}

impl Library {
    /// Starts it. Its tasks run on the runtime that this is called on.
    pub(crate) async fn start(setup: LibrarySetup) -> Result<Self, FoxgloveError> {
        let server = setup.start().await?;
        let address = address_of(&server);
        Ok(Self { setup, server, address, published: Vec::new() })
    }

    /// A connection to it. It stops listening for good after one connection that it cannot accept, usually
    /// because too many files are open: then it is started again.
    pub(crate) async fn connect(&mut self) -> io::Result<TcpStream> {
        match self.try_connect().await {
            Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => {
                self.start_again().await?;
                self.try_connect().await
            }
            result => result,
        }
    }

    async fn try_connect(&self) -> io::Result<TcpStream> {
        let socket = TcpSocket::new_v4()?;
        socket.set_recv_buffer_size(RECEIVE_BUFFER_BYTES)?;
        tokio::time::timeout(CONNECT_TIMEOUT, socket.connect(self.address)).await?
    }

    /// Its clients are disconnected, because two servers would have to share the parameters.
    async fn start_again(&mut self) -> io::Result<()> {
        let failed = |error: FoxgloveError| io::Error::other(error.to_string());
        let server = self.setup.start().await.map_err(failed)?;
        warn!("the server for Foxglove had stopped and is started again; its clients are disconnected");
        self.address = address_of(&server);
        // A client's channels are given up by its task: it must not be aborted.
        std::mem::replace(&mut self.server, server).stop().detach_all();
        Ok(())
    }

    /// Sends parameters that have changed to the clients that subscribe to them.
    pub(crate) fn publish_parameters(&mut self) {
        let current = self.setup.parameters.all();
        if current != self.published {
            self.server.publish_parameter_values(current.clone());
            self.published = current;
        }
    }

    /// Says goodbye to all clients.
    pub(crate) async fn stop(self) {
        self.server.stop().wait().await;
    }
}

fn address_of(server: &WebSocketServerHandle) -> SocketAddr {
    SocketAddr::from((Ipv4Addr::LOCALHOST, server.port()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_server_that_has_stopped_is_started_again() {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        runtime.block_on(async {
            let setup = LibrarySetup {
                context: Context::new(),
                kept: Arc::default(),
                parameters: Arc::default(),
                backlog: 1,
            };
            let mut library = Library::start(setup).await.unwrap();
            let first = library.address;
            // Nothing listens on port 1.
            library.address = SocketAddr::from((Ipv4Addr::LOCALHOST, 1));
            let stream = library.connect().await.unwrap();
            assert_ne!(library.address, first);
            assert_eq!(stream.peer_addr().unwrap(), library.address);
        });
    }
}

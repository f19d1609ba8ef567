//! Connections of clients, passed on to the library.
//!
//! The library alone waits without end for the request of a client, has no limit on clients, accepts
//! messages of 64 MiB, and stops listening after a failure. See `docs/decisions/044-foxglove-connections.md`.

use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::{Duration, Instant};

use nunet_telemetry::RateLimit;
use rustix::net::sockopt;
use tokio::io::{AsyncBufReadExt as _, AsyncReadExt as _, BufReader};
use tokio::net::tcp::{ReadHalf, WriteHalf};
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tracing::{debug, warn};

use crate::library::Library;
use crate::{MAX_CLIENT_BYTES, MAX_CLIENTS};

/// A client that is not accepted as a client of Foxglove within this time is disconnected.
const HANDSHAKE_TIMEOUT: Duration = Duration::from_secs(5);
/// A client that confirms or takes nothing for this long is disconnected.
const DEAD_AFTER_MILLIS: u32 = 20_000;
/// How often a client that does not answer is asked again.
const KEEPALIVE_PERIOD: Duration = Duration::from_secs(5);
/// What waits here for a slow client is not replaced by newer messages. Enough for 75 Mbit/s at 20 ms.
const SEND_BUFFER_BYTES: u32 = 192 << 10;
/// What is read from the library at a time.
const COPY_BYTES: usize = 64 << 10;
/// Connections that wait to be accepted; more are delayed by the kernel.
const BACKLOG: u32 = 128;
/// Pause after a connection that could not be accepted: usually too many files are open, and a retry would
/// fail again.
const ACCEPT_PAUSE: Duration = Duration::from_millis(50);

/// Listens for clients; needs the runtime that accepts them.
pub(crate) fn listen(address: SocketAddr) -> io::Result<TcpListener> {
    let socket = if address.is_ipv4() { TcpSocket::new_v4()? } else { TcpSocket::new_v6()? };
    socket.set_reuseaddr(true)?;
    // Accepted connections inherit the rest.
    socket.set_send_buffer_size(SEND_BUFFER_BYTES)?;
    socket.set_keepalive(true)?;
    sockopt::set_tcp_keepidle(&socket, Duration::from_millis(DEAD_AFTER_MILLIS.into()))?;
    sockopt::set_tcp_keepintvl(&socket, KEEPALIVE_PERIOD)?;
    sockopt::set_tcp_user_timeout(&socket, DEAD_AFTER_MILLIS)?;
    socket.bind(address)?;
    socket.listen(BACKLOG)
}

/// The places of clients.
pub(crate) struct Clients {
    room: Arc<Semaphore>,
    failures: RateLimit,
}

impl Default for Clients {
    fn default() -> Self {
        Self { room: Arc::new(Semaphore::new(MAX_CLIENTS)), failures: RateLimit::default() }
    }
}

impl Clients {
    /// Connects a client with the library, if there is room. After a failure, others can still connect.
    pub(crate) async fn admit(
        &mut self,
        accepted: io::Result<(TcpStream, SocketAddr)>,
        library: &mut Library,
    ) {
        let client = match accepted {
            Ok((client, _)) => client,
            Err(error) => {
                self.report(&format!("cannot accept a client of Foxglove: {error}"));
                return tokio::time::sleep(ACCEPT_PAUSE).await;
            }
        };
        let Ok(place) = Arc::clone(&self.room).try_acquire_owned() else {
            return self.report(&format!("refused a client of Foxglove: {MAX_CLIENTS} are connected"));
        };
        match library.connect().await {
            Ok(server) => {
                tokio::spawn(serve(place, client, server));
            }
            Err(error) => self.report(&format!("cannot serve a client of Foxglove: {error}")),
        }
    }

    /// Waits until all clients are disconnected.
    pub(crate) async fn all_gone(&self) {
        // It fails only if the semaphore is closed, which is never.
        let _ = self.room.acquire_many(MAX_CLIENTS as u32).await;
    }

    fn report(&mut self, text: &str) {
        if let Some(suppressed) = self.failures.allow_text(Instant::now(), text) {
            warn!("{text}{suppressed}");
        }
    }
}

/// Passes bytes on until one side ends. Both connections end then, and after them the place is free.
async fn serve(_place: OwnedSemaphorePermit, mut client: TcpStream, mut server: TcpStream) {
    // Without TCP_NODELAY, small messages are delayed. If it cannot be set, latency is a little higher.
    let _ = client.set_nodelay(true);
    let _ = server.set_nodelay(true);
    let (mut from_client, mut to_client) = client.split();
    let (mut from_server, mut to_server) = server.split();
    let ended = tokio::select! {
        ended = requests(&mut from_client, &mut to_server) => ended,
        ended = answers(&mut from_server, &mut to_client) => ended,
    };
    if let Err(error) = ended {
        debug!("a client of Foxglove was disconnected: {error}");
    }
}

/// Passes on what a client sends, up to a limit.
async fn requests(client: &mut ReadHalf<'_>, server: &mut WriteHalf<'_>) -> io::Result<()> {
    let copied = tokio::io::copy(&mut client.take(MAX_CLIENT_BYTES), server).await?;
    if copied < MAX_CLIENT_BYTES { Ok(()) } else { Err(io::Error::other("it has sent too much")) }
}

/// Passes on what the library sends. Its first bytes are the answer to a complete request.
async fn answers(server: &mut ReadHalf<'_>, client: &mut WriteHalf<'_>) -> io::Result<()> {
    let mut server = BufReader::with_capacity(COPY_BYTES, server);
    tokio::time::timeout(HANDSHAKE_TIMEOUT, server.fill_buf()).await??;
    tokio::io::copy_buf(&mut server, client).await?;
    Ok(())
}

//! The server: one thread, one socket, and timeouts for idle connections.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use axum::Router;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use tokio::net::TcpStream;
use tokio::sync::{Semaphore, oneshot};
use tokio_io_timeout::TimeoutStream;
use tracing::debug;

use crate::camera::{CameraFeed, Cameras};
use crate::error::ViewError;
use crate::http::{MAX_VIEWERS, MetricsText, ServerState, metrics_only, router};
use crate::token::Token;

/// A client that does not send a request within this time is disconnected.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(5);
/// A client that reads nothing of a response for this long is disconnected.
const WRITE_TIMEOUT: Duration = Duration::from_secs(20);
/// More connections at a time are refused.
const MAX_CONNECTIONS: usize = 64;
/// Pause after a connection that could not be accepted: usually too many files are open, and a retry would
/// fail again.
const ACCEPT_PAUSE: Duration = Duration::from_millis(50);

/// Where the live view is served, and who may see it.
#[derive(Debug, Clone)]
pub struct ViewConfig {
    /// An address; other machines reach it only with a token.
    pub address: SocketAddr,
    /// The secret that viewers present.
    pub token: Option<Token>,
}

/// What a server is opened with.
#[derive(Default)]
pub struct ViewOptions {
    /// The secret that viewers present. Without one, only loopback addresses are accepted.
    pub token: Option<Token>,
    /// The text of `/metrics`.
    pub metrics: Option<MetricsText>,
}

/// The page and its files and streams, until it is dropped.
pub struct ViewServer {
    cameras: Arc<Cameras>,
    running: Running,
}

impl ViewServer {
    /// Listens on `address`; port 0 takes a free one.
    ///
    /// # Errors
    /// The address cannot be used, or other machines can reach it and there is no token.
    pub fn open(address: SocketAddr, options: ViewOptions) -> Result<Self, ViewError> {
        let ViewOptions { token, metrics } = options;
        check_address(address, token.is_some())?;
        let cameras = Arc::<Cameras>::default();
        let running = Running::start("view", address, |address| {
            router(ServerState {
                cameras: Arc::clone(&cameras),
                token,
                metrics,
                port: address.port(),
                room: Arc::new(Semaphore::new(MAX_VIEWERS)),
            })
        })?;
        Ok(Self { cameras, running })
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.running.address
    }

    /// The page as a browser on this machine opens it.
    #[must_use]
    pub fn url(&self) -> String {
        let address = self.running.address;
        let ip = match address.ip() {
            IpAddr::V4(ip) if ip.is_unspecified() => IpAddr::V4(Ipv4Addr::LOCALHOST),
            IpAddr::V6(ip) if ip.is_unspecified() => IpAddr::V6(Ipv6Addr::LOCALHOST),
            ip => ip,
        };
        format!("http://{}/", SocketAddr::new(ip, address.port()))
    }

    /// Adds a camera with the names of its classes, by label. One of the same name is replaced.
    /// `_page` is the name of the page's files.
    #[must_use]
    pub fn add_camera(&self, name: &str, classes: &[String]) -> CameraFeed {
        self.cameras.add(name, classes)
    }
}

/// Whether a server may listen on `address`.
///
/// # Errors
/// Other machines can reach it, and there is no token.
pub fn check_address(address: SocketAddr, has_token: bool) -> Result<(), ViewError> {
    let is_loopback = address.ip().to_canonical().is_loopback();
    if is_loopback || has_token { Ok(()) } else { Err(ViewError::TokenRequired { address }) }
}

/// `/metrics` alone, at an address of its own, until it is dropped. It needs no token: metrics contain rates,
/// not images.
pub struct MetricsServer(Running);

impl MetricsServer {
    /// Listens on `address`; port 0 takes a free one.
    ///
    /// # Errors
    /// The address cannot be used.
    pub fn open(address: SocketAddr, metrics: MetricsText) -> Result<Self, ViewError> {
        Running::start("metrics", address, |_| metrics_only(metrics)).map(Self)
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.0.address
    }
}

/// A server's thread.
struct Running {
    address: SocketAddr,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Running {
    fn start(
        name: &str,
        address: SocketAddr,
        routes: impl FnOnce(SocketAddr) -> Router,
    ) -> Result<Self, ViewError> {
        let cannot_listen = |source| ViewError::Listen { address, source };
        let listener = TcpListener::bind(address).map_err(cannot_listen)?;
        listener.set_nonblocking(true).map_err(cannot_listen)?;
        let address = listener.local_addr().map_err(cannot_listen)?;
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let runtime = runtime.map_err(ViewError::Thread)?;
        let listener = {
            let _entered = runtime.enter();
            tokio::net::TcpListener::from_std(listener).map_err(cannot_listen)?
        };
        let (stop, stopped) = oneshot::channel();
        let routes = routes(address);
        let serve = move || runtime.block_on(accept(listener, routes, stopped));
        let thread = std::thread::Builder::new().name(name.to_owned()).spawn(serve);
        Ok(Self { address, stop: Some(stop), thread: Some(thread.map_err(ViewError::Thread)?) })
    }
}

impl Drop for Running {
    /// Closes all connections. It waits for the image that is being encoded, if there is one.
    fn drop(&mut self) {
        drop(self.stop.take());
        self.thread.take().map(JoinHandle::join).into_iter().for_each(drop);
    }
}

/// Accepts connections until `stopped`.
async fn accept(listener: tokio::net::TcpListener, routes: Router, mut stopped: oneshot::Receiver<()>) {
    let room = Arc::new(Semaphore::new(MAX_CONNECTIONS));
    loop {
        let accepted = tokio::select! {
            accepted = listener.accept() => accepted,
            _ = &mut stopped => return,
        };
        let stream = match accepted {
            Ok((stream, _)) => stream,
            Err(error) => {
                debug!("cannot accept a connection: {error}");
                tokio::time::sleep(ACCEPT_PAUSE).await;
                continue;
            }
        };
        let Ok(place) = Arc::clone(&room).try_acquire_owned() else {
            debug!("refused a connection: {MAX_CONNECTIONS} are open");
            continue;
        };
        let routes = routes.clone();
        tokio::spawn(async move {
            if let Err(error) = serve(stream, routes).await {
                debug!("a connection failed: {error}");
            }
            drop(place);
        });
    }
}

async fn serve(stream: TcpStream, routes: Router) -> Result<(), hyper::Error> {
    // Without TCP_NODELAY, small frames are delayed. If it cannot be set, latency is a little higher.
    let _ = stream.set_nodelay(true);
    let mut stream = TimeoutStream::new(stream);
    stream.set_write_timeout(Some(WRITE_TIMEOUT));
    http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(REQUEST_TIMEOUT)
        .serve_connection(TokioIo::new(Box::pin(stream)), TowerToHyperService::new(routes))
        .with_upgrades()
        .await
}

#[cfg(test)]
mod tests {
    use nunet_types::Hint as _;

    use super::*;
    use crate::error::ViewErrorKind;

    #[test]
    fn an_address_that_other_machines_reach_needs_a_token() {
        for address in ["0.0.0.0:0", "192.168.1.5:80", "[::]:0"] {
            let address = address.parse().unwrap();
            assert_eq!(check_address(address, false).unwrap_err().kind(), ViewErrorKind::Token, "{address}");
            assert!(check_address(address, true).is_ok());
        }
        for address in ["127.0.0.1:0", "127.8.8.8:0", "[::1]:0", "[::ffff:127.0.0.1]:0"] {
            assert!(check_address(address.parse().unwrap(), false).is_ok(), "{address}");
        }
    }

    #[test]
    fn the_url_of_an_address_for_all_is_one_that_a_browser_opens() {
        let options = ViewOptions { token: Some(Token::new("t").unwrap()), metrics: None };
        let server = ViewServer::open("0.0.0.0:0".parse().unwrap(), options).unwrap();
        assert_eq!(server.url(), format!("http://127.0.0.1:{}/", server.address().port()));
    }

    #[test]
    fn a_port_in_use_is_an_error_with_a_hint_and_free_again_after_a_drop() {
        let server = ViewServer::open("127.0.0.1:0".parse().unwrap(), ViewOptions::default()).unwrap();
        let address = server.address();
        let error = ViewServer::open(address, ViewOptions::default()).err().unwrap();
        assert_eq!(
            (error.kind(), error.to_string()),
            (ViewErrorKind::Address, format!("cannot listen on `{address}`"))
        );
        assert!(error.hint().unwrap().contains("another port"));
        drop(server);
        assert!(ViewServer::open(address, ViewOptions::default()).is_ok());
    }
}

//! The server: one thread, one socket.

use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use foxglove::{Context, FoxgloveError, WebSocketServer, WebSocketServerHandle};
use nunet_ros2::{CameraOptions, Ros2Node, Topic, Topics};
use nunet_sink::sink::Sink;
use tokio::sync::oneshot;

use crate::FoxgloveConfig;
use crate::channels::{Channels, NETWORK};
use crate::error::FoxgloveServerError;
use crate::kept::KeptMessages;
use crate::parameters::Parameters;
use crate::sink::FoxgloveSink;

/// How often clients get parameters that have changed.
const PARAMETER_PERIOD: Duration = Duration::from_secs(1);
/// A client that does not take its farewell within this time is disconnected without it.
const STOP_TIMEOUT: Duration = Duration::from_millis(500);

/// A server for Foxglove, until it is dropped.
pub struct FoxgloveServer {
    address: SocketAddr,
    node: Ros2Node,
    parameters: Arc<Parameters>,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl FoxgloveServer {
    /// Listens; port 0 takes a free one.
    ///
    /// Up to one frame of `cameras` waits for each client. A shorter queue would lose the first messages of
    /// each frame, because a frame is sent at once; a longer one would only add latency.
    ///
    /// # Errors
    /// The address cannot be used, or other machines can reach it and may not.
    pub fn open(config: FoxgloveConfig, cameras: usize) -> Result<Self, FoxgloveServerError> {
        config.check()?;
        let (context, kept) = (Context::new(), Arc::<KeptMessages>::default());
        let parameters = Arc::<Parameters>::default();
        let host = match config.address.ip() {
            IpAddr::V4(ip) => ip.to_string(),
            IpAddr::V6(ip) => format!("[{ip}]"),
        };
        let server = WebSocketServer::new()
            .name("nunetd")
            .bind(host, config.address.port())
            .message_backlog_size(Topic::RECORDED.len() * cameras.max(1))
            .listener(kept.clone())
            .parameter_handler(parameters.clone())
            .context(&context);
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let runtime = runtime.map_err(FoxgloveServerError::Thread)?;
        // Its tasks run on this runtime, because it is started there.
        let handle = runtime.block_on(server.start()).map_err(|error| match error {
            FoxgloveError::Bind(source) => FoxgloveServerError::Listen { address: config.address, source },
            error => FoxgloveServerError::Library { reason: error.to_string() },
        })?;
        let address = SocketAddr::new(config.address.ip(), handle.port());
        let channels = Channels::new(context, kept, runtime.handle().clone());
        let (stop, stopped) = oneshot::channel();
        let served = Arc::clone(&parameters);
        let serve = move || runtime.block_on(serve(handle, &served, stopped));
        let thread = std::thread::Builder::new().name("foxglove".to_owned()).spawn(serve);
        let thread = Some(thread.map_err(FoxgloveServerError::Thread)?);
        let node = Ros2Node::over(Arc::new(channels), NETWORK, Topics::Recorded);
        Ok(Self { address, node, parameters, stop: Some(stop), thread })
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Adds the channels of a camera.
    ///
    /// # Errors
    /// No more threads.
    pub fn add_camera(&self, camera: &CameraOptions<'_>) -> Result<Box<dyn Sink>, FoxgloveServerError> {
        let failed = |source| FoxgloveServerError::Camera { camera: camera.name.to_owned(), source };
        let messages = self.node.add_camera(camera).map_err(failed)?;
        let parameters = Arc::clone(&self.parameters);
        Ok(Box::new(FoxgloveSink { camera: camera.name.to_owned(), messages, parameters }))
    }
}

impl Drop for FoxgloveServer {
    /// Closes all connections.
    fn drop(&mut self) {
        drop(self.stop.take());
        self.thread.take().map(JoinHandle::join).into_iter().for_each(drop);
    }
}

/// Sends parameters to clients that subscribe to them, until it is stopped.
async fn serve(server: WebSocketServerHandle, parameters: &Parameters, mut stopped: oneshot::Receiver<()>) {
    let mut last = Vec::new();
    loop {
        tokio::select! {
            _ = &mut stopped => break,
            () = tokio::time::sleep(PARAMETER_PERIOD) => {}
        }
        let current = parameters.all();
        if current != last {
            server.publish_parameter_values(current.clone());
            last = current;
        }
    }
    // Connections that are left end with the runtime.
    let _ = tokio::time::timeout(STOP_TIMEOUT, server.stop().wait()).await;
}

//! The server: one thread, one socket.

use std::net::SocketAddr;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;

use foxglove::Context;
use nunet_ros2::{CameraOptions, Ros2Node, Topic, Topics};
use nunet_sink::sink::Sink;
use tokio::net::TcpListener;
use tokio::sync::oneshot;
use tokio::time::MissedTickBehavior;

use crate::FoxgloveConfig;
use crate::channels::{Channels, OUTPUT};
use crate::error::FoxgloveServerError;
use crate::kept::KeptMessages;
use crate::library::{Library, LibrarySetup};
use crate::parameters::Parameters;
use crate::relay::{self, Clients};
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
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let runtime = runtime.map_err(FoxgloveServerError::Thread)?;
        let cannot_listen = |source| FoxgloveServerError::Listen { address: config.address, source };
        let listener = {
            let _entered = runtime.enter();
            relay::listen(config.address).map_err(cannot_listen)?
        };
        let address = listener.local_addr().map_err(cannot_listen)?;
        let setup = LibrarySetup {
            context: Arc::clone(&context),
            kept: Arc::clone(&kept),
            parameters: Arc::clone(&parameters),
            backlog: Topic::RECORDED.len() * cameras.max(1),
        };
        let library = runtime.block_on(Library::start(setup));
        let library = library.map_err(|error| FoxgloveServerError::Library { reason: error.to_string() })?;
        let channels = Channels::new(context, kept, runtime.handle().clone());
        let (stop, stopped) = oneshot::channel();
        let serve = move || runtime.block_on(serve(listener, library, stopped));
        let thread = std::thread::Builder::new().name("foxglove server".to_owned()).spawn(serve);
        let thread = Some(thread.map_err(FoxgloveServerError::Thread)?);
        let node = Ros2Node::over(Arc::new(channels), OUTPUT, Topics::Recorded);
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

/// Accepts clients and keeps their parameters current, until it is stopped.
async fn serve(listener: TcpListener, mut library: Library, mut stopped: oneshot::Receiver<()>) {
    let mut clients = Clients::default();
    let mut period = tokio::time::interval(PARAMETER_PERIOD);
    period.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        tokio::select! {
            _ = &mut stopped => break,
            _ = period.tick() => library.publish_parameters(),
            accepted = listener.accept() => clients.admit(accepted, &mut library).await,
        }
    }
    drop(listener);
    let farewell = async {
        library.stop().await;
        clients.all_gone().await;
    };
    // Connections that are left end with the runtime.
    let _ = tokio::time::timeout(STOP_TIMEOUT, farewell).await;
}

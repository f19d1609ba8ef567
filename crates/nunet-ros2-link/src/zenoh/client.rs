//! A session in client mode.
//!
//! `zenoh::open` connects a peer in the background, but waits until a client is connected, or fails if it is
//! not. So the parts of `zenoh::open` are called here: the session is made, and its router is looked for on a
//! thread. The library itself connects the session again if it loses the router later.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, TryRecvError, channel};
use std::time::Duration;

use tracing::debug;
use zenoh::internal::runtime::{DynamicRuntime, Runtime, RuntimeBuilder, ZRuntime};
use zenoh::{Config, Session, Wait as _};

use super::config::{failed, reason_of};
use crate::error::Ros2Error;

/// The pause between two attempts doubles, as that of the library does.
const FIRST_PAUSE: Duration = Duration::from_secs(1);
const MAX_PAUSE: Duration = Duration::from_secs(4);
const OPEN: &str = "open a Zenoh session";

/// What connects a session in client mode.
pub(super) struct Client {
    runtime: Runtime,
    /// Its end ends the attempts.
    attempts: Sender<()>,
}

impl Client {
    /// Opens a session. It is connected once a router answers; what is declared before is announced then.
    pub(super) fn open(config: Config) -> Result<(Session, Self), Ros2Error> {
        let built = ZRuntime::Application.block_in_place(RuntimeBuilder::new(config).build());
        let runtime = built.map_err(failed(OPEN))?;
        let session = zenoh::session::init(DynamicRuntime::from(runtime.clone())).wait();
        let session = session.map_err(failed(OPEN))?;
        let (attempts, end) = channel();
        let connecting = runtime.clone();
        let started = std::thread::Builder::new().name("zenoh client".to_owned());
        started.spawn(move || connect(connecting, &end)).map_err(Ros2Error::Thread)?;
        Ok((session, Self { runtime, attempts }))
    }

    /// Closes the connection. The session must be closed before.
    pub(super) fn close(self) -> zenoh::Result<()> {
        drop(self.attempts);
        self.runtime.close().wait()
    }
}

/// Looks for a router until it is connected to one.
fn connect(mut runtime: Runtime, end: &Receiver<()>) {
    let mut pause = FIRST_PAUSE;
    while let Err(error) = ZRuntime::Application.block_in_place(runtime.start()) {
        debug!("no connection to a Zenoh router, next attempt in {pause:?}: {}", reason_of(&error));
        if end.recv_timeout(pause) != Err(RecvTimeoutError::Timeout) {
            return;
        }
        pause = (pause * 2).min(MAX_PAUSE);
    }
    if end.try_recv() == Err(TryRecvError::Disconnected)
        && let Err(error) = runtime.close().wait()
    {
        // It was closed while it connected.
        debug!("cannot close the connection to a Zenoh router: {error}");
    }
}

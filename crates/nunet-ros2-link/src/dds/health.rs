//! Whether the library works. Once its thread has ended or is stuck, its calls never return.

use std::future::Future;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::task::Poll;
use std::time::Duration;

use dust_dds::runtime::{DdsRuntime, Spawner};
use dust_dds::std_runtime::StdRuntime;
use dust_dds::std_runtime::executor::block_timeout;
use dust_dds::transport::interface::TransportDataReceiver;
use tracing::error;

use crate::error::Ros2Error;

/// The library takes 256 datagrams before it has to work on one. If it takes none for this time, it is stuck.
const MAX_WAIT: Duration = Duration::from_secs(20);

/// Whether the library works.
#[derive(Debug, Default)]
pub(super) struct LibraryState(AtomicBool);

impl LibraryState {
    /// Whether the library has ended. It cannot be started again.
    pub(super) fn has_ended(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// An error that names `action` if the library has ended, because its calls would not return.
    pub(super) fn check(&self, action: &'static str) -> Result<(), Ros2Error> {
        if self.has_ended() {
            let reason = "ROS 2 over DDS has ended".to_owned();
            return Err(Ros2Error::Middleware { action, reason });
        }
        Ok(())
    }

    pub(super) fn end(&self, why: &str) {
        if !self.0.swap(true, Ordering::Relaxed) {
            error!("ROS 2 over DDS has ended: {why}; restart nunetd to use it again");
        }
    }
}

/// The library's side of the transport.
#[derive(Clone)]
pub(super) struct Library {
    pub(super) receiver: TransportDataReceiver,
    pub(super) health: Arc<LibraryState>,
}

impl Library {
    /// Whether the library has ended.
    pub(super) fn has_ended(&self) -> bool {
        self.health.has_ended()
    }

    /// Hands a datagram to the library.
    pub(super) fn give(&self, datagram: Vec<u8>) {
        if !self.has_ended() && block_timeout(MAX_WAIT, self.receiver.receive_message(datagram)).is_err() {
            self.health.end("its thread is stuck");
        }
    }

    /// Hands over what arrives in the returned channel, on a thread.
    pub(super) fn start_answering(self) -> io::Result<Sender<Vec<u8>>> {
        let (sender, answers) = channel();
        let answering = move || answers.iter().for_each(|answer| self.give(answer));
        std::thread::Builder::new().name("dds answers".to_owned()).spawn(answering)?;
        Ok(sender)
    }
}

/// The library's runtime, which records a panic of the library.
pub(super) struct Watched {
    runtime: StdRuntime,
    health: Arc<LibraryState>,
}

impl Watched {
    pub(super) fn new(health: Arc<LibraryState>) -> Self {
        Self { runtime: StdRuntime::new(), health }
    }
}

impl DdsRuntime for Watched {
    type ClockHandle = <StdRuntime as DdsRuntime>::ClockHandle;
    type TimerHandle = <StdRuntime as DdsRuntime>::TimerHandle;
    type SpawnerHandle = WatchedSpawner;

    fn timer(&self) -> Self::TimerHandle {
        self.runtime.timer()
    }

    fn clock(&self) -> Self::ClockHandle {
        self.runtime.clock()
    }

    fn spawner(&self) -> WatchedSpawner {
        WatchedSpawner { spawner: self.runtime.spawner(), health: Arc::clone(&self.health) }
    }
}

/// Starts the library's tasks.
#[derive(Clone)]
pub(super) struct WatchedSpawner {
    spawner: <StdRuntime as DdsRuntime>::SpawnerHandle,
    health: Arc<LibraryState>,
}

impl Spawner for WatchedSpawner {
    type TaskHandle = <<StdRuntime as DdsRuntime>::SpawnerHandle as Spawner>::TaskHandle;

    fn spawn(&self, task: impl Future<Output = ()> + Send + 'static) -> Self::TaskHandle {
        let health = Arc::clone(&self.health);
        self.spawner.spawn(async move {
            let mut task = pin!(task);
            std::future::poll_fn(move |context| {
                let polled = catch_unwind(AssertUnwindSafe(|| task.as_mut().poll(context)));
                polled.unwrap_or_else(|_| {
                    health.end("the library failed");
                    Poll::Ready(())
                })
            })
            .await;
        })
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;

    const TIMEOUT: Duration = Duration::from_secs(60);

    #[test]
    fn a_panic_of_the_library_is_noticed_and_its_thread_goes_on() {
        let health = Arc::<LibraryState>::default();
        let runtime = Watched::new(Arc::clone(&health));
        let (done, finished) = channel();
        runtime.spawner().spawn(async { panic!("as the library may") });
        runtime.spawner().spawn(async move { done.send(()).unwrap_or_default() });
        finished.recv_timeout(TIMEOUT).expect("the second task runs");
        let start = Instant::now();
        while !health.has_ended() {
            assert!(start.elapsed() < TIMEOUT, "the panic is not noticed");
            std::thread::yield_now();
        }
        let error = health.check("list publishers").unwrap_err();
        assert_eq!(error.to_string(), "cannot list publishers: ROS 2 over DDS has ended");
    }
}

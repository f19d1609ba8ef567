//! A network with one subscriber, as its publishers see it.

use std::sync::mpsc::Receiver;
use std::sync::{Arc, Mutex};

use nunet_ros2_link::{Delivery, Endpoint, Link, MessagePublisher, MessageSubscriber, Ros2Error};

use super::{Backend, TIMEOUT};

/// The end of a topic's name that the subscriber subscribes to.
const SUBSCRIBED: &str = "/labels/image_raw";

/// Sends messages to a subscriber of labels, which takes, refuses or holds them.
pub(super) struct FakeNetwork {
    backend: Backend,
    released: Arc<Mutex<Receiver<()>>>,
}

impl FakeNetwork {
    /// A message hangs until the sender of `released` is dropped.
    pub(super) fn new(backend: Backend, released: Receiver<()>) -> Self {
        Self { backend, released: Arc::new(Mutex::new(released)) }
    }
}

impl Link for FakeNetwork {
    fn publisher(
        &self,
        _node: &str,
        endpoint: &Endpoint<'_>,
        _delivery: Delivery,
    ) -> Result<Box<dyn MessagePublisher>, Ros2Error> {
        let subscribers = usize::from(endpoint.topic.ends_with(SUBSCRIBED));
        Ok(Box::new(FakeTopic { subscribers, backend: self.backend, released: Arc::clone(&self.released) }))
    }

    fn subscriber(
        &self,
        _node: &str,
        _endpoint: &Endpoint<'_>,
    ) -> Result<Box<dyn MessageSubscriber>, Ros2Error> {
        Err(Ros2Error::Transport { name: "fake" })
    }

    fn published_types(&self, _topic: &str) -> Result<Vec<String>, Ros2Error> {
        Ok(Vec::new())
    }

    fn announce_nodes(&self) -> Result<(), Ros2Error> {
        Ok(())
    }
}

/// One topic.
struct FakeTopic {
    subscribers: usize,
    backend: Backend,
    released: Arc<Mutex<Receiver<()>>>,
}

impl MessagePublisher for FakeTopic {
    fn subscribers(&self) -> usize {
        self.subscribers
    }

    fn send(&self, _message: &[u8]) -> bool {
        if self.backend == Backend::Hanging {
            let _ = self.released.lock().unwrap().recv_timeout(TIMEOUT);
        }
        self.backend != Backend::Failing
    }
}

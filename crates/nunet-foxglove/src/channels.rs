//! Foxglove as a transport of `nunet-ros2`: a channel for each topic.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use foxglove::{ChannelBuilder, Context, RawChannel, Schema};
use nunet_mcap::ros::definition;
use nunet_ros2::OutputName;
use nunet_ros2_link::{Delivery, Endpoint, Link, MessagePublisher, MessageSubscriber, Ros2Error};
use tokio::runtime::Handle;

use crate::kept::KeptMessages;

/// The output.
pub(crate) const OUTPUT: OutputName = OutputName { text: "Foxglove", id: "foxglove" };

/// The channels of all cameras.
pub(crate) struct Channels {
    context: Arc<Context>,
    kept: Arc<KeptMessages>,
    publishers: AtomicU64,
    /// The server's thread.
    server: Handle,
}

impl Channels {
    pub(crate) fn new(context: Arc<Context>, kept: Arc<KeptMessages>, server: Handle) -> Self {
        Self { context, kept, publishers: AtomicU64::new(0), server }
    }

    /// Adds a channel, on the server's thread. The library announces a channel to clients before it knows it
    /// itself: on another thread, a client that subscribes at once would be refused.
    fn add(&self, channel: ChannelBuilder) -> Result<Arc<RawChannel>, String> {
        let (sender, added) = std::sync::mpsc::sync_channel(1);
        self.server.spawn(async move { sender.send(channel.build_raw()) });
        let channel = added.recv().map_err(|_| "the server has stopped".to_owned())?;
        channel.map_err(|error| error.to_string())
    }
}

impl Link for Channels {
    fn publisher(
        &self,
        _node: &str,
        endpoint: &Endpoint<'_>,
        delivery: Delivery,
    ) -> Result<Box<dyn MessagePublisher>, Ros2Error> {
        let name = endpoint.message_type.name();
        let failed = |reason: String| Ros2Error::Middleware { action: "add a channel", reason };
        let text = definition(name).ok_or_else(|| failed(format!("the definition of {name} is missing")))?;
        let schema = Schema::new(name, "ros2msg", text.as_bytes());
        let channel = ChannelBuilder::new(endpoint.topic).context(&self.context).message_encoding("cdr");
        // A channel of the same topic and type is shared: `/tf_static`, by all cameras.
        let channel = self.add(channel.schema(schema)).map_err(failed)?;
        let number = self.publishers.fetch_add(1, Ordering::Relaxed);
        let kept = delivery.is_kept.then(|| Arc::clone(&self.kept));
        Ok(Box::new(ChannelPublisher { channel, number, kept }))
    }

    fn subscriber(
        &self,
        _node: &str,
        _endpoint: &Endpoint<'_>,
    ) -> Result<Box<dyn MessageSubscriber>, Ros2Error> {
        Err(Ros2Error::Transport { name: OUTPUT.text })
    }

    fn published_types(&self, _topic: &str) -> Result<Vec<String>, Ros2Error> {
        Ok(Vec::new())
    }

    fn announce_nodes(&self) -> Result<(), Ros2Error> {
        Ok(())
    }
}

/// One topic.
struct ChannelPublisher {
    channel: Arc<RawChannel>,
    number: u64,
    kept: Option<Arc<KeptMessages>>,
}

impl MessagePublisher for ChannelPublisher {
    /// At least one, or none.
    fn subscribers(&self) -> usize {
        usize::from(self.channel.has_sinks())
    }

    /// The library queues the message for each client. If the queue of a client is full, its oldest message
    /// is dropped.
    fn send(&self, message: &[u8]) -> bool {
        if let Some(kept) = &self.kept {
            kept.put(&self.channel, self.number, message);
        }
        self.channel.log(message);
        true
    }
}

//! Messages for clients that subscribe later: Foxglove itself keeps none.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use foxglove::websocket::{ChannelView, Client, ServerListener};
use foxglove::{ChannelId, RawChannel};
use tracing::debug;

/// The messages of one channel: the last one of each publisher.
struct Kept {
    channel: Arc<RawChannel>,
    messages: Vec<(u64, Vec<u8>)>,
}

/// The last message of each publisher that keeps it. `/tf_static` has one publisher per camera.
#[derive(Default)]
pub(crate) struct KeptMessages(Mutex<HashMap<ChannelId, Kept>>);

impl KeptMessages {
    /// Replaces the message of a publisher.
    pub(crate) fn put(&self, channel: &Arc<RawChannel>, publisher: u64, message: &[u8]) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let new = || Kept { channel: Arc::clone(channel), messages: Vec::new() };
        let kept = all.entry(channel.id()).or_insert_with(new);
        kept.messages.retain(|(own, _)| *own != publisher);
        kept.messages.push((publisher, message.to_owned()));
    }
}

impl ServerListener for KeptMessages {
    fn on_subscribe(&self, client: Client, channel: ChannelView<'_>) {
        let all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(Kept { channel, messages }) = all.get(&channel.id()) {
            messages.iter().for_each(|(_, message)| channel.log_to_sink(message, client.sink_id()));
        }
    }

    fn on_client_connect(&self) {
        debug!("a Foxglove client has connected");
    }

    fn on_client_disconnect(&self) {
        debug!("a Foxglove client has disconnected");
    }
}

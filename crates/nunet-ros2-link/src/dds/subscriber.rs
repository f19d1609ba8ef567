//! A subscriber: `dust_dds` finds and matches its publishers, and the transport gives it their messages.

use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::{Duration, Instant};

use dust_dds::subscription::data_reader::DataReader;
use dust_dds::subscription::subscriber::Subscriber as DdsSubscriber;

use super::failed::failed;
use super::health::LibraryState;
use super::inbox::Inbox;
use super::peers::Peers;
use super::raw_message::RawMessage;
use super::user_data::{Guid, pieces};
use crate::error::Ros2Error;
use crate::link::{Arrival, MessageSubscriber};

/// The inboxes of all subscribers of a participant.
#[derive(Debug, Default)]
pub(super) struct Inboxes(Mutex<Vec<Weak<Inbox>>>);

impl Inboxes {
    /// Makes an inbox that gets messages as long as it is used.
    pub(super) fn add(&self) -> Arc<Inbox> {
        let inbox = Arc::new(Inbox::default());
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        all.retain(|other| other.strong_count() > 0);
        all.push(Arc::downgrade(&inbox));
        inbox
    }

    /// Hands the messages in a datagram to the subscribers that they are for.
    pub(super) fn put(&self, datagram: &[u8]) {
        let all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        for inbox in all.iter().filter_map(Weak::upgrade) {
            pieces(datagram).for_each(|piece| inbox.put(&piece));
        }
    }
}

/// A subscriber of one topic.
pub(super) struct TopicSubscriber {
    pub(super) subscriber: DdsSubscriber,
    pub(super) reader: DataReader<RawMessage>,
    pub(super) inbox: Arc<Inbox>,
    pub(super) peers: Arc<Peers>,
    pub(super) health: Arc<LibraryState>,
    /// Called when it ends.
    pub(super) on_end: Box<dyn Fn() + Send>,
}

impl MessageSubscriber for TopicSubscriber {
    /// Without those that are lost: the library counts them for minutes.
    fn update(&mut self) -> Result<usize, Ros2Error> {
        const ACTION: &str = "list publishers";
        self.health.check(ACTION)?;
        let (matched, now) =
            (self.reader.get_matched_publications().map_err(failed(ACTION))?, Instant::now());
        let is_there = |writer: &Guid| {
            writer.first_chunk().is_some_and(|participant| !self.peers.is_lost(*participant, now))
        };
        let writers: Vec<Guid> = matched.into_iter().map(Into::into).filter(is_there).collect();
        self.inbox.set_writers(&writers);
        Ok(writers.len())
    }

    fn take(&mut self, message: &mut Vec<u8>, timeout: Duration) -> Arrival {
        self.inbox.take(message, timeout)
    }
}

impl Drop for TopicSubscriber {
    fn drop(&mut self) {
        if !self.health.has_ended() {
            // The connection may have ended before it.
            let _ = self.subscriber.delete_datareader(&self.reader);
        }
        (self.on_end)();
    }
}

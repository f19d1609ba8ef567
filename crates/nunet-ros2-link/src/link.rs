//! What every transport does: it makes publishers, which take encoded messages, and subscribers, which give
//! them.

use std::time::Duration;

use crate::error::Ros2Error;
use crate::message_type::MessageType;

/// A connection to other nodes. It ends when its last user drops it.
pub trait Link: Send + Sync {
    /// Makes a publisher that belongs to `node`.
    ///
    /// # Errors
    /// The middleware refuses it.
    fn publisher(
        &self,
        node: &str,
        endpoint: &Endpoint<'_>,
        delivery: Delivery,
    ) -> Result<Box<dyn MessagePublisher>, Ros2Error>;

    /// Makes a subscriber that belongs to `node`. It asks for best effort and no history, which every
    /// publisher offers.
    ///
    /// # Errors
    /// The middleware refuses it.
    fn subscriber(
        &self,
        node: &str,
        endpoint: &Endpoint<'_>,
    ) -> Result<Box<dyn MessageSubscriber>, Ros2Error>;

    /// The types that other nodes publish on `topic`, such as `sensor_msgs/msg/Image`. Those of publishers
    /// that were killed without announcing it stay for a while.
    ///
    /// # Errors
    /// The middleware failed.
    fn published_types(&self, topic: &str) -> Result<Vec<String>, Ros2Error>;

    /// Lets other nodes know which node has which publishers and subscribers. Called once all of a node
    /// exist.
    ///
    /// # Errors
    /// The middleware failed.
    fn announce_nodes(&self) -> Result<(), Ros2Error>;

    /// Why messages may not arrive at other nodes, such as an absent router; `None` if everything works.
    /// Called about once per second.
    fn problem(&self) -> Option<String> {
        None
    }

    /// Messages that [`MessagePublisher::send`] took, but that were dropped on their way to a subscriber,
    /// since the last call by any user of the connection. Called about once per second.
    fn take_dropped(&self) -> u64 {
        0
    }
}

/// A topic with its type.
#[derive(Debug, Clone, Copy)]
pub struct Endpoint<'a> {
    /// The full name, such as `/front/scan`.
    pub topic: &'a str,
    /// The type of its messages.
    pub message_type: MessageType,
}

/// How messages of a topic are delivered. All are reliable; subscribers that ask for less get less.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Delivery {
    /// Messages that are kept until all subscribers have confirmed them.
    pub depth: u32,
    /// Whether a late subscriber gets the last message (transient local).
    pub is_kept: bool,
}

/// Sends the messages of one topic. It never waits for subscribers.
pub trait MessagePublisher: Send {
    /// How many subscribers there are.
    fn subscribers(&self) -> usize;

    /// Sends a message, CDR with its four leading bytes. Returns false if a subscriber has no room for it.
    fn send(&self, message: &[u8]) -> bool;
}

/// Receives the messages of one topic. It keeps the newest few.
pub trait MessageSubscriber: Send {
    /// Connects to publishers that appeared since the last call, and returns how many there are. Messages of
    /// a publisher are received from then on.
    ///
    /// # Errors
    /// The middleware failed.
    fn update(&mut self) -> Result<usize, Ros2Error>;

    /// The next message, waiting up to `timeout` for one. Its bytes are swapped with `message`, whose memory
    /// is reused.
    fn take(&mut self, message: &mut Vec<u8>, timeout: Duration) -> Arrival;
}

/// What a subscriber has received.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arrival {
    /// A message.
    Message(Received),
    /// A message that has more bytes than are received.
    TooLarge {
        /// Its bytes.
        bytes: u32,
        /// The most bytes that are received.
        limit: u32,
    },
    /// Nothing yet.
    Nothing,
}

/// What is known of a received message beside its bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Received {
    /// When its last part arrived, nanoseconds since 1970.
    pub unix_nanos: i64,
    /// Messages of this publisher before it that did not arrive completely.
    pub lost: u64,
    /// Complete messages before it that were replaced by newer ones.
    pub replaced: u64,
}

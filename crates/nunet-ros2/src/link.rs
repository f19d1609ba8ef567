//! What every transport does: it makes publishers, and those take encoded messages.

use crate::error::Ros2Error;
use crate::topic::Topic;

/// A connection to other nodes.
pub(crate) trait Link: Send + Sync {
    /// Makes a publisher of `topic` that belongs to the node of `camera`.
    fn publisher(&self, camera: &str, topic: Topic) -> Result<Box<dyn Publisher>, Ros2Error>;

    /// Lets other nodes know which node has which publishers. Called once all of a camera exist.
    fn announce_node(&self, camera: &str) -> Result<(), Ros2Error>;
}

/// Sends the messages of one topic. It never waits for subscribers.
pub(crate) trait Publisher: Send {
    /// How many subscribers there are.
    fn subscribers(&self) -> usize;

    /// Sends a message, CDR with its four leading bytes. Returns false if a subscriber has no room for it.
    fn send(&self, message: &[u8]) -> bool;
}

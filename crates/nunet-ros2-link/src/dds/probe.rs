//! What a connection does with datagrams, without a network.

use std::time::Duration;

use super::guard::{is_acceptable, submessages_read};
use super::inbox::Inbox;
use super::user_data::{is_only_user_data, pieces};
use crate::link::Arrival;
use crate::queue::MAX_MESSAGE_BYTES;

/// Takes datagrams as a connection does: for tests with damaged ones.
#[derive(Debug, Default)]
pub struct DatagramProbe(Inbox);

impl DatagramProbe {
    /// Takes a datagram, whose writers all count as matched. Returns the message that it completes.
    ///
    /// # Panics
    /// A message is larger than the limit, or the library reads more submessages than there can be.
    pub fn put(&self, datagram: &[u8]) -> Option<Vec<u8>> {
        if !is_acceptable(datagram) {
            return None;
        }
        let writers: Vec<_> = pieces(datagram).map(|piece| piece.writer).collect();
        self.0.set_writers(&writers);
        pieces(datagram).for_each(|piece| self.0.put(&piece));
        if !is_only_user_data(datagram) {
            let read = submessages_read(datagram).unwrap_or_default();
            assert!(read <= datagram.len() / 4, "{read} submessages in {} bytes", datagram.len());
        }
        let mut message = Vec::new();
        let taken = self.0.take(&mut message, Duration::ZERO);
        assert!(message.len() <= MAX_MESSAGE_BYTES as usize, "{} bytes", message.len());
        matches!(taken, Arrival::Message(_)).then_some(message)
    }
}

//! Received messages that wait to be taken: the newest few, in buffers that are reused.

use std::collections::VecDeque;
use std::time::SystemTime;

use crate::link::{Arrival, Received};

/// A larger message is refused. An image of 3840x2160 pixels with 16 bits in four channels has 66 MB.
pub(crate) const MAX_MESSAGE_BYTES: u32 = 128 << 20;
/// Messages that wait to be taken. A reader that comes a few periods late gets all of them, and can count
/// those that it does not use.
const MAX_WAITING: usize = 4;
/// A publisher whose numbers skip more starts again: nobody loses that many messages, and sums stay within
/// their type.
const MAX_LOST: u64 = u32::MAX as u64;
/// Buffers that are kept for reuse.
const MAX_SPARE: usize = 2;

/// The messages of a topic that wait.
#[derive(Debug, Default)]
pub(crate) struct MessageQueue {
    waiting: VecDeque<(Vec<u8>, Received)>,
    /// Since the last message that was taken.
    replaced: u64,
    /// Lost before those that were replaced.
    lost: u64,
    /// Bytes of a message that was refused.
    refused: Option<u32>,
    spare: Vec<Vec<u8>>,
}

impl MessageQueue {
    /// Whether there is nothing to take.
    pub(crate) fn is_empty(&self) -> bool {
        self.waiting.is_empty() && self.refused.is_none()
    }

    /// A buffer for the next message. It may contain bytes of an earlier one.
    pub(crate) fn buffer(&mut self) -> Vec<u8> {
        self.spare.pop().unwrap_or_default()
    }

    /// Adds a message, which arrives now. `lost` messages of its publisher before it did not arrive.
    pub(crate) fn put(&mut self, bytes: Vec<u8>, lost: u64) {
        let since_1970 = SystemTime::UNIX_EPOCH.elapsed().unwrap_or_default();
        let unix_nanos = i64::try_from(since_1970.as_nanos()).unwrap_or(i64::MAX);
        let lost = if lost > MAX_LOST { 0 } else { lost };
        self.waiting.push_back((bytes, Received { unix_nanos, lost, replaced: 0 }));
        if self.waiting.len() > MAX_WAITING
            && let Some((replaced, received)) = self.waiting.pop_front()
        {
            self.replaced += 1;
            self.lost += received.lost;
            self.give_back(replaced);
        }
    }

    /// Reports a message that has more than [`MAX_MESSAGE_BYTES`].
    pub(crate) fn refuse(&mut self, bytes: u32) {
        self.refused = Some(bytes);
    }

    /// The next message, swapped with `message`, whose memory is reused.
    pub(crate) fn take(&mut self, message: &mut Vec<u8>) -> Arrival {
        if let Some(bytes) = self.refused.take() {
            return Arrival::TooLarge { bytes, limit: MAX_MESSAGE_BYTES };
        }
        let Some((bytes, received)) = self.waiting.pop_front() else { return Arrival::Nothing };
        let used = std::mem::replace(message, bytes);
        self.give_back(used);
        let (lost, replaced) = (std::mem::take(&mut self.lost), std::mem::take(&mut self.replaced));
        Arrival::Message(Received { lost: received.lost + lost, replaced, ..received })
    }

    fn give_back(&mut self, used: Vec<u8>) {
        if self.spare.len() < MAX_SPARE {
            self.spare.push(used);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gap_that_nobody_can_lose_counts_as_nothing_lost() {
        let mut queue = MessageQueue::default();
        for (gap, expected) in [(3, 3), (MAX_LOST, MAX_LOST), (MAX_LOST + 1, 0), (u64::MAX, 0)] {
            queue.put(Vec::new(), gap);
            let taken = queue.take(&mut Vec::new());
            assert!(
                matches!(taken, Arrival::Message(Received { lost, .. }) if lost == expected),
                "{taken:?}"
            );
        }
    }
}

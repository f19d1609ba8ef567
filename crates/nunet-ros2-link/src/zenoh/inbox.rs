//! The messages that have arrived for a subscriber.

use std::collections::HashMap;
use std::io::Read as _;
use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

use zenoh::bytes::ZBytes;
use zenoh::sample::Sample;

use super::attachment::{self, Gid, Origin};
use crate::link::Arrival;
use crate::queue::{MAX_MESSAGE_BYTES, MessageQueue};

/// Of further publishers of a topic, lost messages are not counted.
const MAX_PUBLISHERS: usize = 8;

/// The messages that have arrived.
#[derive(Default)]
pub(super) struct SampleInbox {
    contents: Mutex<Contents>,
    arrived: Condvar,
}

#[derive(Default)]
struct Contents {
    /// The number of the last message of each publisher.
    last: HashMap<Gid, i64>,
    queue: MessageQueue,
}

impl SampleInbox {
    /// Takes a message. Called by Zenoh's thread, which must not wait.
    pub(super) fn put(&self, sample: &Sample) {
        let origin = sample.attachment().and_then(|bytes| attachment::read(&bytes.to_bytes()));
        self.contents.lock().unwrap_or_else(PoisonError::into_inner).put(sample.payload(), origin);
        self.arrived.notify_one();
    }

    /// The next message, in `message`, whose memory is reused.
    pub(super) fn take(&self, message: &mut Vec<u8>, timeout: Duration) -> Arrival {
        let contents = self.contents.lock().unwrap_or_else(PoisonError::into_inner);
        let is_empty = |contents: &mut Contents| contents.queue.is_empty();
        let waited = self.arrived.wait_timeout_while(contents, timeout, is_empty);
        let (mut contents, _) = waited.unwrap_or_else(PoisonError::into_inner);
        contents.queue.take(message)
    }
}

impl Contents {
    fn put(&mut self, payload: &ZBytes, origin: Option<Origin>) {
        let lost = origin.map_or(0, |origin| self.lost_before(origin));
        let size = u32::try_from(payload.len()).unwrap_or(u32::MAX);
        if size > MAX_MESSAGE_BYTES {
            self.queue.refuse(size);
            return;
        }
        let mut bytes = self.queue.buffer();
        bytes.clear();
        // Reading from memory does not fail.
        let _ = payload.reader().read_to_end(&mut bytes);
        self.queue.put(bytes, lost);
    }

    /// Messages between this one and the last one of the same publisher.
    fn lost_before(&mut self, Origin { sequence, publisher }: Origin) -> u64 {
        if !self.last.contains_key(&publisher) && self.last.len() >= MAX_PUBLISHERS {
            return 0;
        }
        let last = self.last.insert(publisher, sequence);
        let between = |last: i64| u64::try_from(sequence.checked_sub(last)?.checked_sub(1)?).ok();
        last.and_then(between).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::Received;

    fn origin(sequence: i64, publisher: u8) -> Option<Origin> {
        Some(Origin { sequence, publisher: [publisher; 16] })
    }

    fn take(contents: &mut Contents) -> Option<(Vec<u8>, u64)> {
        let mut message = vec![9; 9];
        match contents.queue.take(&mut message) {
            Arrival::Message(Received { lost, .. }) => Some((message, lost)),
            _ => None,
        }
    }

    #[test]
    fn losses_are_counted_for_each_publisher() {
        let mut contents = Contents::default();
        for (sequence, publisher, lost) in [(5, 1, 0), (6, 1, 0), (9, 2, 0), (9, 1, 2), (12, 2, 2), (1, 1, 0)]
        {
            contents.put(&ZBytes::from(vec![publisher]), origin(sequence, publisher));
            assert_eq!(take(&mut contents), Some((vec![publisher], lost)), "{sequence} of {publisher}");
        }
        contents.put(&ZBytes::from(vec![3]), None);
        assert_eq!(take(&mut contents), Some((vec![3], 0)), "a message without an attachment");
    }

    #[test]
    fn numbers_at_the_end_of_their_range_and_many_publishers_do_no_harm() {
        let mut contents = Contents::default();
        for sequence in [i64::MIN, i64::MAX, i64::MIN, 0, i64::MIN, -1, i64::MAX] {
            contents.put(&ZBytes::from(vec![1]), origin(sequence, 1));
            assert!(take(&mut contents).is_some());
        }
        for publisher in 0..40 {
            contents.put(&ZBytes::from(vec![1]), origin(1, publisher));
        }
        assert_eq!(contents.last.len(), MAX_PUBLISHERS);
    }
}

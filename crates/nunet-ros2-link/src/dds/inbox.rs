//! What arrives for a subscriber: fragments are put together, and the newest messages are kept.
//!
//! `dust_dds` would keep messages until they are read and decode them by their type. Here a message is copied
//! once, a newer one replaces the oldest of a few, and memory is bounded: one message in the making for each
//! writer.

use std::collections::HashMap;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::user_data::{Fragments, Guid, Piece};
use crate::link::Arrival;
use crate::queue::{MAX_MESSAGE_BYTES, MessageQueue};

/// Further writers of a topic are ignored.
pub(super) const MAX_WRITERS: usize = 8;

/// The messages of a topic.
#[derive(Debug, Default)]
pub(super) struct Inbox {
    state: Mutex<Contents>,
    arrived: Condvar,
}

#[derive(Debug, Default)]
struct Contents {
    writers: HashMap<Guid, Writer>,
    queue: MessageQueue,
}

/// What is known of a writer.
#[derive(Debug, Default)]
struct Writer {
    /// The last message that arrived completely or was refused.
    last: Option<i64>,
    partial: Option<Partial>,
}

/// A message of which some fragments are missing.
#[derive(Debug)]
struct Partial {
    sequence: i64,
    fragment_bytes: u16,
    size: usize,
    /// At least as long as the message: memory is not cleared before it is reused.
    bytes: Vec<u8>,
    /// For each fragment, whether it has arrived.
    has: Vec<bool>,
    missing: usize,
}

impl Inbox {
    /// Messages of other writers are ignored from now on.
    pub(super) fn set_writers(&self, matched: &[Guid]) {
        let mut state = self.lock();
        state.writers.retain(|writer, _| matched.contains(writer));
        for &writer in matched {
            if state.writers.len() < MAX_WRITERS {
                state.writers.entry(writer).or_default();
            }
        }
    }

    /// Takes what has arrived, if it is for this subscriber.
    pub(super) fn put(&self, piece: &Piece<'_>) {
        let mut state = self.lock();
        let Contents { writers, queue } = &mut *state;
        let Some(writer) = writers.get_mut(&piece.writer) else { return };
        if writer.last.is_some_and(|last| piece.sequence <= last) {
            return; // it came by another way already
        }
        if piece.size() > MAX_MESSAGE_BYTES {
            writer.last = Some(piece.sequence);
            queue.refuse(piece.size());
            self.arrived.notify_one();
            return;
        }
        let complete = match piece.fragments {
            None => {
                let mut bytes = queue.buffer();
                bytes.clear();
                bytes.extend_from_slice(piece.bytes);
                Some(bytes)
            }
            Some(fragments) => writer.put_fragments(piece, fragments, queue),
        };
        if let Some(bytes) = complete {
            let last = writer.last.replace(piece.sequence);
            let lost = last.map_or(0, |last| (piece.sequence - last - 1).unsigned_abs());
            queue.put(bytes, lost);
            self.arrived.notify_one();
        }
    }

    /// The next message, in `message`, whose memory is reused.
    pub(super) fn take(&self, message: &mut Vec<u8>, timeout: Duration) -> Arrival {
        let is_empty = |contents: &mut Contents| contents.queue.is_empty();
        let waited = self.arrived.wait_timeout_while(self.lock(), timeout, is_empty);
        let (mut contents, _) = waited.unwrap_or_else(PoisonError::into_inner);
        contents.queue.take(message)
    }

    fn lock(&self) -> MutexGuard<'_, Contents> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Piece<'_> {
    /// Bytes of the whole message.
    pub(super) fn size(&self) -> u32 {
        let whole = || u32::try_from(self.bytes.len()).unwrap_or(u32::MAX);
        self.fragments.map_or_else(whole, |fragments| fragments.message_bytes)
    }
}

impl Writer {
    /// Copies fragments. Returns the message once it is complete.
    ///
    /// A newer message ends an incomplete one: over best effort, its missing fragments are lost.
    fn put_fragments(
        &mut self,
        piece: &Piece<'_>,
        fragments: Fragments,
        queue: &mut MessageQueue,
    ) -> Option<Vec<u8>> {
        let Fragments { first, fragment_bytes, message_bytes } = fragments;
        if fragment_bytes == 0 || message_bytes == 0 {
            return None;
        }
        let mut partial = match self.partial.take() {
            Some(older) if older.sequence < piece.sequence => {
                Partial::new(piece.sequence, fragments, older.bytes)
            }
            Some(own) => own,
            None => Partial::new(piece.sequence, fragments, queue.buffer()),
        };
        let fits = partial.sequence == piece.sequence
            && partial.fragment_bytes == fragment_bytes
            && partial.size == message_bytes as usize;
        if fits {
            partial.copy(first as usize, piece.bytes);
        }
        if partial.missing == 0 {
            partial.bytes.truncate(partial.size);
            return Some(partial.bytes);
        }
        self.partial = Some(partial);
        None
    }
}

impl Partial {
    fn new(sequence: i64, fragments: Fragments, mut bytes: Vec<u8>) -> Self {
        let Fragments { fragment_bytes, message_bytes, .. } = fragments;
        let size = message_bytes as usize;
        if bytes.capacity() < size {
            bytes = vec![0; size]; // the system's own zeros: nothing is written for fragments that never come
        } else if bytes.len() < size {
            bytes.resize(size, 0);
        }
        let count = size.div_ceil(usize::from(fragment_bytes));
        Self { sequence, fragment_bytes, size, bytes, has: vec![false; count], missing: count }
    }

    /// Copies complete fragments, each once.
    fn copy(&mut self, first: usize, bytes: &[u8]) {
        let size = usize::from(self.fragment_bytes);
        for (number, fragment) in (first..).zip(bytes.chunks(size)) {
            let Some(has) = self.has.get_mut(number).filter(|has| !**has) else { continue };
            let start = number * size;
            let expected = size.min(self.size - start);
            // A datagram may be padded behind the last fragment.
            let (Some(fragment), Some(place)) =
                (fragment.get(..expected), self.bytes.get_mut(start..start + expected))
            else {
                continue;
            };
            place.copy_from_slice(fragment);
            *has = true;
            self.missing -= 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::user_data::pieces;
    use super::super::user_data::tests::{WRITER, fragment, whole};
    use super::*;
    use crate::link::Received;

    fn inbox() -> Inbox {
        let inbox = Inbox::default();
        inbox.set_writers(&[WRITER]);
        inbox
    }

    fn put(inbox: &Inbox, datagram: &[u8]) {
        pieces(datagram).for_each(|piece| inbox.put(&piece));
    }

    fn take(inbox: &Inbox) -> Option<(Vec<u8>, u64, u64)> {
        let mut message = Vec::new();
        match inbox.take(&mut message, Duration::ZERO) {
            Arrival::Message(Received { lost, replaced, .. }) => Some((message, lost, replaced)),
            _ => None,
        }
    }

    #[test]
    fn fragments_in_any_order_and_twice_make_one_message() {
        let inbox = inbox();
        for (first, bytes) in [(3, &[9, 10][..]), (1, &[1, 2, 3, 4]), (3, &[9, 10]), (1, &[1, 2, 3, 4])] {
            put(&inbox, &fragment(1, first, (4, 10), bytes));
            assert_eq!(take(&inbox), None);
        }
        put(&inbox, &fragment(1, 2, (4, 10), &[5, 6, 7, 8]));
        assert_eq!(take(&inbox), Some(((1..=10).collect(), 0, 0)));
        put(&inbox, &fragment(1, 1, (16, 10), &[0; 10]));
        assert_eq!(take(&inbox), None, "it came already");
        put(&inbox, &fragment(2, 1, (4, 6), &[1, 2, 3, 4, 5, 6]));
        assert_eq!(take(&inbox), Some(((1..=6).collect(), 0, 0)), "two fragments in one submessage");
    }

    #[test]
    fn losses_are_counted() {
        let inbox = inbox();
        put(&inbox, &whole(2, &[2]));
        put(&inbox, &fragment(3, 1, (4, 8), &[3; 4]));
        put(&inbox, &whole(5, &[5]));
        put(&inbox, &fragment(3, 2, (4, 8), &[3; 4]));
        assert_eq!(take(&inbox), Some((vec![2], 0, 0)), "nothing is known of messages before the first");
        assert_eq!(take(&inbox), Some((vec![5], 2, 0)), "3 is incomplete, 4 never came");
        put(&inbox, &whole(6, &[6]));
        assert_eq!(take(&inbox), Some((vec![6], 0, 0)));
    }

    #[test]
    fn a_newer_message_replaces_the_oldest_of_a_few() {
        let inbox = inbox();
        for sequence in [1, 3, 4, 5, 6, 8] {
            put(&inbox, &whole(sequence, &[sequence as u8]));
        }
        assert_eq!(take(&inbox), Some((vec![4], 1, 2)), "1 and 3 were replaced, 2 never came");
        for expected in [(vec![5], 0, 0), (vec![6], 0, 0), (vec![8], 1, 0)] {
            assert_eq!(take(&inbox), Some(expected));
        }
        assert_eq!(take(&inbox), None);
    }

    #[test]
    fn only_matched_writers_are_heard() {
        let inbox = inbox();
        inbox.set_writers(&[[1; 16]]);
        put(&inbox, &whole(1, &[1]));
        assert_eq!(take(&inbox), None);
        let many: Vec<Guid> = (0..40).map(|number| [number; 16]).collect();
        inbox.set_writers(&many);
        assert_eq!(inbox.lock().writers.len(), MAX_WRITERS);
    }

    #[test]
    fn a_message_that_is_too_large_is_refused_once_and_takes_no_memory() {
        let inbox = inbox();
        let mut message = Vec::new();
        for first in [1, 2] {
            put(&inbox, &fragment(1, first, (60_000, u32::MAX), &[0; 60_000]));
        }
        let refused = inbox.take(&mut message, Duration::ZERO);
        assert_eq!(refused, Arrival::TooLarge { bytes: u32::MAX, limit: MAX_MESSAGE_BYTES });
        assert_eq!(inbox.take(&mut message, Duration::ZERO), Arrival::Nothing);
        assert!(inbox.lock().writers[&WRITER].partial.is_none());
    }

    #[test]
    fn memory_of_messages_is_reused() {
        let inbox = inbox();
        let mut message = Vec::new();
        let mut places = Vec::new();
        for sequence in 1..7 {
            put(&inbox, &fragment(sequence, 1, (8, 8), &[7; 8]));
            assert!(matches!(inbox.take(&mut message, Duration::ZERO), Arrival::Message(_)));
            places.push(message.as_ptr());
        }
        places.sort();
        places.dedup();
        assert!(places.len() <= 3, "{places:?}");
    }
}

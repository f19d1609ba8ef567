//! The mailbox between the source and the inference thread. It holds one frame.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crate::frame::Frame;
use crate::notify::Notify;

/// An item whose memory is reused.
pub trait Reuse {
    /// Releases borrowed memory before the buffer is kept for reuse.
    fn release(&mut self);
}

impl Reuse for Frame {
    fn release(&mut self) {
        Self::release(self);
    }
}

/// A mailbox with room for one item, and a pool of used items that can be filled again.
///
/// A longer queue would only add latency, because a robot needs the newest frame. The sender decides whether
/// the older one is replaced ([`Mailbox::put_latest`]) or the sender waits ([`Mailbox::put_waiting`]). Used
/// items return to the sender, so that a steady stream allocates nothing.
#[derive(Debug)]
pub struct Mailbox<T> {
    state: Mutex<MailboxState<T>>,
    changed: Condvar,
    notify: Arc<Notify>,
}

#[derive(Debug)]
struct MailboxState<T> {
    waiting: Option<T>,
    used: Vec<T>,
    closed: bool,
}

/// The outcome of putting an item into the mailbox.
#[derive(Debug, PartialEq, Eq)]
pub enum Put {
    /// It waits for the receiver.
    Accepted,
    /// It waits for the receiver; an older one was replaced and returned to the pool.
    Replaced,
    /// The mailbox is closed, or the sender gave up.
    Refused,
}

/// The outcome of [`Mailbox::take`].
#[derive(Debug, PartialEq, Eq)]
pub enum Taken<T> {
    /// An item.
    Item(T),
    /// None arrived in time.
    Nothing,
    /// The mailbox is closed and empty.
    Closed,
}

/// How many used items are kept: one being filled, one waiting, one being processed.
const POOL_SIZE: usize = 3;
/// How often a waiting sender checks whether it must stop.
const POLL_PERIOD: Duration = Duration::from_millis(50);

impl<T: Reuse> Default for Mailbox<T> {
    fn default() -> Self {
        Self::with_notify(Arc::default())
    }
}

impl<T: Reuse> Mailbox<T> {
    /// Creates one of several mailboxes of a receiver that waits for `notify`, which is notified of every
    /// change.
    pub fn with_notify(notify: Arc<Notify>) -> Self {
        let state = MailboxState { waiting: None, used: Vec::with_capacity(POOL_SIZE), closed: false };
        Self { state: Mutex::new(state), changed: Condvar::new(), notify }
    }

    /// Puts `item` in at once; an older one that still waits is replaced.
    pub fn put_latest(&self, item: T) -> Put {
        let mut state = self.lock();
        if state.closed {
            return Put::Refused;
        }
        let replaced = state.waiting.replace(item);
        let put = if replaced.is_some() { Put::Replaced } else { Put::Accepted };
        state.recycle(replaced);
        drop(state);
        self.notify_all();
        put
    }

    /// Waits until there is room, then puts `item` in. It is refused as well if `given_up` returns true,
    /// which is called while there is no room.
    pub fn put_waiting(&self, item: T, given_up: impl Fn() -> bool) -> Put {
        let mut state = self.lock();
        while state.waiting.is_some() && !state.closed {
            if given_up() {
                return Put::Refused;
            }
            let waited = self.changed.wait_timeout(state, POLL_PERIOD);
            (state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        }
        if state.closed {
            return Put::Refused;
        }
        state.waiting = Some(item);
        drop(state);
        self.notify_all();
        Put::Accepted
    }

    /// Waits at most `timeout` for an item.
    pub fn take(&self, timeout: Duration) -> Taken<T> {
        let empty = |state: &mut MailboxState<T>| state.waiting.is_none() && !state.closed;
        let waited = self.changed.wait_timeout_while(self.lock(), timeout, empty);
        let (mut state, _) = waited.unwrap_or_else(PoisonError::into_inner);
        match state.waiting.take() {
            Some(item) => {
                self.changed.notify_all();
                Taken::Item(item)
            }
            None if state.closed => Taken::Closed,
            None => Taken::Nothing,
        }
    }

    /// Takes the waiting item back; returns whether there was one.
    pub fn recall(&self) -> bool {
        let mut state = self.lock();
        let waiting = state.waiting.take();
        let recalled = waiting.is_some();
        state.recycle(waiting);
        recalled
    }

    /// Waits at most `timeout` until the mailbox is closed; returns whether it is.
    pub fn wait_closed(&self, timeout: Duration) -> bool {
        let open = |state: &mut MailboxState<T>| !state.closed;
        let waited = self.changed.wait_timeout_while(self.lock(), timeout, open);
        waited.unwrap_or_else(PoisonError::into_inner).0.closed
    }

    /// Returns a used item to the pool.
    pub fn give_back(&self, item: T) {
        self.lock().recycle(Some(item));
    }

    /// A used item, if the pool has one.
    pub fn used(&self) -> Option<T> {
        self.lock().used.pop()
    }

    /// Refuses further items; the receiver can still take the waiting one.
    pub fn close(&self) {
        self.lock().closed = true;
        self.notify_all();
    }

    /// Closes and drops the waiting item; returns whether there was one.
    pub fn close_and_empty(&self) -> bool {
        self.close();
        self.recall()
    }

    fn notify_all(&self) {
        self.changed.notify_all();
        self.notify.notify();
    }

    fn lock(&self) -> MutexGuard<'_, MailboxState<T>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T: Reuse> MailboxState<T> {
    fn recycle(&mut self, item: Option<T>) {
        if self.used.len() < POOL_SIZE {
            self.used.extend(item.map(|mut item| {
                item.release();
                item
            }));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LONG: Duration = Duration::from_secs(60);

    impl Reuse for i32 {
        fn release(&mut self) {}
    }

    #[test]
    fn the_latest_item_wins_and_the_older_returns_to_the_pool() {
        let mailbox = Mailbox::default();
        assert_eq!(mailbox.put_latest(1), Put::Accepted);
        assert_eq!(mailbox.put_latest(2), Put::Replaced);
        assert_eq!(mailbox.take(LONG), Taken::Item(2));
        assert_eq!(mailbox.used(), Some(1));
        assert_eq!(mailbox.used(), None);
    }

    #[test]
    fn a_waiting_sender_loses_nothing() {
        let mailbox = Mailbox::default();
        let mut received = Vec::new();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                for item in 0..100 {
                    assert_eq!(mailbox.put_waiting(item, || false), Put::Accepted);
                }
                mailbox.close();
            });
            while let Taken::Item(item) = mailbox.take(LONG) {
                received.push(item);
            }
        });
        assert_eq!(received, (0..100).collect::<Vec<_>>());
    }

    #[test]
    fn closing_releases_a_waiting_sender_and_a_waiting_receiver() {
        let mailbox = Mailbox::default();
        mailbox.put_latest(1);
        std::thread::scope(|scope| {
            let sender = scope.spawn(|| mailbox.put_waiting(2, || false));
            assert!(mailbox.close_and_empty());
            assert_eq!(sender.join().unwrap(), Put::Refused);
            assert_eq!(scope.spawn(|| mailbox.take(LONG)).join().unwrap(), Taken::Closed);
        });
        assert_eq!(mailbox.put_latest(3), Put::Refused);
    }

    #[test]
    fn a_sender_that_stops_waiting_keeps_the_waiting_item_in_place() {
        let mailbox = Mailbox::default();
        assert_eq!(mailbox.put_waiting(1, || true), Put::Accepted, "there is room");
        let asked = std::cell::Cell::new(0);
        let third_time = || asked.replace(asked.get() + 1) == 2;
        assert_eq!(mailbox.put_waiting(2, third_time), Put::Refused);
        assert_eq!(mailbox.take(Duration::ZERO), Taken::Item(1));
    }

    #[test]
    fn a_receive_ends_after_its_timeout_and_a_recalled_item_is_gone() {
        let mailbox = Mailbox::default();
        assert_eq!(mailbox.take(Duration::ZERO), Taken::Nothing);
        mailbox.put_latest(1);
        assert!(mailbox.recall());
        assert!(!mailbox.recall());
        assert_eq!(mailbox.take(Duration::ZERO), Taken::Nothing);
    }

    #[test]
    fn a_receiver_of_several_mailboxes_is_notified_of_each_change() {
        let notify = Arc::new(Notify::default());
        let mailboxes: Vec<Mailbox<i32>> =
            (0..2).map(|_| Mailbox::with_notify(Arc::clone(&notify))).collect();
        let mut received = Vec::new();
        std::thread::scope(|scope| {
            for (number, mailbox) in (0..).zip(&mailboxes) {
                scope.spawn(move || {
                    for item in 0..50 {
                        mailbox.put_waiting(100 * number + item, || false);
                    }
                    mailbox.close();
                });
            }
            loop {
                let taken: Vec<_> = mailboxes.iter().map(|mailbox| mailbox.take(Duration::ZERO)).collect();
                if taken.iter().all(|taken| *taken == Taken::Closed) {
                    break;
                }
                // An item may be followed by a close that was notified already, so wait only if there was
                // nothing.
                let before = received.len();
                received.extend(taken.into_iter().filter_map(|taken| match taken {
                    Taken::Item(item) => Some(item),
                    Taken::Nothing | Taken::Closed => None,
                }));
                if received.len() == before {
                    notify.wait(LONG);
                }
            }
        });
        received.sort_unstable();
        assert_eq!(received, (0..50).chain(100..150).collect::<Vec<_>>());
    }

    #[test]
    fn the_pool_is_bounded() {
        let mailbox = Mailbox::default();
        for item in 0..10 {
            mailbox.give_back(item);
        }
        assert_eq!(std::iter::from_fn(|| mailbox.used()).count(), POOL_SIZE);
    }
}

//! Wakes one thread for several events: the inference thread sleeps here while all mailboxes are empty.

use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

/// A notification that arrives before a wait ends that wait at once.
#[derive(Debug, Default)]
pub struct Notify {
    is_notified: Mutex<bool>,
    changed: Condvar,
}

impl Notify {
    /// Wakes the waiting thread.
    pub fn notify(&self) {
        *self.is_notified.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.changed.notify_all();
    }

    /// Waits at most `timeout` for a notification since the last call.
    pub fn wait(&self, timeout: Duration) {
        let is_notified = self.is_notified.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self.changed.wait_timeout_while(is_notified, timeout, |is_notified| !*is_notified);
        *waited.unwrap_or_else(PoisonError::into_inner).0 = false;
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;

    const LONG: Duration = Duration::from_secs(60);

    #[test]
    fn notifications_before_the_wait_end_one_wait() {
        let (notify, start) = (Notify::default(), Instant::now());
        notify.notify();
        notify.notify();
        notify.wait(LONG);
        assert!(start.elapsed() < LONG);
        let again = Instant::now();
        notify.wait(Duration::from_millis(20));
        assert!(again.elapsed() >= Duration::from_millis(20), "the second notification ended a second wait");
    }

    #[test]
    fn a_notification_wakes_a_waiting_thread() {
        let (notify, start) = (Notify::default(), Instant::now());
        std::thread::scope(|scope| {
            scope.spawn(|| notify.wait(LONG));
            notify.notify();
        });
        assert!(start.elapsed() < LONG);
    }
}

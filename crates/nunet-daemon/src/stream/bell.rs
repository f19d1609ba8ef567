//! One waits for many: whoever looks into several mailboxes sleeps here until something has come into one of them.

use std::sync::{Condvar, Mutex, PoisonError};
use std::time::Duration;

/// A ring that is not heard at once is heard by the next who waits.
#[derive(Debug, Default)]
pub struct Bell {
    rung: Mutex<bool>,
    changed: Condvar,
}

impl Bell {
    /// Wakes who waits.
    pub fn ring(&self) {
        *self.rung.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.changed.notify_all();
    }

    /// Waits for a ring since the last call, `patience` long at the most.
    pub fn wait(&self, patience: Duration) {
        let rung = self.rung.lock().unwrap_or_else(PoisonError::into_inner);
        let waited = self.changed.wait_timeout_while(rung, patience, |rung| !*rung);
        *waited.unwrap_or_else(PoisonError::into_inner).0 = false;
    }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;

    const LONG: Duration = Duration::from_secs(60);

    #[test]
    fn a_ring_before_the_wait_is_heard_once() {
        let (bell, start) = (Bell::default(), Instant::now());
        bell.ring();
        bell.ring();
        bell.wait(LONG);
        assert!(start.elapsed() < LONG);
        let again = Instant::now();
        bell.wait(Duration::from_millis(20));
        assert!(again.elapsed() >= Duration::from_millis(20), "both rings were heard at once");
    }

    #[test]
    fn a_ring_wakes_who_waits() {
        let (bell, start) = (Bell::default(), Instant::now());
        std::thread::scope(|scope| {
            scope.spawn(|| bell.wait(LONG));
            bell.ring();
        });
        assert!(start.elapsed() < LONG);
    }
}

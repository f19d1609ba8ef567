//! When a lost camera is tried again, and what the user is told of it.

use std::time::Duration;

/// How soon a lost camera is tried again at first ...
const FIRST_WAIT: Duration = Duration::from_millis(200);
/// ... and at last: soon enough for who plugs it in again, seldom enough to cost nothing.
const LONGEST_WAIT: Duration = Duration::from_secs(5);

/// Whether the camera gives images. Good ones alone make it healthy: one that opens and stays silent is not back.
#[derive(Debug)]
pub(super) struct Health {
    wait: Duration,
    due_nanos: i64,
    told: Option<String>,
}

impl Default for Health {
    fn default() -> Self {
        Self { wait: FIRST_WAIT, due_nanos: 0, told: None }
    }
}

impl Health {
    /// Something is wrong now: the next try comes later than the last one did. Returns whether the user is to be told,
    /// which is once for each reason, however often it comes again.
    pub(super) fn fails(&mut self, why: &str, now_nanos: i64) -> bool {
        self.due_nanos = now_nanos.saturating_add(self.wait.as_nanos() as i64);
        self.wait = (self.wait * 2).min(LONGEST_WAIT);
        let news = self.told.as_deref() != Some(why);
        self.told = Some(why.to_owned());
        news
    }

    /// Whether no good image has come since something was wrong.
    pub(super) fn is_bad(&self) -> bool {
        self.told.is_some()
    }

    /// How long until the next try.
    pub(super) fn wait(&self, now_nanos: i64) -> Duration {
        Duration::from_nanos(self.due_nanos.saturating_sub(now_nanos).max(0).unsigned_abs())
    }

    /// A good image came. Returns whether that is news.
    pub(super) fn recovers(&mut self) -> bool {
        self.wait = FIRST_WAIT;
        self.told.take().is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: i64 = 1_000_000_000;

    #[test]
    fn waits_double_up_to_a_bound_and_begin_anew_after_a_good_picture() {
        let mut health = Health::default();
        let mut waits = Vec::new();
        for now in 0..8 {
            health.fails("gone", now * 100 * SECOND);
            waits.push(health.wait(now * 100 * SECOND).as_millis());
        }
        assert_eq!(waits, [200, 400, 800, 1600, 3200, 5000, 5000, 5000]);
        assert_eq!(health.wait(800 * SECOND), Duration::ZERO, "long due");
        health.recovers();
        health.fails("gone", 0);
        assert_eq!(health.wait(0), Duration::from_millis(200));
    }

    #[test]
    fn each_change_is_news_once() {
        let mut health = Health::default();
        assert!(!health.recovers(), "it was never lost");
        assert!(health.fails("gone", 0) && health.is_bad());
        assert!(!health.fails("gone", 1));
        assert!(health.fails("busy", 2));
        assert!(health.recovers() && !health.is_bad());
        assert!(!health.recovers());
        assert!(health.fails("busy", 3));
    }
}

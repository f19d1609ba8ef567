//! When a lost camera or program is tried again, and when that is reported.

use std::time::Duration;

/// The wait before the first retry. Each further wait is twice as long.
const FIRST_WAIT: Duration = Duration::from_millis(200);
/// The longest wait: short enough for a user who plugs the camera in again, long enough to use hardly any CPU
/// time.
const LONGEST_WAIT: Duration = Duration::from_secs(5);

/// Whether images arrive. Only a good image makes a source healthy again: that it could be opened is not
/// enough.
#[derive(Debug)]
pub(crate) struct Health {
    wait: Duration,
    due_nanos: i64,
    reported: Option<String>,
}

impl Default for Health {
    fn default() -> Self {
        Self { wait: FIRST_WAIT, due_nanos: 0, reported: None }
    }
}

impl Health {
    /// Records a failure and schedules the next retry. Returns whether to report it: once per reason, not per
    /// failure.
    pub(crate) fn fails(&mut self, why: &str, now_nanos: i64) -> bool {
        self.due_nanos = now_nanos.saturating_add(self.wait.as_nanos() as i64);
        self.wait = (self.wait * 2).min(LONGEST_WAIT);
        let is_new = self.reported.as_deref() != Some(why);
        self.reported = Some(why.to_owned());
        is_new
    }

    /// Whether no good image has arrived since the last failure.
    pub(crate) fn is_bad(&self) -> bool {
        self.reported.is_some()
    }

    /// The time until the next try.
    pub(crate) fn wait(&self, now_nanos: i64) -> Duration {
        Duration::from_nanos(self.due_nanos.saturating_sub(now_nanos).max(0).unsigned_abs())
    }

    /// Records a good image. Returns whether it ends a failure.
    pub(crate) fn recovers(&mut self) -> bool {
        self.wait = FIRST_WAIT;
        self.reported.take().is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: i64 = 1_000_000_000;

    #[test]
    fn waits_double_up_to_a_limit_and_are_reset_by_a_good_image() {
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

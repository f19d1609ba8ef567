//! When a lost camera or program is tried again, and when that is reported.

use std::time::Duration;

/// The wait before the first retry. Each further wait is twice as long.
const FIRST_WAIT: Duration = Duration::from_millis(200);
/// The longest wait: short enough for a user who plugs the camera in again, long enough to use hardly any CPU
/// time. If images arrive for longer than this, the next failure is a new one.
const LONGEST_WAIT: Duration = Duration::from_secs(5);

/// Whether images arrive. Only a good image makes a source healthy again: that it could be opened is not
/// enough. A source that is lost after one image each time is one that keeps failing.
#[derive(Debug)]
pub(crate) struct Health {
    wait: Duration,
    due_nanos: i64,
    is_bad: bool,
    /// The reason that was reported last, until images arrive for long.
    reported: Option<String>,
    /// Whether the last report was a failure, and not its end.
    is_reported_bad: bool,
    /// The first good image after the last failure.
    good_since_nanos: Option<i64>,
}

impl Default for Health {
    fn default() -> Self {
        Self {
            wait: FIRST_WAIT,
            due_nanos: 0,
            is_bad: false,
            reported: None,
            is_reported_bad: false,
            good_since_nanos: None,
        }
    }
}

impl Health {
    /// Records a failure and schedules the next retry. Returns whether to report it: once per reason, not per
    /// failure. A failure that was reported as over is reported again only if a retry fails too.
    pub(crate) fn fails(&mut self, why: &str, now_nanos: i64) -> bool {
        self.due_nanos = now_nanos.saturating_add(self.wait.as_nanos() as i64);
        self.wait = (self.wait * 2).min(LONGEST_WAIT);
        let is_new = self.reported.as_deref() != Some(why) || (self.is_bad && !self.is_reported_bad);
        if is_new {
            self.reported = Some(why.to_owned());
            self.is_reported_bad = true;
        }
        self.is_bad = true;
        self.good_since_nanos = None;
        is_new
    }

    /// Whether no good image has arrived since the last failure.
    pub(crate) fn is_bad(&self) -> bool {
        self.is_bad
    }

    /// The time until the next try.
    pub(crate) fn wait(&self, now_nanos: i64) -> Duration {
        Duration::from_nanos(self.due_nanos.saturating_sub(now_nanos).max(0).unsigned_abs())
    }

    /// Records a good image. Returns whether it ends a failure that was reported.
    pub(crate) fn recovers(&mut self, now_nanos: i64) -> bool {
        let since_nanos = *self.good_since_nanos.get_or_insert(now_nanos);
        if now_nanos.saturating_sub(since_nanos) > LONGEST_WAIT.as_nanos() as i64 {
            self.wait = FIRST_WAIT;
            self.reported = None;
        }
        self.is_bad = false;
        std::mem::take(&mut self.is_reported_bad)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: i64 = 1_000_000_000;

    #[test]
    fn waits_double_up_to_a_limit_and_are_reset_after_images_for_longer_than_it() {
        let mut health = Health::default();
        let mut waits = Vec::new();
        for now in 0..8 {
            health.fails("gone", now * 100 * SECOND);
            waits.push(health.wait(now * 100 * SECOND).as_millis());
        }
        assert_eq!(waits, [200, 400, 800, 1600, 3200, 5000, 5000, 5000]);
        assert_eq!(health.wait(800 * SECOND), Duration::ZERO, "long due");
        health.recovers(0);
        health.recovers(5 * SECOND);
        health.fails("gone", 0);
        assert_eq!(health.wait(0), Duration::from_secs(5), "5 s are not longer");
        health.recovers(0);
        health.recovers(5 * SECOND + 1);
        health.fails("gone", 0);
        assert_eq!(health.wait(0), Duration::from_millis(200));
    }

    #[test]
    fn a_source_that_gives_one_image_each_time_waits_ever_longer_and_is_reported_once() {
        let mut health = Health::default();
        let (mut now_nanos, mut waits, mut news) = (0, Vec::new(), Vec::new());
        for _ in 0..8 {
            let is_back = health.recovers(now_nanos);
            assert!(!health.is_bad());
            let is_lost = health.fails("it ended", now_nanos + 1);
            assert!(health.is_bad());
            news.push((is_back, is_lost));
            let wait = health.wait(now_nanos + 1);
            now_nanos += 1 + wait.as_nanos() as i64;
            waits.push(wait.as_millis());
        }
        assert_eq!(waits, [200, 400, 800, 1600, 3200, 5000, 5000, 5000]);
        assert_eq!(news[..2], [(false, true), (true, false)]);
        assert!(news[2..].iter().all(|news| *news == (false, false)), "{news:?}");
        assert!(health.fails("it ended", now_nanos), "its end is the last report, and it has no image now");
    }

    #[test]
    fn each_change_is_news_once() {
        let mut health = Health::default();
        assert!(!health.recovers(0), "it was never lost");
        assert!(health.fails("gone", 0) && health.is_bad());
        assert!(!health.fails("gone", 1));
        assert!(health.fails("busy", 2));
        assert!(health.recovers(3) && !health.is_bad());
        assert!(!health.recovers(4 + 5 * SECOND));
        assert!(health.fails("busy", 5 + 5 * SECOND));
    }
}

//! Notices that something stopped making progress.

use std::time::{Duration, Instant};

/// Follows a counter that grows while progress is made.
#[derive(Debug, Clone)]
pub struct StallDetector {
    progress: u64,
    since: Instant,
    has_warned: bool,
}

impl StallDetector {
    /// Counts from `now`.
    #[must_use]
    pub fn new(now: Instant) -> Self {
        Self { progress: 0, since: now, has_warned: false }
    }

    /// For how long the counter stayed at `progress`. Time in which no progress is expected does not count.
    pub fn stalled_for(&mut self, progress: u64, is_expected: bool, now: Instant) -> Duration {
        if progress != self.progress || !is_expected {
            *self = Self { progress, since: now, has_warned: false };
        }
        now.duration_since(self.since)
    }

    /// The same, once per stall, as soon as it lasts for `limit`.
    pub fn warning(
        &mut self,
        progress: u64,
        is_expected: bool,
        limit: Duration,
        now: Instant,
    ) -> Option<Duration> {
        let stalled = self.stalled_for(progress, is_expected, now);
        let is_news = !self.has_warned && stalled >= limit;
        self.has_warned |= is_news;
        is_news.then_some(stalled)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stall_is_reported_once_and_again_after_progress() {
        let start = Instant::now();
        let (at, limit) = (|seconds| start + Duration::from_secs(seconds), Duration::from_secs(5));
        let mut detector = StallDetector::new(start);
        assert_eq!(detector.warning(0, false, limit, at(100)), None, "no progress is expected");
        assert_eq!(detector.warning(0, true, limit, at(104)), None);
        assert_eq!(detector.warning(0, true, limit, at(106)), Some(Duration::from_secs(6)));
        assert_eq!(detector.warning(0, true, limit, at(120)), None, "it was reported");
        assert_eq!(detector.warning(1, true, limit, at(121)), None, "there is progress");
        assert_eq!(detector.warning(1, true, limit, at(127)), Some(Duration::from_secs(6)));
    }

    #[test]
    fn time_without_progress_is_counted_from_the_last_change() {
        let start = Instant::now();
        let mut detector = StallDetector::new(start);
        assert_eq!(detector.stalled_for(0, true, start + Duration::from_secs(3)), Duration::from_secs(3));
        assert_eq!(detector.stalled_for(7, true, start + Duration::from_secs(4)), Duration::ZERO);
        assert_eq!(detector.stalled_for(7, true, start + Duration::from_secs(9)), Duration::from_secs(5));
    }
}

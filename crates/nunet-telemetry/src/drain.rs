//! How long a shutdown waits for pending writes: a disk that hangs must not keep the process.

use std::time::{Duration, Instant};

use tracing::warn;

use crate::stall::StallDetector;

/// The time for all pending writes together after a stop. A service manager kills the process after 10 s
/// (`TimeoutStopSec` in the unit), and the current frame and the stats need a part of them.
const AFTER_STOP: Duration = Duration::from_secs(5);
/// Without a stop, a slow disk may take any time, unless it makes no progress for this long.
const STALLED: Duration = Duration::from_secs(60);
/// A write that begins after the time is over still gets this much: a working disk needs no more.
const MINIMUM: Duration = Duration::from_millis(250);
/// After this long without progress, a warning names what is pending.
const WARN_AFTER: Duration = Duration::from_secs(5);
/// How often progress is checked.
const POLL_PERIOD: Duration = Duration::from_millis(10);

/// The time that is left for pending writes.
pub struct DrainTimeout<'a> {
    stopped: &'a dyn Fn() -> bool,
    after_stop: Duration,
    stalled: Duration,
    stop_seen: Option<Instant>,
}

/// Why the wait ended early.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum GivenUp {
    /// A stop was requested, and the time after it is over.
    #[error("timed out {} s after shutdown was requested", .0.as_secs_f64())]
    Stopped(Duration),
    /// There was no progress for so long.
    #[error("made no progress for {} s", .0.as_secs_f64())]
    Stalled(Duration),
}

/// The kind of an error of this crate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum TelemetryErrorKind {
    /// The time after a requested stop is over.
    Stopped,
    /// A write made no progress.
    Stalled,
}

impl GivenUp {
    /// Its kind, without the time.
    #[must_use]
    pub fn kind(&self) -> TelemetryErrorKind {
        match self {
            Self::Stopped(_) => TelemetryErrorKind::Stopped,
            Self::Stalled(_) => TelemetryErrorKind::Stalled,
        }
    }
}

impl<'a> DrainTimeout<'a> {
    /// `stopped` returns whether a stop was requested; it may come during a wait.
    #[must_use]
    pub fn new(stopped: &'a dyn Fn() -> bool) -> Self {
        Self::with(stopped, AFTER_STOP, STALLED)
    }

    /// Other times than the default ones, for tests.
    #[must_use]
    pub fn with(stopped: &'a dyn Fn() -> bool, after_stop: Duration, stalled: Duration) -> Self {
        Self { stopped, after_stop, stalled, stop_seen: None }
    }

    /// Waits until `what` is `finished`; `progress` changes while it makes progress.
    ///
    /// # Errors
    /// The time is over.
    pub fn wait(
        &mut self,
        what: &str,
        finished: impl Fn() -> bool,
        progress: impl Fn() -> u64,
    ) -> Result<(), GivenUp> {
        let start = Instant::now();
        let mut detector = StallDetector::new(start);
        while !finished() {
            let now = Instant::now();
            if (self.stopped)() {
                let stop_seen = *self.stop_seen.get_or_insert(now);
                if now.duration_since(stop_seen) >= self.after_stop && now.duration_since(start) >= MINIMUM {
                    return Err(GivenUp::Stopped(self.after_stop));
                }
            }
            if detector.stalled_for(progress(), true, now) >= self.stalled {
                return Err(GivenUp::Stalled(self.stalled));
            }
            if let Some(stalled) = detector.warning(progress(), true, WARN_AFTER, now) {
                warn!("waiting for {what}: no progress for {} s", stalled.as_secs());
            }
            std::thread::sleep(POLL_PERIOD);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use super::*;

    const LONG: Duration = Duration::from_secs(60);
    const SHORT: Duration = Duration::from_millis(20);

    #[test]
    fn a_late_but_finished_write_is_accepted() {
        let mut timeout = DrainTimeout::with(&|| true, Duration::ZERO, Duration::ZERO);
        assert_eq!(timeout.wait("a file", || true, || 0), Ok(()));
    }

    #[test]
    fn the_kind_says_whether_a_stop_ended_the_wait() {
        assert_eq!(GivenUp::Stopped(SHORT).kind(), TelemetryErrorKind::Stopped);
        assert_eq!(GivenUp::Stalled(SHORT).kind(), TelemetryErrorKind::Stalled);
    }

    #[test]
    fn the_drain_timeout_bounds_all_waits_together() {
        let mut timeout = DrainTimeout::with(&|| true, SHORT, LONG);
        for _ in 0..2 {
            let start = Instant::now();
            assert_eq!(timeout.wait("a file", || false, || 0), Err(GivenUp::Stopped(SHORT)));
            assert!(start.elapsed() >= MINIMUM);
        }
        let start = Instant::now();
        assert_eq!(timeout.wait("a file", || start.elapsed() >= SHORT, || 0), Ok(()), "it was quick enough");
    }

    #[test]
    fn without_a_stop_a_slow_disk_has_time_while_it_makes_progress() {
        let mut timeout = DrainTimeout::with(&|| false, Duration::ZERO, 20 * POLL_PERIOD);
        let polls = Cell::new(0);
        let poll = || polls.replace(polls.get() + 1);
        assert_eq!(timeout.wait("a file", || polls.get() >= 30, poll), Ok(()), "longer than a stall");
        assert_eq!(timeout.wait("a file", || false, || 0), Err(GivenUp::Stalled(20 * POLL_PERIOD)));
    }

    #[test]
    fn a_stop_during_a_wait_is_seen() {
        let asked = Cell::new(0);
        let stopped = || asked.replace(asked.get() + 1) >= 3;
        let mut timeout = DrainTimeout::with(&stopped, SHORT, LONG);
        assert_eq!(timeout.wait("a file", || false, || 0), Err(GivenUp::Stopped(SHORT)));
    }
}

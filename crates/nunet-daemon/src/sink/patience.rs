//! How long the end of a run waits for what is on its way to a disk: a disk that hangs must not hold the process.

use std::time::{Duration, Instant};

use tracing::warn;

/// All waiting together, after a stop. A service manager kills after ten seconds (`TimeoutStopSec` in the unit), and the
/// frame in work and the figures take some of them.
const AFTER_STOP: Duration = Duration::from_secs(5);
/// Where nobody has asked for a stop, a slow disk has its time; one that does nothing for so long is gone.
const STANDSTILL: Duration = Duration::from_secs(60);
/// What begins when the time is over gets so much all the same: a disk that works needs no more.
const LEAST: Duration = Duration::from_millis(250);
/// After so long the user is told what is waited for.
const SILENCE: Duration = Duration::from_secs(5);
/// How often it is looked.
const GLANCE: Duration = Duration::from_millis(10);

/// The time that is left for everything that is still being written.
pub(crate) struct Patience<'a> {
    stopped: &'a dyn Fn() -> bool,
    after_stop: Duration,
    standstill: Duration,
    stop_seen: Option<Instant>,
}

/// Why it was not waited any longer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub(crate) enum GivenUp {
    #[error("timed out {} s after shutdown was requested", .0.as_secs_f64())]
    Stopped(Duration),
    #[error("made no progress for {} s", .0.as_secs_f64())]
    Still(Duration),
}

impl<'a> Patience<'a> {
    /// `stopped` says whether a stop was requested, which may come while it is waited.
    pub(crate) fn new(stopped: &'a dyn Fn() -> bool) -> Self {
        Self::with(stopped, AFTER_STOP, STANDSTILL)
    }

    /// Other times than the usual ones, for tests.
    pub(crate) fn with(stopped: &'a dyn Fn() -> bool, after_stop: Duration, standstill: Duration) -> Self {
        Self { stopped, after_stop, standstill, stop_seen: None }
    }

    /// Waits until `what` is `finished`; `moved` changes while something is done for it.
    pub(crate) fn wait(
        &mut self,
        what: &str,
        finished: impl Fn() -> bool,
        moved: impl Fn() -> u64,
    ) -> Result<(), GivenUp> {
        let start = Instant::now();
        let (mut seen, mut since, mut told) = (moved(), start, false);
        while !finished() {
            let now = Instant::now();
            let moved = moved();
            if moved != seen {
                (seen, since) = (moved, now);
            }
            if (self.stopped)() {
                let stop_seen = *self.stop_seen.get_or_insert(now);
                if now.duration_since(stop_seen) >= self.after_stop && now.duration_since(start) >= LEAST {
                    return Err(GivenUp::Stopped(self.after_stop));
                }
            }
            let still = now.duration_since(since);
            if still >= self.standstill {
                return Err(GivenUp::Still(self.standstill));
            }
            if still >= SILENCE && !told {
                told = true;
                warn!("waiting for {what}: nothing has moved for {} s", still.as_secs());
            }
            std::thread::sleep(GLANCE);
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
    fn what_is_finished_is_not_waited_for_however_late_it_is() {
        let mut patience = Patience::with(&|| true, Duration::ZERO, Duration::ZERO);
        assert_eq!(patience.wait("a file", || true, || 0), Ok(()));
    }

    #[test]
    fn a_stop_bounds_the_waiting_for_everything_together_and_leaves_the_last_one_a_moment() {
        let mut patience = Patience::with(&|| true, SHORT, LONG);
        for _ in 0..2 {
            let start = Instant::now();
            assert_eq!(patience.wait("a file", || false, || 0), Err(GivenUp::Stopped(SHORT)));
            assert!(start.elapsed() >= LEAST);
        }
        let start = Instant::now();
        assert_eq!(patience.wait("a file", || start.elapsed() >= SHORT, || 0), Ok(()), "it was quick enough");
    }

    #[test]
    fn without_a_stop_a_slow_disk_is_waited_for_as_long_as_it_moves() {
        let mut patience = Patience::with(&|| false, Duration::ZERO, 20 * GLANCE);
        let looks = Cell::new(0);
        let look = || looks.replace(looks.get() + 1);
        assert_eq!(patience.wait("a file", || looks.get() >= 30, look), Ok(()), "longer than a standstill");
        assert_eq!(patience.wait("a file", || false, || 0), Err(GivenUp::Still(20 * GLANCE)));
    }

    #[test]
    fn a_stop_that_comes_while_it_is_waited_is_seen() {
        let asked = Cell::new(0);
        let stopped = || asked.replace(asked.get() + 1) >= 3;
        let mut patience = Patience::with(&stopped, SHORT, LONG);
        assert_eq!(patience.wait("a file", || false, || 0), Err(GivenUp::Stopped(SHORT)));
    }
}

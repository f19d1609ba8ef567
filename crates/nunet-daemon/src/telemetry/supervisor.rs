//! What a service manager hears: ready, alive, stopping (systemd's notification protocol; silent without one).

use std::time::{Duration, Instant};

use sd_notify::NotifyState;
use tracing::debug;

/// The service manager of this process, if it has one.
#[derive(Debug)]
pub(crate) struct Supervisor {
    /// How often it wants to hear of us; `None` where it does not.
    period: Option<Duration>,
    fed: Option<Instant>,
    /// How many frames had been captured when nothing was to do, and since when it is as many.
    quiet: Option<(u64, Instant)>,
}

/// So many times in a period is it told, so that one late frame is not the end.
const TIMES_A_PERIOD: u32 = 4;

impl Supervisor {
    pub(crate) fn from_environment() -> Self {
        Self::new(sd_notify::watchdog_enabled())
    }

    fn new(watchdog: Option<Duration>) -> Self {
        Self { period: watchdog.map(|period| period / TIMES_A_PERIOD), fed: None, quiet: None }
    }

    /// The model has passed its test, and memory is reserved: frames may come.
    pub(crate) fn ready(&self, status: &str) {
        tell(&[NotifyState::Ready, NotifyState::Status(status)]);
    }

    /// A frame went out, which feeds the watchdog: a process that only breathes is to be restarted.
    pub(crate) fn frame_done(&mut self) {
        if self.is_due(Instant::now()) {
            tell(&[NotifyState::Watchdog]);
        }
    }

    /// There is nothing to do. `waiting` where every source says of itself that it waits for what gives it frames: that
    /// feeds the watchdog too, since a restart would plug no camera in. `captured` counts the frames of all: while they come
    /// and none goes out, nobody is fed. Returns whether it was.
    pub(crate) fn nothing_to_do(&mut self, waiting: bool, captured: u64) -> bool {
        let fed = self.waits_well(waiting, captured, Instant::now());
        if fed {
            tell(&[NotifyState::Watchdog]);
        }
        fed
    }

    fn waits_well(&mut self, waiting: bool, captured: u64, now: Instant) -> bool {
        let Some(period) = self.period else { return false };
        let since = self.quiet.filter(|(seen, _)| *seen == captured).map_or(now, |(_, since)| since);
        self.quiet = Some((captured, since));
        waiting && now.duration_since(since) >= period && self.is_due(now)
    }

    /// The stream has ended.
    pub(crate) fn stopping() {
        tell(&[NotifyState::Stopping]);
    }

    fn is_due(&mut self, now: Instant) -> bool {
        let Some(period) = self.period else { return false };
        let due = self.fed.is_none_or(|fed| now.duration_since(fed) >= period);
        if due {
            self.fed = Some(now);
        }
        due
    }
}

/// A service manager that does not listen is none of the stream's business.
fn tell(states: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(states) {
        debug!("the service manager is not told {states:?}: {error}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOOK: Duration = Duration::from_millis(100);

    #[test]
    fn the_watchdog_is_fed_a_few_times_a_period_and_not_with_every_frame() {
        let mut supervisor = Supervisor::new(Some(Duration::from_secs(8)));
        let start = Instant::now();
        let fed: Vec<u64> =
            (0..100).filter(|&frame| supervisor.is_due(start + Duration::from_millis(100 * frame))).collect();
        assert_eq!(fed, [0, 20, 40, 60, 80]);
    }

    #[test]
    fn sources_that_wait_feed_the_watchdog_as_often_as_frames_do() {
        let mut supervisor = Supervisor::new(Some(Duration::from_secs(8)));
        let start = Instant::now();
        let fed: Vec<u32> =
            (0..100).filter(|&look| supervisor.waits_well(true, 7, start + LOOK * look)).collect();
        assert_eq!(fed, [20, 40, 60, 80]);
        assert!(!supervisor.waits_well(false, 7, start + 200 * LOOK), "nobody says that it waits");
    }

    #[test]
    fn sources_that_say_that_they_wait_while_frames_come_do_not_feed_the_watchdog() {
        let mut supervisor = Supervisor::new(Some(Duration::from_secs(8)));
        let start = Instant::now();
        // A damaged picture each 1.5 s, from a camera that is not well again before a good one.
        let fed = (0..100).any(|look| supervisor.waits_well(true, u64::from(look) / 15, start + LOOK * look));
        assert!(!fed);
        let fed = (100..200).find(|look| supervisor.waits_well(true, 6, start + LOOK * *look));
        assert_eq!(fed, Some(110), "it has been quiet since look 90");
    }

    #[test]
    fn without_a_watchdog_nobody_is_told() {
        assert!(!Supervisor::new(None).is_due(Instant::now()));
        assert!(!Supervisor::new(None).waits_well(true, 0, Instant::now()));
    }
}

//! Notifies a service manager: ready, alive, stopping (systemd's protocol; silent without a service manager).

use std::time::{Duration, Instant};

use sd_notify::NotifyState;
use tracing::debug;

use crate::stall::StallDetector;

/// The service manager of this process, if it has one.
#[derive(Debug)]
pub struct Supervisor {
    /// How often its watchdog is notified; `None` without a watchdog.
    period: Option<Duration>,
    fed: Option<Instant>,
    /// Frames captured while idle.
    captured: StallDetector,
}

/// Notifications per watchdog period, so that one late frame does not end the process.
const TIMES_A_PERIOD: u32 = 4;

impl Supervisor {
    /// As systemd describes it in `NOTIFY_SOCKET` and `WATCHDOG_USEC`.
    #[must_use]
    pub fn from_environment() -> Self {
        Self::new(sd_notify::watchdog_enabled())
    }

    fn new(watchdog: Option<Duration>) -> Self {
        Self {
            period: watchdog.map(|period| period / TIMES_A_PERIOD),
            fed: None,
            captured: StallDetector::new(Instant::now()),
        }
    }

    /// The model passed its self-test, and memory is reserved.
    pub fn ready(&self, status: &str) {
        notify(&[NotifyState::Ready, NotifyState::Status(status)]);
    }

    /// A frame was published, which feeds the watchdog. A process that publishes nothing is restarted.
    pub fn frame_done(&mut self) {
        if self.is_due(Instant::now()) {
            notify(&[NotifyState::Watchdog]);
        }
    }

    /// No camera has a frame. If all sources report that they wait (`waiting`), the watchdog is fed as well,
    /// because a restart would not bring a camera back. `captured` counts the frames of all cameras: while it
    /// grows and no frame is published, the watchdog is not fed. Returns whether it was.
    pub fn idle(&mut self, waiting: bool, captured: u64) -> bool {
        let fed = self.is_waiting(waiting, captured, Instant::now());
        if fed {
            notify(&[NotifyState::Watchdog]);
        }
        fed
    }

    fn is_waiting(&mut self, waiting: bool, captured: u64, now: Instant) -> bool {
        let Some(period) = self.period else { return false };
        let quiet = self.captured.stalled_for(captured, true, now);
        waiting && quiet >= period && self.is_due(now)
    }

    /// The stream has ended.
    pub fn stopping() {
        notify(&[NotifyState::Stopping]);
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

/// A failed notification does not affect the stream.
fn notify(states: &[NotifyState<'_>]) {
    if let Err(error) = sd_notify::notify(states) {
        debug!("cannot notify the service manager of {states:?}: {error}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const POLL: Duration = Duration::from_millis(100);

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
            (0..100).filter(|&poll| supervisor.is_waiting(true, 7, start + POLL * poll)).collect();
        assert_eq!(fed, [20, 40, 60, 80]);
        assert!(!supervisor.is_waiting(false, 7, start + 200 * POLL), "nobody says that it waits");
    }

    #[test]
    fn sources_that_say_that_they_wait_while_frames_come_do_not_feed_the_watchdog() {
        let mut supervisor = Supervisor::new(Some(Duration::from_secs(8)));
        let start = Instant::now();
        // A damaged image each 1.5 s, from a camera that counts as waiting until a good one.
        let fed = (0..100).any(|poll| supervisor.is_waiting(true, u64::from(poll) / 15, start + POLL * poll));
        assert!(!fed);
        let fed = (100..200).find(|poll| supervisor.is_waiting(true, 6, start + POLL * *poll));
        assert_eq!(fed, Some(110), "it has been quiet since poll 90");
    }

    #[test]
    fn without_a_watchdog_nothing_is_sent() {
        assert!(!Supervisor::new(None).is_due(Instant::now()));
        assert!(!Supervisor::new(None).is_waiting(true, 0, Instant::now()));
    }
}

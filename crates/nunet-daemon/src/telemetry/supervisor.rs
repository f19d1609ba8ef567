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
}

/// So many times in a period is it told, so that one late frame is not the end.
const TIMES_A_PERIOD: u32 = 4;

impl Supervisor {
    pub(crate) fn from_environment() -> Self {
        Self::new(sd_notify::watchdog_enabled())
    }

    fn new(watchdog: Option<Duration>) -> Self {
        Self { period: watchdog.map(|period| period / TIMES_A_PERIOD), fed: None }
    }

    /// The model has passed its test, and memory is reserved: frames may come.
    pub(crate) fn ready(&self, status: &str) {
        tell(&[NotifyState::Ready, NotifyState::Status(status)]);
    }

    /// A frame went out. Nothing else feeds the watchdog: a process that only breathes is to be restarted.
    pub(crate) fn frame_done(&mut self) {
        if self.is_due(Instant::now()) {
            tell(&[NotifyState::Watchdog]);
        }
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

    #[test]
    fn the_watchdog_is_fed_a_few_times_a_period_and_not_with_every_frame() {
        let mut supervisor = Supervisor::new(Some(Duration::from_secs(8)));
        let start = Instant::now();
        let fed: Vec<u64> =
            (0..100).filter(|&frame| supervisor.is_due(start + Duration::from_millis(100 * frame))).collect();
        assert_eq!(fed, [0, 20, 40, 60, 80]);
    }

    #[test]
    fn without_a_watchdog_nobody_is_told() {
        assert!(!Supervisor::new(None).is_due(Instant::now()));
    }
}

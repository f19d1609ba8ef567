//! SIGINT, SIGTERM and SIGHUP: the first finishes what is in flight. A second SIGINT or SIGTERM ends the
//! process at once if it arrives at least one second after the first.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use nunet_telemetry::is_signal_ignored;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXFSZ};
use signal_hook::iterator::Signals;
use signal_hook::{flag, low_level};

/// Exit code of the second signal.
const INTERRUPTED_TWICE: i32 = 130;
/// Two signals within this time count as one. `timeout` of coreutils signals the process and its group,
/// `ros2 launch` and a terminal do the same.
const ONE_REQUEST: Duration = Duration::from_secs(1);
/// How often a stop is checked while sleeping.
const GLANCE: Duration = Duration::from_millis(50);

/// A stop was requested before the first frame.
#[derive(Debug, thiserror::Error)]
#[error("stopped before the first frame")]
pub(crate) struct Stopped;

/// A request to stop. Copies share it, so that every thread can check it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Stop(Arc<AtomicBool>);

impl Stop {
    /// A request that is made by signals.
    pub(crate) fn on_signals() -> anyhow::Result<Self> {
        let stop = Self::default();
        let failed = "cannot listen to SIGINT, SIGTERM and SIGHUP";
        for signal in [SIGINT, SIGTERM] {
            flag::register(signal, Arc::clone(&stop.0)).context(failed)?;
        }
        let signals = Signals::new([SIGINT, SIGTERM]).context(failed)?;
        let thread = std::thread::Builder::new().name("signals".into());
        thread.spawn(|| exit_on_second_signal(signals)).context(failed)?;
        // A closed terminal sends it twice, from the kernel and from the shell, and SIGTERM may follow: it
        // does not count as the first of two.
        if !is_signal_ignored(SIGHUP) {
            flag::register(SIGHUP, Arc::clone(&stop.0)).context(failed)?;
        }
        Ok(stop)
    }

    /// The flag, for modules that do not depend on this one.
    pub(crate) fn flag(&self) -> &AtomicBool {
        &self.0
    }

    /// Checked before each step that must not begin after a stop.
    ///
    /// # Errors
    /// [`Stopped`].
    pub(crate) fn check(&self) -> Result<(), Stopped> {
        if self.requested() { Err(Stopped) } else { Ok(()) }
    }

    /// Requests a stop, as a signal does.
    #[cfg(test)]
    pub(crate) fn request(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether a stop was requested.
    pub(crate) fn requested(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Sleeps for `duration`, less when a stop is requested.
    pub(crate) fn sleep(&self, duration: Duration) {
        let mut left = duration;
        while !left.is_zero() && !self.requested() {
            let nap = left.min(GLANCE);
            std::thread::sleep(nap);
            left -= nap;
        }
    }
}

/// Makes a file beyond the limit of its size (`ulimit -f`) an error of its writer, not the end of the
/// process.
pub(crate) fn survive_size_limits() {
    let _ = flag::register(SIGXFSZ, Arc::default()); // it fails for signals that cannot be handled only
}

/// Runs on a thread of its own, so that a second signal works even if all other threads hang.
fn exit_on_second_signal(mut signals: Signals) {
    let mut first = None;
    for _signal in &mut signals {
        if is_second_request(&mut first, Instant::now()) {
            low_level::exit(INTERRUPTED_TWICE);
        }
    }
}

/// Whether a signal that arrives `now` is a second request; `first` is when the first one arrived.
fn is_second_request(first: &mut Option<Instant>, now: Instant) -> bool {
    now.duration_since(*first.get_or_insert(now)) >= ONE_REQUEST
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn signals_within_a_second_count_as_one_and_a_later_one_as_the_second() {
        let (mut first, start) = (None, Instant::now());
        let counts: Vec<bool> = [0, 1, 500, 999, 1000, 5000]
            .map(|millis| is_second_request(&mut first, start + Duration::from_millis(millis)))
            .into();
        assert_eq!(counts, [false, false, false, false, true, true]);
    }

    #[test]
    fn no_step_starts_after_a_stop() {
        let stop = Stop::default();
        assert!(stop.check().is_ok());
        stop.request();
        assert!(stop.check().is_err());
    }
}

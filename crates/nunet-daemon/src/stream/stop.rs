//! SIGINT, SIGTERM and SIGHUP: the first finishes what is in flight, a second SIGINT or SIGTERM ends the process at
//! once.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::Context as _;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;

/// Exit code of the second signal.
const INTERRUPTED_TWICE: i32 = 130;
/// How long a stop may go unseen.
const GLANCE: Duration = Duration::from_millis(50);

/// What was begun is not gone on with, because a stop was requested before the first frame.
#[derive(Debug, thiserror::Error)]
#[error("stopped before the first frame")]
pub(crate) struct Stopped;

/// A request to stop, seen by every thread that holds a copy.
#[derive(Debug, Clone, Default)]
pub(crate) struct Stop(Arc<AtomicBool>);

impl Stop {
    /// A request that the process' signals make.
    pub(crate) fn on_signals() -> anyhow::Result<Self> {
        let stop = Self::default();
        let failed = "cannot listen to SIGINT, SIGTERM and SIGHUP";
        let asked = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM] {
            // The order matters: the conditional exit has to look at its flag before this signal sets it.
            flag::register_conditional_shutdown(signal, INTERRUPTED_TWICE, Arc::clone(&asked))
                .and_then(|_| flag::register(signal, Arc::clone(&asked)))
                .and_then(|_| flag::register(signal, Arc::clone(&stop.0)))
                .context(failed)?;
        }
        // It comes twice where a terminal is closed, of the kernel and of the shell, and SIGTERM may follow: nobody is
        // impatient, so that it does not count as the first of two.
        if !is_ignored(SIGHUP) {
            flag::register(SIGHUP, Arc::clone(&stop.0)).context(failed)?;
        }
        Ok(stop)
    }

    /// The flag itself, for modules that come before this one.
    pub(crate) fn flag(&self) -> &AtomicBool {
        &self.0
    }

    /// Asked before a step that is not to be begun after a stop.
    ///
    /// # Errors
    /// [`Stopped`].
    pub(crate) fn check(&self) -> Result<(), Stopped> {
        if self.requested() { Err(Stopped) } else { Ok(()) }
    }

    /// Makes the request, as a signal does.
    #[cfg(test)]
    pub(crate) fn request(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether it was made.
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

/// Whether this process was started with a signal ignored, as `nohup` does, and is to go on so. Read in the kernel's
/// table, since asking for the handler itself takes unsafe code.
fn is_ignored(signal: i32) -> bool {
    std::fs::read_to_string("/proc/self/status").is_ok_and(|status| ignores(&status, signal))
}

fn ignores(status: &str, signal: i32) -> bool {
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let mask = mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok()).unwrap_or(0);
    let bit = u32::try_from(signal - 1).ok().and_then(|place| mask.checked_shr(place));
    bit.is_some_and(|bit| bit & 1 == 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_ignored_is_read_from_the_kernels_table() {
        let status = "Name:\tnunetd\nSigBlk:\tffffffffffffffff\nSigIgn:\t0000000000001001\nSigCgt:\t0000000000004002\n";
        assert!(ignores(status, SIGHUP), "as under nohup");
        assert!(ignores(status, signal_hook::consts::SIGPIPE));
        assert!(!ignores(status, SIGINT) && !ignores(status, SIGTERM));
        assert!(!ignores("Name:\tnunetd\n", SIGHUP) && !ignores("SigIgn:\tnone\n", SIGHUP));
    }

    #[test]
    fn a_step_is_not_begun_after_a_stop() {
        let stop = Stop::default();
        assert!(stop.check().is_ok());
        stop.request();
        assert!(stop.check().is_err());
    }
}

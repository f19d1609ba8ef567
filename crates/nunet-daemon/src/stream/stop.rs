//! SIGINT and SIGTERM: the first finishes what is in flight, the second ends the process at once.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::Context as _;
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

/// Exit code of the second signal.
const INTERRUPTED_TWICE: i32 = 130;
/// How long a stop may go unseen.
const GLANCE: Duration = Duration::from_millis(50);

/// A request to stop, seen by every thread that holds a copy.
#[derive(Debug, Clone, Default)]
pub(crate) struct Stop(Arc<AtomicBool>);

impl Stop {
    /// A request that the process' signals make.
    pub(crate) fn on_signals() -> anyhow::Result<Self> {
        let stop = Self::default();
        for signal in [SIGINT, SIGTERM] {
            // The order matters: the conditional exit has to look at the flag before this signal sets it.
            flag::register_conditional_shutdown(signal, INTERRUPTED_TWICE, Arc::clone(&stop.0))
                .and_then(|_| flag::register(signal, Arc::clone(&stop.0)))
                .context("cannot listen to SIGINT and SIGTERM")?;
        }
        Ok(stop)
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

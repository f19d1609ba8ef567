//! The two clocks of the daemon: monotonic for durations and ages, unix for stamps that others read.

use std::time::{SystemTime, UNIX_EPOCH};

use nunet_core::clock::Clock;
use rustix::time::{ClockId, clock_gettime};

/// `CLOCK_MONOTONIC`, whose values processes of one machine can compare.
#[derive(Debug, Clone, Copy, Default)]
pub struct MonotonicClock;

impl Clock for MonotonicClock {
    fn nanos(&self) -> u64 {
        let now = clock_gettime(ClockId::Monotonic);
        // The kernel counts from boot, so both parts are positive.
        now.tv_sec.unsigned_abs() * 1_000_000_000 + now.tv_nsec.unsigned_abs()
    }
}

/// Nanoseconds since 1970, 0 on a machine whose clock stands before.
pub fn unix_nanos() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_nanos()).unwrap_or(i64::MAX)
}

/// `CLOCK_MONOTONIC` as the shared-memory contract counts it.
pub fn monotonic_nanos() -> i64 {
    i64::try_from(MonotonicClock.nanos()).unwrap_or(i64::MAX)
}

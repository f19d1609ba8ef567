//! The two clocks of the daemon: monotonic for durations and ages, unix for stamps that others read.

use std::time::{SystemTime, UNIX_EPOCH};

use nunet_core::clock::Clock;
use nunet_ipc::monotonic_nanos;

/// `CLOCK_MONOTONIC`, whose values processes of one machine can compare.
#[derive(Debug, Clone, Copy, Default)]
pub struct MonotonicClock;

impl Clock for MonotonicClock {
    fn nanos(&self) -> u64 {
        // The kernel counts from boot, so the number is positive.
        monotonic_nanos().unsigned_abs()
    }
}

/// Nanoseconds since 1970, 0 on a machine whose clock stands before.
pub fn unix_nanos() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_nanos()).unwrap_or(i64::MAX)
}

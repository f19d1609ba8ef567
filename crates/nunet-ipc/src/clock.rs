//! The clocks that processes share: monotonic for durations and ages, unix for stamps that other machines
//! read.

use std::time::{SystemTime, UNIX_EPOCH};

use rustix::time::{ClockId, clock_gettime};

/// Nanoseconds of `CLOCK_MONOTONIC`: what `publish_nanos` is measured in, and `capture_nanos` where the
/// header says so. `std::time::Instant` reads the same clock but does not expose the number.
#[must_use]
pub fn monotonic_nanos() -> i64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec * 1_000_000_000 + now.tv_nsec
}

/// Nanoseconds since 1970-01-01 UTC: what `capture_unix_nanos` is measured in. 0 if the machine's clock is
/// set to an earlier time.
#[must_use]
pub fn unix_nanos() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_nanos()).unwrap_or(i64::MAX)
}

//! The clock that every process of a machine shares.

use rustix::time::{ClockId, clock_gettime};

/// Nanoseconds of `CLOCK_MONOTONIC`: what `publish_nanos` is measured in, and `capture_nanos` where the header says
/// so. `std::time::Instant` reads the same clock but keeps the number to itself.
#[must_use]
pub fn monotonic_nanos() -> i64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec * 1_000_000_000 + now.tv_nsec
}

//! The clock of the pipeline.

use nunet_core::clock::Clock;
use rustix::time::{ClockId, clock_gettime};

/// `CLOCK_MONOTONIC`, whose values processes of one machine can compare.
#[derive(Debug, Clone, Copy, Default)]
pub struct MonotonicClock;

impl Clock for MonotonicClock {
    fn nanos(&self) -> u64 {
        let now = clock_gettime(ClockId::Monotonic);
        // The kernel counts from boot, so both numbers are positive.
        now.tv_sec.unsigned_abs() * 1_000_000_000 + now.tv_nsec.unsigned_abs()
    }
}

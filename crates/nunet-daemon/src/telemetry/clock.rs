//! The clock of the pipeline.

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

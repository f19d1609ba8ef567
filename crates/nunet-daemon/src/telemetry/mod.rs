//! What the daemon says of itself: log lines, latencies, allocations, the clock.

mod allocations;
mod clock;
mod latency;
mod log;

pub use allocations::{Allocations, CountingAllocator, allocations_of_this_thread, foreign_allocations};
pub use clock::{MonotonicClock, monotonic_nanos, unix_nanos};
pub use latency::{Latencies, Summary};
pub(crate) use log::start_logging;

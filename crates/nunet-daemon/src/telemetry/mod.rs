//! What the daemon knows of itself: the frame ledger, latencies, allocations, the clock.

mod allocations;
mod clock;
mod latency;
mod ledger;
mod rate_limit;
mod stall;
mod supervisor;
mod totals;

pub use allocations::{Allocations, CountingAllocator, allocations_of_this_thread, foreign_allocations};
pub use clock::MonotonicClock;
pub use latency::{Latencies, Summary};
pub use ledger::{Counts, End, Ledger};
pub(crate) use rate_limit::RateLimit;
pub(crate) use stall::StallDetector;
pub(crate) use supervisor::Supervisor;
pub(crate) use totals::Totals;

//! Counts, latencies and metrics of a stream of frames.
//!
//! | type | what it measures |
//! |---|---|
//! | [`Ledger`] | how every captured frame ended: published, superseded or failed |
//! | [`Latencies`] | percentiles of the total time and of each stage |
//! | [`Totals`] | frame rate, copied bytes and allocations per frame |
//! | [`StabilityTotals`] | drift and flicker of depth while the image does not change |
//! | [`CountingAllocator`] | heap allocations of each thread |
//! | [`StallDetector`] | for how long a counter has not grown |
//! | [`Series`] | quantiles of a benchmark |
//! | [`DrainTimeout`] | how long a shutdown waits for pending writes |
//! | [`RateLimit`] | how many messages of a kind were logged lately |
//!
//! [`Metrics`] writes counts and latencies for Prometheus, [`Supervisor`] feeds the watchdog of a service
//! manager. This crate does not depend on networks, shared memory or the command line, and sends nothing:
//! Prometheus polls it.
//!
//! # Example: the counts and latencies of two frames
//! ```
//! use nunet_telemetry::{Counts, FrameEnd, Latencies, Ledger};
//!
//! let (ledger, mut latencies) = (Ledger::default(), Latencies::new(["graph"]));
//! for total_micros in [20_000, 30_000] {
//!     ledger.captured();
//!     latencies.record(total_micros, [total_micros - 1_000]);
//!     ledger.ended(FrameEnd::Published);
//! }
//! assert_eq!(ledger.counts(), Counts { captured: 2, published: 2, ..Counts::default() });
//! assert_eq!(latencies.total().max, 30.0);
//! ```

mod allocations;
mod drain;
mod latency;
mod ledger;
mod machine;
mod messages;
mod metrics;
mod rate_limit;
mod series;
mod stability;
mod stall;
mod stats;
mod supervisor;
mod totals;

pub use allocations::{Allocations, CountingAllocator, allocations_of_this_thread, foreign_allocations};
pub use drain::{DrainTimeout, GivenUp, TelemetryErrorKind};
pub use latency::{Latencies, LatencySummary, micros_between};
pub use ledger::{Counts, FrameEnd, Ledger};
pub use machine::{host, is_signal_ignored, peak_rss_mb};
pub use messages::MessageCounts;
pub use metrics::{CameraMetrics, Metrics};
pub use rate_limit::{RateLimit, Suppressed};
pub use series::{SERIES_HEAD, Series};
pub use stability::{STABILITY_FRAMES, Stability, StabilitySummary, StabilityTotals};
pub use stall::StallDetector;
pub use stats::{LatencyMs, MessageStats};
pub use supervisor::Supervisor;
pub use totals::Totals;

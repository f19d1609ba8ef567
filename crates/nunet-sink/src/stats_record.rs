//! Fills the record of the `stats` topic.

use nunet_core::pipeline::Pipeline;
use nunet_ipc::StatsRecord;
use nunet_telemetry::{Counts, Latencies, Totals};

/// The stages outside of the pipeline: waiting before it, publishing after it.
const QUEUE: &str = "queue";
const PUBLISH: &str = "publish";
/// The stage after the pipeline.
const OBSTACLES: &str = "obstacles";

/// The stages of a frame in the order of the header's and the statistics' times. `publish` is not in the
/// header of the frame itself, which is written before it.
pub fn stage_names(pipeline: &Pipeline, has_obstacles: bool) -> impl Iterator<Item = &str> {
    let inner = pipeline.stage_names().iter().map(String::as_str);
    let obstacles = has_obstacles.then_some(OBSTACLES);
    std::iter::once(QUEUE).chain(inner).chain(obstacles).chain(std::iter::once(PUBLISH))
}

/// The frame counts.
pub fn set_counts(record: &mut StatsRecord, counts: &Counts) {
    record.captured = counts.captured;
    record.published = counts.published;
    record.superseded = counts.superseded;
    record.failed = counts.failed;
    record.in_flight = counts.in_flight;
}

/// Rates and percentiles.
pub fn set_summaries(record: &mut StatsRecord, totals: &Totals, latencies: &Latencies) {
    const US_PER_MS: f64 = 1e3;
    record.fps = totals.fps();
    record.bytes_copied_per_frame = totals.bytes_copied_per_frame();
    record.allocations_per_frame = totals.allocations_per_frame().unwrap_or(f64::NAN);
    record.set_stability(totals.stability.recent().map(|recent| [recent.drift, recent.flicker]));
    record.is_unstable = totals.stability.is_unstable().into();
    let total = latencies.total();
    record.total_p50_us = total.p50 * US_PER_MS;
    record.total_p90_us = total.p90 * US_PER_MS;
    record.total_p99_us = total.p99 * US_PER_MS;
    record.total_max_us = total.max * US_PER_MS;
    record.total_mean_us = total.mean * US_PER_MS;
    for (index, (_, stage)) in latencies.stages().enumerate().take(record.stage_p50_us.len()) {
        record.stage_p50_us[index] = stage.p50 * US_PER_MS;
        record.stage_p90_us[index] = stage.p90 * US_PER_MS;
        record.stage_p99_us[index] = stage.p99 * US_PER_MS;
        record.stage_max_us[index] = stage.max * US_PER_MS;
        record.stage_mean_us[index] = stage.mean * US_PER_MS;
    }
}

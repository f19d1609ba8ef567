//! Fills the record of the `stats` topic.

use nunet_ipc::StatsRecord;

use nunet_telemetry::{Counts, Latencies, Totals};

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

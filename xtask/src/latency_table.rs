//! The latencies in a `stats.json`, as a table.

use std::fmt;
use std::fmt::Write as _;

use anyhow::Result;
use serde::Deserialize;
use serde::de::{MapAccess, Visitor};

#[derive(Deserialize)]
struct StatsFile {
    latency_ms: LatencyTables,
    fps: f64,
    bytes_copied_per_frame: f64,
    /// `null` where a build does not count them.
    allocations_per_frame: Option<f64>,
    frames: Frames,
}

#[derive(Deserialize)]
struct LatencyTables {
    total: LatencyRow,
    stages: Stages,
}

#[derive(Deserialize)]
struct LatencyRow {
    p50: f64,
    p90: f64,
    p99: f64,
    max: f64,
    mean: f64,
}

#[derive(Deserialize)]
struct Frames {
    captured: u64,
    published: u64,
    superseded: u64,
    failed: u64,
}

/// The stages in the order of the file, which a map of the standard library would lose.
struct Stages(Vec<(String, LatencyRow)>);

impl<'de> Deserialize<'de> for Stages {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct InOrder;
        impl<'de> Visitor<'de> for InOrder {
            type Value = Stages;

            fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
                formatter.write_str("an object of stages")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Stages, A::Error> {
                let mut stages = Vec::new();
                while let Some(stage) = map.next_entry()? {
                    stages.push(stage);
                }
                Ok(Stages(stages))
            }
        }
        deserializer.deserialize_map(InOrder)
    }
}

/// How long a frame waited for the one before. It is part of the total, but it is not processing time.
const WAITING: &str = "queue";

/// The table, one row per stage and the total last, and a line about the whole run.
pub(crate) fn render(stats_json: &str) -> Result<String> {
    let stats: StatsFile = serde_json::from_str(stats_json)?;
    let stages: Vec<_> = stats.latency_ms.stages.0.iter().filter(|(name, _)| name != WAITING).collect();
    let widest =
        stages.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0).max("latency ms".len());
    let mut table = String::new();
    writeln!(table, "{:widest$}{:>9}{:>9}{:>9}{:>9}{:>9}", "latency ms", "p50", "p90", "p99", "max", "mean")?;
    let total = ("total".to_owned(), &stats.latency_ms.total);
    let stages = stages.iter().map(|(name, row)| (name.clone(), row));
    for (name, row) in stages.chain([total]) {
        let LatencyRow { p50, p90, p99, max, mean } = row;
        writeln!(table, "{name:widest$}{p50:>9.2}{p90:>9.2}{p99:>9.2}{max:>9.2}{mean:>9.2}")?;
    }
    let Frames { captured, published, superseded, failed } = stats.frames;
    writeln!(
        table,
        "{captured} frames captured, {published} published, {superseded} superseded, {failed} failed"
    )?;
    let allocations = stats.allocations_per_frame.map_or("uncounted".to_owned(), rounded);
    write!(
        table,
        "{:.1} frames per second, {} bytes copied and {allocations} allocations per frame",
        stats.fps, stats.bytes_copied_per_frame
    )?;
    Ok(table)
}

/// At most two digits behind the point.
fn rounded(count: f64) -> String {
    ((count * 100.0).round() / 100.0).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    const STATS: &str = r#"{
        "contract": 1, "camera": "demo", "model": {"name": "wnet_c", "hash": "00"}, "provider": "cpu",
        "frames": {"captured": 100, "published": 99, "superseded": 0, "failed": 1, "in_flight": 0},
        "latency_ms": {
            "total": {"p50": 24.5, "p90": 25, "p99": 27.125, "max": 30, "mean": 24.75},
            "stages": {
                "queue": {"p50": 0.1, "p90": 0.1, "p99": 0.1, "max": 0.1, "mean": 0.1},
                "preprocess": {"p50": 0.5, "p90": 0.5, "p99": 0.5, "max": 0.5, "mean": 0.5},
                "depth": {"p50": 24, "p90": 24.5, "p99": 26.625, "max": 29.5, "mean": 24.25}
            }
        },
        "fps": 40.25, "bytes_copied_per_frame": 0, "allocations_per_frame": 0.0119
    }"#;

    #[test]
    fn rows_follow_the_order_of_the_stages_without_waiting_and_end_with_the_total() {
        assert_eq!(
            render(STATS).unwrap(),
            "latency ms      p50      p90      p99      max     mean\n\
             preprocess     0.50     0.50     0.50     0.50     0.50\n\
             depth         24.00    24.50    26.62    29.50    24.25\n\
             total         24.50    25.00    27.12    30.00    24.75\n\
             100 frames captured, 99 published, 0 superseded, 1 failed\n\
             40.2 frames per second, 0 bytes copied and 0.01 allocations per frame"
        );
    }

    #[test]
    fn a_file_without_latencies_is_an_error_that_names_the_key() {
        let error = render(r#"{"fps": 1}"#).err().unwrap().to_string();
        assert!(error.contains("latency_ms"), "{error}");
    }
}

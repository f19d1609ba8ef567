//! `stats.json`: what a stream did, in figures.

use std::path::Path;

use anyhow::Context as _;
use nunet_core::depth::Scale;
use serde::{Serialize, Serializer};

use crate::telemetry::{Counts, Latencies, Summary, Totals};
use crate::words;

/// The figures of a stream.
#[derive(Debug, Serialize)]
pub(crate) struct Stats {
    pub(crate) contract: u32,
    pub(crate) camera: String,
    pub(crate) model: ModelName,
    pub(crate) provider: String,
    /// Unit of the depth maps.
    pub(crate) units: &'static str,
    /// Where their scale comes from.
    pub(crate) scale_source: &'static str,
    pub(crate) frames: Counts,
    pub(crate) latency_ms: LatencyMs,
    /// Published frames a second, from the first capture to the last publication.
    pub(crate) fps: f64,
    pub(crate) bytes_copied_per_frame: f64,
    /// Rust heap allocations of our crates on the inference thread, after the first frames; `null` where they are not
    /// counted.
    pub(crate) allocations_per_frame: Option<f64>,
    /// The same of iceoryx2: a small one for each message.
    pub(crate) iceoryx2_allocations_per_frame: Option<f64>,
}

impl Stats {
    pub(crate) fn new(
        camera: String,
        model: ModelName,
        provider: String,
        scale: Scale,
        frames: Counts,
        totals: &Totals,
        latencies: &Latencies,
    ) -> Self {
        Self {
            contract: nunet_ipc::CONTRACT_VERSION,
            camera,
            model,
            provider,
            units: words::units(scale.units).name(),
            scale_source: words::scale_source(scale.source).name(),
            frames,
            latency_ms: latencies.into(),
            fps: totals.fps(),
            bytes_copied_per_frame: totals.bytes_copied_per_frame(),
            allocations_per_frame: totals.allocations_per_frame(),
            iceoryx2_allocations_per_frame: totals.foreign_allocations_per_frame(),
        }
    }
}

/// Which model ran.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct ModelName {
    pub(crate) name: String,
    /// SHA-256, hexadecimal.
    pub(crate) hash: String,
}

/// Milliseconds, from the source's hand-over to the wake-up of the readers.
#[derive(Debug, Serialize)]
pub(crate) struct LatencyMs {
    pub(crate) total: Summary,
    /// In the order of the journey.
    #[serde(serialize_with = "as_map")]
    pub(crate) stages: Vec<(String, Summary)>,
}

fn as_map<S: Serializer>(stages: &[(String, Summary)], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_map(stages.iter().map(|(name, summary)| (name, summary)))
}

impl From<&Latencies> for LatencyMs {
    fn from(latencies: &Latencies) -> Self {
        let stages = latencies.stages().map(|(name, summary)| (name.to_owned(), summary)).collect();
        Self { total: latencies.total(), stages }
    }
}

/// Makes sure before a long run that its figures can be written at the end.
pub(crate) fn check_writable(path: &Path) -> anyhow::Result<()> {
    let existed = path.exists();
    let opened = std::fs::OpenOptions::new().create(true).append(true).open(path);
    opened.map(drop).with_context(|| format!("cannot write `{}`", path.display()))?;
    if !existed {
        std::fs::remove_file(path).with_context(|| format!("cannot write `{}`", path.display()))?;
    }
    Ok(())
}

/// Writes `value` as JSON.
pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> anyhow::Result<()> {
    let text = serde_json::to_string_pretty(value).context("cannot put the figures into JSON")?;
    std::fs::write(path, text + "\n").with_context(|| format!("cannot write `{}`", path.display()))
}

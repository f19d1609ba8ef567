//! `stats.json`: what a stream did, in figures.

use std::io::ErrorKind;
use std::os::unix::ffi::OsStrExt as _;
use std::os::unix::fs::{FileTypeExt as _, OpenOptionsExt as _};
use std::path::Path;

use anyhow::{Context as _, bail};
use nunet_core::depth::Scale;
pub(crate) use nunet_engine::ModelName;
use serde::{Serialize, Serializer};

use nunet_telemetry::{Counts, Latencies, Summary, Totals};

/// The figures of a camera, or of several together.
#[derive(Debug, Serialize)]
pub(crate) struct Stats {
    pub(crate) contract: u32,
    pub(crate) camera: String,
    pub(crate) model: ModelName,
    pub(crate) provider: String,
    /// The names that the numbers of `labels.png` stand for, from 0; empty where there are no labels.
    pub(crate) classes: Vec<String>,
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
    /// Why its source failed, where it did.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) error: Option<String>,
    /// Of each camera, where there are several: what would stand in the file of that camera alone.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) cameras: Vec<Stats>,
}

/// What the cameras of a process have in common.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Common<'a> {
    pub(crate) model: &'a ModelName,
    pub(crate) provider: &'a str,
    pub(crate) classes: &'a [String],
}

impl Stats {
    pub(crate) fn new(
        camera: String,
        Common { model, provider, classes }: Common<'_>,
        scale: Scale,
        frames: Counts,
        totals: &Totals,
        latencies: &Latencies,
    ) -> Self {
        Self {
            contract: nunet_ipc::CONTRACT_VERSION,
            camera,
            model: model.clone(),
            provider: provider.to_owned(),
            classes: classes.to_vec(),
            units: scale.units.name(),
            scale_source: scale.source.name(),
            frames,
            latency_ms: latencies.into(),
            fps: totals.fps(),
            bytes_copied_per_frame: totals.bytes_copied_per_frame(),
            allocations_per_frame: totals.allocations_per_frame(),
            iceoryx2_allocations_per_frame: totals.foreign_allocations_per_frame(),
            error: None,
            cameras: Vec::new(),
        }
    }

    /// The figures of several cameras, one at least: names joined, frames added up, rates and latencies over all frames.
    pub(crate) fn of_all(
        cameras: Vec<Self>,
        common: Common<'_>,
        scale: Scale,
        totals: &Totals,
        latencies: &Latencies,
    ) -> Self {
        let names: Vec<_> = cameras.iter().map(|stats| &stats.camera[..]).collect();
        let mut frames = Counts::default();
        cameras.iter().for_each(|stats| frames += stats.frames);
        let all = Self::new(names.join(", "), common, scale, frames, totals, latencies);
        let alike = |of: fn(&Self) -> &'static str, own: &'static str| {
            if cameras.iter().all(|stats| of(stats) == own) { own } else { "mixed" }
        };
        let units = alike(|stats| stats.units, all.units);
        let scale_source = alike(|stats| stats.scale_source, all.scale_source);
        Self { units, scale_source, cameras, ..all }
    }
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
    if is_named_pipe(path) {
        bail!("cannot write `{}`: it is a named pipe\nhint: name a plain file", path.display());
    }
    if let Some(folder) = missing_folder(path) {
        let (path, folder) = (path.display(), folder.display());
        bail!("cannot write `{path}`: there is no folder `{folder}`\nhint: make it first: mkdir -p {folder}");
    }
    let existed = path.exists();
    let mut how = std::fs::OpenOptions::new();
    // Not to wait for the reader of a pipe that has none any more.
    let opened = how.create(true).append(true).custom_flags(libc::O_NONBLOCK).open(path);
    opened.map(drop).with_context(|| format!("cannot write `{}`", path.display()))?;
    if !existed {
        std::fs::remove_file(path).with_context(|| format!("cannot write `{}`", path.display()))?;
    }
    Ok(())
}

/// The folder that a file is to lie in, or that a path with a slash at its end names, where it is not there.
fn missing_folder(path: &Path) -> Option<&Path> {
    let is_folder = path.as_os_str().as_bytes().ends_with(b"/");
    let folder = if is_folder { Some(path) } else { path.parent() };
    let missing = |folder: &Path| folder.metadata().is_err_and(|error| error.kind() == ErrorKind::NotFound);
    folder.filter(|folder| !folder.as_os_str().is_empty() && missing(folder))
}

/// Whoever reads a named pipe is sent away when it is closed after the trial. A pipe without a name, as `/dev/stdout` may
/// be, is kept open by whoever gave it to this process.
fn is_named_pipe(path: &Path) -> bool {
    path.metadata().is_ok_and(|found| found.file_type().is_fifo()) && path.canonicalize().is_ok()
}

/// Writes `value` as JSON.
pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> anyhow::Result<()> {
    let text = serde_json::to_string_pretty(value).context("cannot put the figures into JSON")?;
    std::fs::write(path, text + "\n").with_context(|| format!("cannot write `{}`", path.display()))
}

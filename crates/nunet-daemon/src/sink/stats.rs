//! `stats.json`: counts and latencies of a stream.

use std::collections::BTreeMap;

use nunet_core::depth::{Scale, Units};
pub(crate) use nunet_engine::ModelName;
use nunet_telemetry::{Counts, Latencies, LatencyMs, MessageStats, StabilitySummary, Totals};
use nunet_types::PixelRect;
use serde::Serialize;

/// The stats of a camera, or of several together.
#[derive(Debug, Serialize)]
pub(crate) struct Stats {
    pub(crate) contract: u32,
    pub(crate) camera: String,
    pub(crate) model: ModelName,
    pub(crate) provider: String,
    /// The class names of the values in `labels.png`, from 0; empty without labels.
    pub(crate) classes: Vec<String>,
    /// Unit of the depth maps.
    pub(crate) units: &'static str,
    /// The source of their scale.
    pub(crate) scale_source: &'static str,
    /// Factor by which the network's meters are multiplied; `null` for relative depth or several cameras.
    pub(crate) scale_factor: Option<f32>,
    /// Seconds since the factor was measured; 0 for one that does not change.
    pub(crate) scale_age_s: f64,
    /// The part of the image that depth covers: first column, first row, width, height, pixels of the image.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) view: Option<[u32; 4]>,
    pub(crate) frames: Counts,
    pub(crate) latency_ms: LatencyMs,
    /// Published frames per second, from the start of the stream to the last publication.
    pub(crate) fps: f64,
    pub(crate) bytes_copied_per_frame: f64,
    /// Frames for which no attitude of the robot was found; absent if all had one, or it is not read.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) frames_without_attitude: Option<u64>,
    /// Drift and flicker of depth while the image did not change.
    pub(crate) stability: StabilitySummary,
    /// Mean heap allocations of nunet's crates per frame, without the first frames; `null` if not counted.
    pub(crate) allocations_per_frame: Option<f64>,
    /// Mean heap allocations of iceoryx2, which makes a small one for each message.
    pub(crate) iceoryx2_allocations_per_frame: Option<f64>,
    /// The counts of its messages for each output that has any: `ros2`, `foxglove`.
    #[serde(flatten)]
    pub(crate) messages: BTreeMap<&'static str, MessageStats>,
    /// Why its source failed, if it did.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) error: Option<String>,
    /// The stats of each camera, if there are several.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(crate) cameras: Vec<Stats>,
}

/// The fields that all cameras of a process share.
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
            scale_factor: (scale.units == Units::Metre).then_some(scale.factor),
            scale_age_s: scale.age_nanos as f64 / 1e9,
            view: None,
            frames,
            latency_ms: latencies.into(),
            fps: totals.fps(),
            bytes_copied_per_frame: totals.bytes_copied_per_frame(),
            frames_without_attitude: Some(totals.without_attitude).filter(|count| *count > 0),
            stability: totals.stability.summary(),
            allocations_per_frame: totals.allocations_per_frame(),
            iceoryx2_allocations_per_frame: totals.foreign_allocations_per_frame(),
            messages: BTreeMap::new(),
            error: None,
            cameras: Vec::new(),
        }
    }

    /// The same with the part of the image that depth covers.
    pub(crate) fn with_view(self, PixelRect { x, y, width, height }: PixelRect) -> Self {
        Self { view: Some([x, y, width, height]), ..self }
    }

    /// The stats of several cameras, at least one: names joined, frames added up, rates and latencies over
    /// all frames.
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
        Self { units, scale_source, scale_factor: None, scale_age_s: 0.0, cameras, ..all }
    }
}

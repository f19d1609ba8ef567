//! The paper's Table 2: milliseconds of 100 predictions on an RTX 2060, 480x640, ResNet-34 encoders.

use nunet_core::pipeline::Pipeline;
use nunet_types::ImageSize;
use serde_json::{Value, json};

/// One network of the table.
#[derive(Debug, Clone, Copy)]
pub(super) struct PaperRow {
    architecture: &'static str,
    mean: f64,
    min: f64,
    max: f64,
}

const TABLE: [PaperRow; 3] = [
    PaperRow { architecture: "unet", mean: 100.64, min: 80.16, max: 458.64 },
    PaperRow { architecture: "wnet", mean: 133.02, min: 120.15, max: 360.60 },
    PaperRow { architecture: "wnet_c", mean: 132.66, min: 118.58, max: 195.70 },
];

/// The times in the paper for the same network, if it is one of the paper's.
pub(super) fn row(pipeline: &Pipeline) -> Option<PaperRow> {
    let description = pipeline.graph().description();
    let same = pipeline.size() == ImageSize::new(640, 480)
        && description.inner_size.is_none_or(|inner| inner == [480, 640])
        && description.components.iter().all(|component| component.backbone == "resnet34");
    TABLE.into_iter().find(|row| same && row.architecture == description.architecture)
}

impl PaperRow {
    pub(super) fn json(self) -> Value {
        json!({ "mean": self.mean, "min": self.min, "max": self.max, "device": "RTX 2060" })
    }

    pub(super) fn text(self) -> String {
        let Self { mean, min, max, .. } = self;
        format!("{:<14}{mean:>10.2}{min:>10.2}{:>50.2}   (RTX 2060)", "the paper", max)
    }
}

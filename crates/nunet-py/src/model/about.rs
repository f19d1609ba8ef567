//! The constant properties of a model.

use std::path::PathBuf;

use nunet_engine::Model;
use nunet_types::ImageSize;

/// The properties that never change. Reading them does not wait for inference.
pub(super) struct About {
    pub(super) path: PathBuf,
    pub(super) size: ImageSize,
    pub(super) architecture: String,
    pub(super) trained: bool,
    pub(super) provider: &'static str,
    pub(super) filters: Vec<String>,
    pub(super) json: String,
}

impl About {
    pub(super) fn of(model: &Model) -> Self {
        let graph = model.pipeline().graph();
        Self {
            path: model.path().to_owned(),
            size: model.size(),
            architecture: graph.description().architecture.clone(),
            trained: graph.description().trained,
            provider: graph.provider().name(),
            filters: model.pipeline().filters().specs().map(|filter| filter.to_string()).collect(),
            json: model.report_json().to_owned(),
        }
    }
}

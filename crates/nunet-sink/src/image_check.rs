//! Warns about the results of a single image.

use std::path::Path;

use nunet_core::depth::ScaleSource;
use nunet_core::pipeline::{FrameReport, Pipeline};
use tracing::warn;

use crate::empty_depth::EmptyDepthWarning;

/// What to check if the floor of an image gives no scale.
const FLOOR_HINT: &str = "show floor in a tenth of the image or more, and check the mount: z is in meters, \
     pitch in radians, and a positive pitch looks down";

/// Warns if `image` has no valid depth, or if the floor was to give the scale and does not.
pub fn warn_of_image(image: &Path, report: &FrameReport, pipeline: &Pipeline) {
    EmptyDepthWarning::default().check(0, report, pipeline.size());
    let (source, factor) = (report.scale_source, report.scale_factor);
    if let Some(text) = pipeline.mount().and_then(|_| without_floor(image, source, factor)) {
        warn!(hint = FLOOR_HINT, "{text}");
    }
}

/// The warning if the scale of an image is not from the floor.
fn without_floor(image: &Path, source: ScaleSource, factor: f32) -> Option<String> {
    let is_measured = source == ScaleSource::Floor;
    (!is_measured).then(|| {
        format!(
            "no scale was measured on the floor of `{}`: expected the scale source `{}`, got `{}` with \
             factor {factor:.3}",
            image.display(),
            ScaleSource::Floor.name(),
            source.name()
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_whose_scale_is_not_from_the_floor_is_named_with_its_scale() {
        let text = without_floor(Path::new("black.png"), ScaleSource::AssumedCamera, 1.0).unwrap();
        for part in ["`black.png`", "`floor`", "`assumed_camera`", "1.000"] {
            assert!(text.contains(part), "{text}");
        }
        assert_eq!(without_floor(Path::new("room.png"), ScaleSource::Floor, 0.8), None);
    }
}

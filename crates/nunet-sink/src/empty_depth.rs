//! Warns about depth maps without valid depth.

use std::time::Instant;

use nunet_core::pipeline::FrameReport;
use nunet_telemetry::RateLimit;
use nunet_types::ImageSize;
use tracing::warn;

/// Warns about depth maps without valid depth, with a rate limit.
#[derive(Debug, Default)]
pub struct EmptyDepthWarning {
    limit: RateLimit,
}

impl EmptyDepthWarning {
    /// Warns if all pixels of a frame's depth map of `size` are invalid, and returns whether they are.
    pub fn check(&mut self, sequence: u64, report: &FrameReport, size: ImageSize) -> bool {
        let is_empty = report.invalid_pixels as usize >= size.pixel_count();
        if is_empty && let Some(suppressed) = self.limit.allow(Instant::now()) {
            let hint = "check the depth range and the normalization in the model's description";
            warn!(hint, "frame {sequence} has no valid depth: all pixels are NaN{suppressed}");
        }
        is_empty
    }
}

#[cfg(test)]
mod tests {
    use nunet_core::depth::ScaleSource;
    use nunet_core::graph::{Quality, StageTimes};
    use nunet_types::{PixelRect, Units};

    use super::*;

    #[test]
    fn only_a_map_without_any_measurement_is_empty() {
        let report = |invalid_pixels| FrameReport {
            stages: StageTimes::default(),
            quality: Quality::Full,
            units: Units::Metre,
            scale_source: ScaleSource::Metric,
            scale_factor: 1.0,
            scale_age_nanos: 0,
            view: PixelRect::default(),
            bytes_copied: 0,
            invalid_pixels,
            stability: None,
            camera: None,
        };
        let mut warning = EmptyDepthWarning::default();
        assert!(warning.check(0, &report(12), (4, 3).into()));
        assert!(!warning.check(1, &report(11), (4, 3).into()));
    }
}

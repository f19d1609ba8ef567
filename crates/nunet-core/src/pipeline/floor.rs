//! The scale that follows the floor from frame to frame.

use super::{Lens, PipelineOptions};
use crate::camera::Mount;
use crate::depth::{DepthImage, Scale, ScaleSource, Units};
use crate::graph::SerialGraph;
use crate::scale::{FloorGauge, ScaleError, ScaleMode, ScaleTracker};

/// Measures the factor on each frame's floor and corrects its depth.
pub(super) struct FloorScale {
    gauge: FloorGauge,
    tracker: ScaleTracker,
    frame_nanos: Option<i64>,
}

impl FloorScale {
    /// `None` if the floor is not used.
    pub(super) fn new(
        graph: &SerialGraph,
        options: &PipelineOptions,
        lens: &Lens,
    ) -> Result<Option<Self>, ScaleError> {
        let ScaleMode::Floor(mount) = options.scale else { return Ok(None) };
        let description = graph.description();
        if !description.encoding.is_metric() {
            return Err(ScaleError::NoUnit);
        }
        let gauge = FloorGauge::new(&lens.at_network, mount, &description.classes)?;
        Ok(Some(Self { gauge, tracker: ScaleTracker::default(), frame_nanos: None }))
    }

    /// The capture time of the next frame.
    pub(super) fn set_frame_nanos(&mut self, nanos: i64) {
        self.frame_nanos = Some(nanos);
    }

    pub(super) fn set_mount(&mut self, mount: Mount) {
        self.gauge.set_mount(mount);
    }

    /// Discards the factor.
    pub(super) fn forget(&mut self) {
        self.tracker.reset();
    }

    /// Corrects depth of scale `base`, at the network's size, and returns its new scale.
    pub(super) fn correct(
        &mut self,
        depth_m: &mut [f32],
        labels: Option<&[u8]>,
        confidence: Option<&[u8]>,
        base: Scale,
    ) -> Scale {
        let found = self.gauge.measure(&DepthImage { depth_m, labels, confidence });
        let measured = found.map(|found| base.factor * found.ratio);
        let Some(tracked) = self.tracker.update(measured, self.frame_nanos.take()) else { return base };
        let correction = tracked.factor / base.factor;
        depth_m.iter_mut().for_each(|depth| *depth *= correction);
        Scale {
            units: Units::Metre,
            source: ScaleSource::Floor,
            factor: tracked.factor,
            age_nanos: tracked.age_nanos,
        }
    }
}

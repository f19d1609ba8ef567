//! Decodes network outputs to depth.

use nunet_types::shortest;

use super::confidence::blank;
use super::network::Network;
use super::{FloorScale, Lens, PipelineError, PipelineOptions};
use crate::camera::check_scale_factor;
use crate::depth::{BorderFill, DepthEncoding, DepthRange, OutputScale, Scale, ScaleSource};
use crate::frame::ImageView;
use crate::graph::{GraphOutputs, SerialGraph};
use crate::scale::{ScaleError, ScaleMode};

/// Decodes a network's output, for one camera.
pub(super) struct Decoder {
    encoding: DepthEncoding,
    output: OutputScale,
    range: DepthRange,
    /// `None` for untrained and foreign networks, whose borders were not measured.
    border: Option<BorderFill>,
    /// The scale before the correction by the floor.
    own_scale: Scale,
    /// The scale of the last frame.
    pub(super) scale: Scale,
    pub(super) floor: Option<FloorScale>,
    max_range_m: Option<f32>,
}

impl Decoder {
    pub(super) fn new(
        graph: &SerialGraph,
        options: &PipelineOptions,
        lens: &Lens,
    ) -> Result<Self, PipelineError> {
        let description = graph.description();
        let (encoding, output, range) = (description.encoding, description.output_scale, description.range);
        let is_measured = description.trained && !description.is_foreign();
        let scale = scale(graph, options, lens)?;
        Ok(Self {
            encoding,
            output,
            range,
            border: BorderFill::new(graph.size()).filter(|_| is_measured),
            own_scale: scale,
            scale,
            floor: FloorScale::new(graph, options, lens)?,
            max_range_m: options.max_range_m,
        })
    }

    /// Points of the cloud farther from the camera have no coordinates. The range is the network's, before
    /// the factor.
    pub(super) fn max_range_m(&self) -> f32 {
        let of_model = || {
            if self.encoding.is_metric() { self.range.max_m() * self.scale.factor } else { f32::INFINITY }
        };
        self.max_range_m.unwrap_or_else(of_model)
    }

    /// Decodes to depth, in place, adapts the confidence to it, and applies the correction by the floor, for
    /// which labels and confidence are used. Those that are not in `results` are those that `network` kept.
    /// Returns the number of invalid pixels.
    pub(super) fn decode(
        &mut self,
        network: &mut Network,
        frame: &ImageView<'_>,
        results: GraphOutputs<'_>,
    ) -> u32 {
        let GraphOutputs { depth, labels, mut confidence } = results;
        if let Some(border) = self.border {
            border.apply(depth);
        }
        let invalid = self.encoding.decode(depth, self.output, self.range, self.own_scale.factor);
        if let Some(values) = confidence.as_deref_mut().or(network.confidence_mut()) {
            self.adapt_confidence(values, depth);
        }
        if let Some(floor) = &mut self.floor {
            let labels = labels.as_deref().or(network.appearance(frame).labels);
            let confidence = confidence.as_deref().or(network.confidence());
            self.scale = floor.correct(depth, labels, confidence, self.own_scale);
        }
        invalid
    }

    /// Adapts the confidence to decoded depth. At the border it is that of the pixels whose depth is taken.
    fn adapt_confidence(&self, values: &mut [u8], depth: &[f32]) {
        if let Some(border) = self.border {
            border.apply(values);
        }
        blank(values, depth);
    }

    /// Discards the measurements of the floor.
    pub(super) fn forget_floor(&mut self) {
        self.floor.iter_mut().for_each(FloorScale::forget);
        self.scale = self.own_scale;
    }

    /// The network's own depth: as [`Self::decode`], without the border and the scale factor.
    pub(super) fn decode_unscaled(&self, depth: &mut [f32]) -> u32 {
        self.encoding.decode(depth, self.output, self.range, 1.0)
    }
}

/// The scale of all frames. Both focal lengths are compared at the network's width. A network that takes the
/// camera as an input corrects for it by itself.
fn scale(graph: &SerialGraph, options: &PipelineOptions, lens: &Lens) -> Result<Scale, PipelineError> {
    let encoding = graph.description().encoding;
    Ok(match (options.scale, options.calibrated_factor) {
        (ScaleMode::Off, _) => Scale::unscaled(encoding),
        (_, Some(_)) if !encoding.is_metric() => return Err(ScaleError::NoUnit.into()),
        (_, Some(factor)) => Scale::calibrated(encoding, check_scale_factor(shortest(factor))?),
        _ if graph.needs_camera() && encoding.is_metric() => {
            let source = if lens.known.is_some() { ScaleSource::Metric } else { ScaleSource::AssumedCamera };
            Scale { source, ..Scale::unscaled(encoding) }
        }
        _ => Scale::from_focal_lengths(encoding, graph.training_fx_px(), lens.network_fx_px),
    })
}

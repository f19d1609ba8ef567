//! From network outputs to depth.

use super::{Focal, Lens, PipelineOptions};
use crate::depth::{BorderFill, DepthEncoding, DepthRange, OutputScale, Scale, ScaleSource, Units};
use crate::graph::SerialGraph;

/// Decodes a network's output, for one camera.
pub(super) struct Decoder {
    encoding: DepthEncoding,
    output: OutputScale,
    range: DepthRange,
    /// Not for untrained and foreign networks, whose borders were not measured.
    border: Option<BorderFill>,
    pub(super) scale: Scale,
    /// Points of the cloud farther from the camera have no coordinates.
    pub(super) max_range_m: f32,
}

impl Decoder {
    pub(super) fn new(graph: &SerialGraph, options: &PipelineOptions, lens: &Lens) -> Self {
        let description = graph.description();
        let (encoding, output, range) = (description.encoding, description.output_scale, description.range);
        let scale = scale(graph, options.focal, lens);
        // The range is the network's, before the correction for the focal length.
        let model_max_m =
            if encoding.is_metric() { range.max_m() * scale.focal_factor } else { f32::INFINITY };
        let max_range_m = options.max_range_m.unwrap_or(model_max_m);
        let is_measured = description.trained && !description.is_foreign();
        let border = BorderFill::new(graph.size()).filter(|_| is_measured);
        Self { encoding, output, range, border, scale, max_range_m }
    }

    /// Decodes to depth, in place; returns how many pixels are not a measurement.
    pub(super) fn decode(&self, depth: &mut [f32]) -> u32 {
        if let Some(border) = self.border {
            border.apply(depth);
        }
        self.encoding.decode(depth, self.output, self.range, self.scale.focal_factor)
    }

    /// The network's own depth: as [`Self::decode`], without the border and the correction for the focal length.
    pub(super) fn decode_unscaled(&self, depth: &mut [f32]) -> u32 {
        self.encoding.decode(depth, self.output, self.range, 1.0)
    }
}

/// The scale of all frames. Both focal lengths are compared at the network's width. A network that takes the camera as an
/// input corrects for it by itself.
fn scale(graph: &SerialGraph, focal: Focal, lens: &Lens) -> Scale {
    let (description, width) = (graph.description(), f64::from(graph.size().width));
    let encoding = description.encoding;
    let training_fx_px = description.camera.map(|camera| camera.fx * width / f64::from(camera.width));
    match focal {
        _ if graph.needs_camera() && encoding.is_metric() => {
            let source = if lens.known.is_some() { ScaleSource::Metric } else { ScaleSource::AssumedCamera };
            Scale { units: Units::Metre, source, focal_factor: 1.0 }
        }
        Focal::Off => Scale::unscaled(encoding),
        Focal::Auto => Scale::from_focal_lengths(encoding, training_fx_px, lens.network_fx_px),
    }
}

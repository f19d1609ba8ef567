//! What the numbers of a depth map are, and where their scale comes from.

use super::Encoding;

/// The unit of a depth map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Units {
    /// Not a length at all, as of labels.
    None,
    /// Metres along the optical axis.
    Metre,
    /// Nearer or farther, without a unit.
    Relative,
}

/// Where a depth map's scale comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ScaleSource {
    /// The network's own metres, as they are.
    Metric,
    /// The network's metres times the ratio of this camera's focal length to the training camera's.
    FocalScaled,
    /// The network's metres, as if this camera had the training camera's focal length: nobody said which it has.
    AssumedCamera,
    /// No scale.
    Relative,
}

/// How to scale what a network says, decided once when the pipeline is built.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// The unit of the depth map.
    pub units: Units,
    /// Where its scale comes from.
    pub source: ScaleSource,
    /// What to multiply the network's metres by.
    pub focal_factor: f32,
}

impl Scale {
    /// The scale of a network's depth from the focal lengths of both cameras, in pixels at the network's size.
    ///
    /// Depth from one picture grows with the focal length: an object twice as large in the picture is half as far,
    /// or seen with twice the focal length. Without a training camera there is nothing to correct for.
    #[must_use]
    pub fn from_focal_lengths(
        encoding: Encoding,
        training_fx_px: Option<f64>,
        input_fx_px: Option<f64>,
    ) -> Self {
        if !encoding.is_metric() {
            return Self {
                units: Units::Relative,
                source: ScaleSource::Relative,
                focal_factor: 1.0,
            };
        }
        let (source, factor) = match (training_fx_px, input_fx_px) {
            (Some(training), Some(input)) => (ScaleSource::FocalScaled, input / training),
            (Some(_), None) => (ScaleSource::AssumedCamera, 1.0),
            (None, _) => (ScaleSource::Metric, 1.0),
        };
        Self {
            units: Units::Metre,
            source,
            focal_factor: factor as f32,
        }
    }

    /// The scale of a network's depth taken as it is, whatever the camera (`--focal off`).
    #[must_use]
    pub fn unscaled(encoding: Encoding) -> Self {
        Self::from_focal_lengths(encoding, None, None)
    }
}

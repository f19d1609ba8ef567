//! The unit of a depth map, and where its scale comes from.

use nunet_types::{ScaleSource, Units};

use super::DepthEncoding;

/// How a network's depth is scaled.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// The unit of the depth map.
    pub units: Units,
    /// The source of its scale.
    pub source: ScaleSource,
    /// The factor by which the network's meters are multiplied.
    pub factor: f32,
    /// Nanoseconds since the factor was measured; 0 for one that does not change.
    pub age_nanos: i64,
}

impl Scale {
    /// The scale of a network's depth from the focal lengths of both cameras, in pixels at the network's
    /// size.
    ///
    /// Depth from one image grows with the focal length: an object that is twice as large in the image is
    /// half as far, or seen with twice the focal length. Without a training camera nothing is corrected.
    #[must_use]
    pub fn from_focal_lengths(
        encoding: DepthEncoding,
        training_fx_px: Option<f64>,
        input_fx_px: Option<f64>,
    ) -> Self {
        if !encoding.is_metric() {
            return Self { units: Units::Relative, source: ScaleSource::Relative, factor: 1.0, age_nanos: 0 };
        }
        let (source, factor) = match (training_fx_px, input_fx_px) {
            (Some(training), Some(input)) => (ScaleSource::FocalScaled, input / training),
            (Some(_), None) => (ScaleSource::AssumedCamera, 1.0),
            (None, _) => (ScaleSource::Metric, 1.0),
        };
        Self { units: Units::Metre, source, factor: factor as f32, age_nanos: 0 }
    }

    /// The scale with a calibrated factor. Depth without a unit stays without one.
    #[must_use]
    pub fn calibrated(encoding: DepthEncoding, factor: f32) -> Self {
        match Self::unscaled(encoding) {
            scale if scale.units == Units::Metre => Self { source: ScaleSource::Calibrated, factor, ..scale },
            relative => relative,
        }
    }

    /// The scale of a network's depth without correction for the focal length.
    #[must_use]
    pub fn unscaled(encoding: DepthEncoding) -> Self {
        Self::from_focal_lengths(encoding, None, None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn twice_the_focal_length_is_twice_the_depth() {
        let scale = Scale::from_focal_lengths(DepthEncoding::Inverse, Some(500.0), Some(1000.0));
        assert_eq!(
            scale,
            Scale { units: Units::Metre, source: ScaleSource::FocalScaled, factor: 2.0, age_nanos: 0 }
        );
    }

    #[test]
    fn an_unknown_camera_is_assumed_to_be_the_training_camera() {
        let scale = Scale::from_focal_lengths(DepthEncoding::Metric, Some(500.0), None);
        assert_eq!((scale.source, scale.factor), (ScaleSource::AssumedCamera, 1.0));
    }

    #[test]
    fn a_network_without_a_unit_is_never_called_meters() {
        for encoding in [DepthEncoding::Relative, DepthEncoding::RelativeInverse, DepthEncoding::MinMax] {
            let scale = Scale::from_focal_lengths(encoding, Some(500.0), Some(1000.0));
            assert_eq!(
                scale,
                Scale { units: Units::Relative, source: ScaleSource::Relative, factor: 1.0, age_nanos: 0 }
            );
        }
    }

    #[test]
    fn without_scaling_the_networks_meters_are_unchanged() {
        let scale = Scale::unscaled(DepthEncoding::Log);
        assert_eq!((scale.units, scale.source), (Units::Metre, ScaleSource::Metric));
    }
}

//! True depth in files: integers with a unit, or meters.

use std::path::Path;

use nunet_source::{Rotation, SingleChannelImage, SourceError, decode_numbers};
use nunet_types::ImageSize;

use crate::npy_file;
use crate::options::DepthUnits;

/// Endings of depth: integers, or meters as float32.
pub(super) const ENDINGS: [&str; 2] = ["png", METERS];
const METERS: &str = "npy";
const MILLIMETER_M: f64 = 0.001;
/// The value for no measurement in 16-bit images of some sensors, besides 0. 7-Scenes has both.
const NO_DEPTH: u16 = u16::MAX;

/// The content of a file with depth.
pub(super) enum DepthFile {
    /// Values with a unit that the file does not state.
    Integers(SingleChannelImage),
    /// Meters.
    Meters(Vec<f32>, ImageSize),
}

/// Why the depth in a file has no meters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum UnitError {
    /// Integers of 8 bits without a unit.
    Unknown,
    /// A unit for depth that is in meters already.
    Fixed,
}

impl DepthFile {
    pub(super) fn read(path: &Path) -> Result<Self, SourceError> {
        if !path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case(METERS)) {
            return decode_numbers(path).map(Self::Integers);
        }
        let read = npy_file::read(path).map(|(meters, size)| Self::Meters(meters, size));
        read.map_err(|error| {
            SourceError::bad_frame("it is not a depth map")
                .with_hint("store depth as float32 (H, W), in meters")
                .with_cause(error)
        })
    }

    pub(super) fn size(&self) -> ImageSize {
        match self {
            Self::Integers(image) => image.size,
            Self::Meters(_, size) => *size,
        }
    }

    pub(super) fn rotated(self, rotation: Rotation) -> Self {
        match self {
            Self::Integers(image) => Self::Integers(image.rotated(rotation)),
            Self::Meters(meters, size) => Self::Meters(rotation.values(size, &meters), rotation.size(size)),
        }
    }

    /// Whether it is in meters.
    pub(super) fn is_meters(&self) -> bool {
        matches!(self, Self::Meters(..))
    }

    /// Meters, NaN = none.
    pub(super) fn meters(self, units: DepthUnits) -> Result<Vec<f32>, UnitError> {
        match self {
            Self::Integers(image) => scaled(&image, units).ok_or(UnitError::Unknown),
            Self::Meters(..) if units.are_stated() => Err(UnitError::Fixed),
            Self::Meters(mut meters, _) => {
                let is_none = |meters: &f32| !meters.is_finite() || *meters <= 0.0;
                meters.iter_mut().filter(|meters| is_none(meters)).for_each(|meters| *meters = f32::NAN);
                Ok(meters)
            }
        }
    }
}

/// `(value + offset) * scale`, NaN = none. `None` if the unit is not known.
fn scaled(depth: &SingleChannelImage, units: DepthUnits) -> Option<Vec<f32>> {
    let scale = units.scale.or((depth.bits == 16).then_some(MILLIMETER_M))?;
    let zero_is_none = units.offset == 0.0;
    let is_none = |value: u16| (value == 0 && zero_is_none) || value == NO_DEPTH;
    let meters = |value: u16| ((f64::from(value) + units.offset) * scale) as f32;
    Some(depth.values.iter().map(|&value| if is_none(value) { f32::NAN } else { meters(value) }).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn integers(bits: u8) -> DepthFile {
        DepthFile::Integers(SingleChannelImage { size: (3, 1).into(), values: vec![0, 1500, 65535], bits })
    }

    #[test]
    fn no_depth_is_0_unless_there_is_an_offset_and_65535_always() {
        let meters = |offset| integers(16).meters(DepthUnits { scale: None, offset }).unwrap();
        let millimeters = meters(0.0);
        assert!(
            millimeters[0].is_nan() && millimeters[1] == 1.5 && millimeters[2].is_nan(),
            "{millimeters:?}"
        );
        let offset = meters(500.0);
        assert!(offset[0] == 0.5 && offset[1] == 2.0 && offset[2].is_nan(), "{offset:?}");
    }

    #[test]
    fn eight_bits_need_a_scale() {
        assert_eq!(integers(8).meters(DepthUnits::default()), Err(UnitError::Unknown));
        let units = DepthUnits { scale: Some(0.1), offset: 0.0 };
        assert_eq!(integers(8).meters(units).unwrap()[1], 150.0);
    }

    #[test]
    fn meters_are_rotated_as_integers_are() {
        let rotated = DepthFile::Meters(vec![1.0, 2.0], (2, 1).into()).rotated(Rotation::ThreeQuarters);
        assert_eq!(
            (rotated.size(), rotated.meters(DepthUnits::default()).unwrap()),
            ((1, 2).into(), vec![2.0, 1.0])
        );
    }

    #[test]
    fn meters_have_no_other_unit_and_no_limit() {
        let values = vec![70.0, 0.0, -1.0, f32::INFINITY, f32::NAN, 5000.0];
        let meters = |units| DepthFile::Meters(values.clone(), (3, 2).into()).meters(units);
        let found = meters(DepthUnits::default()).unwrap();
        assert_eq!((found[0], found[5]), (70.0, 5000.0));
        assert!(found[1..5].iter().all(|meters| meters.is_nan()), "{found:?}");
        for (scale, offset) in [(Some(0.001), 0.0), (None, 1.0)] {
            assert_eq!(meters(DepthUnits { scale, offset }), Err(UnitError::Fixed));
        }
    }
}

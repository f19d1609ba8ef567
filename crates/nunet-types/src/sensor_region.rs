//! The part of its sensor that a camera delivers.

use std::error::Error;
use std::fmt;

use crate::error_kind::TypesErrorKind;
use crate::image_size::ImageSize;

/// The part of its sensor that a camera delivers: `binning_x`, `binning_y` and `roi` of ROS's
/// `sensor_msgs/CameraInfo`. Zeros mean the whole sensor and no binning.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SensorRegion {
    /// The first column, pixels of the sensor.
    pub x_offset: u32,
    /// The first row, pixels of the sensor.
    pub y_offset: u32,
    /// Pixels of the sensor.
    pub width: u32,
    /// Pixels of the sensor.
    pub height: u32,
    /// Columns of the sensor that make one of the image.
    pub binning_x: u32,
    /// Rows of the sensor that make one of the image.
    pub binning_y: u32,
}

impl SensorRegion {
    /// From `[fx, skew, cx, fy, cy]` of the whole sensor of `size` to the size and the same numbers of the
    /// images.
    ///
    /// The middle of a block of pixels becomes the middle of a pixel. (ROS's `image_geometry` only divides,
    /// which is off by less than half a pixel.)
    ///
    /// # Errors
    /// A region that is not within the sensor.
    pub fn captured(
        &self,
        size: ImageSize,
        [fx, skew, cx, fy, cy]: [f64; 5],
    ) -> Result<(ImageSize, [f64; 5]), RegionOutside> {
        let outside = RegionOutside { region: *self, size };
        let x = RegionAxis::new(size.width, self.x_offset, self.width, self.binning_x).ok_or(outside)?;
        let y = RegionAxis::new(size.height, self.y_offset, self.height, self.binning_y).ok_or(outside)?;
        let numbers = [fx / x.binning, skew / x.binning, x.center(cx), fy / y.binning, y.center(cy)];
        Ok((ImageSize::new(x.pixels, y.pixels), numbers))
    }
}

/// A region of interest that is not within its sensor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RegionOutside {
    /// The region.
    pub region: SensorRegion,
    /// The size of the sensor.
    pub size: ImageSize,
}

impl RegionOutside {
    /// [`TypesErrorKind::Camera`].
    #[must_use]
    pub const fn kind(&self) -> TypesErrorKind {
        TypesErrorKind::Camera
    }
}

impl fmt::Display for RegionOutside {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { region: SensorRegion { x_offset, y_offset, width, height, .. }, size } = self;
        write!(
            f,
            "its region of interest of {width}x{height} pixels from column {x_offset} and row {y_offset} on is not \
             within the sensor's {size}"
        )
    }
}

impl Error for RegionOutside {}

/// Width or height of a region.
struct RegionAxis {
    offset: f64,
    binning: f64,
    /// Of the image.
    pixels: u32,
}

impl RegionAxis {
    /// `None` for a region that reaches beyond the sensor.
    fn new(sensor: u32, offset: u32, size: u32, binning: u32) -> Option<Self> {
        let size = if (offset, size) == (0, 0) { sensor } else { size };
        let binning = binning.max(1);
        let within = (size > 0 || sensor == 0) && offset.checked_add(size)? <= sensor;
        within.then(|| Self { offset: offset.into(), binning: binning.into(), pixels: size / binning })
    }

    fn center(&self, pixels: f64) -> f64 {
        let within = pixels - self.offset;
        // Not the same to the last bit, and almost nobody bins.
        if self.binning > 1.0 { (within + 0.5) / self.binning - 0.5 } else { within }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SENSOR: ImageSize = ImageSize { width: 640, height: 480 };
    const NUMBERS: [f64; 5] = [500.0, 1.0, 320.0, 510.0, 240.0];
    const REGION: SensorRegion =
        SensorRegion { x_offset: 200, y_offset: 100, width: 320, height: 240, binning_x: 0, binning_y: 0 };

    #[test]
    fn a_region_moves_the_principal_point() {
        let expected = (ImageSize::new(320, 240), [500.0, 1.0, 120.0, 510.0, 140.0]);
        assert_eq!(REGION.captured(SENSOR, NUMBERS), Ok(expected));
    }

    #[test]
    fn binning_makes_one_pixel_of_a_block_of_the_region() {
        let with_binning = SensorRegion { binning_x: 2, binning_y: 4, ..REGION };
        let numbers = [250.0, 0.5, 120.5 / 2.0 - 0.5, 127.5, 140.5 / 4.0 - 0.5];
        assert_eq!(with_binning.captured(SENSOR, NUMBERS), Ok((ImageSize::new(160, 60), numbers)));
    }

    #[test]
    fn zeros_are_the_whole_sensor_on_either_side() {
        assert_eq!(SensorRegion::default().captured(SENSOR, NUMBERS), Ok((SENSOR, NUMBERS)));
        let wide = SensorRegion { x_offset: 0, width: 0, ..REGION };
        let numbers = [500.0, 1.0, 320.0, 510.0, 140.0];
        assert_eq!(wide.captured(SENSOR, NUMBERS), Ok((ImageSize::new(640, 240), numbers)));
    }

    #[test]
    fn a_region_beyond_the_sensor_is_refused() {
        for region in [
            SensorRegion { x_offset: 321, ..REGION },
            SensorRegion { height: 0, ..REGION },
            SensorRegion { height: 381, ..REGION },
            SensorRegion { y_offset: u32::MAX, ..REGION },
        ] {
            let error = region.captured(SENSOR, NUMBERS).unwrap_err();
            assert_eq!(error, RegionOutside { region, size: SENSOR });
            assert_eq!(error.kind(), TypesErrorKind::Camera);
        }
    }
}

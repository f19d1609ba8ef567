//! PNG files.

use std::path::Path;

use image::{DynamicImage, ImageBuffer, Luma, RgbImage};
use nunet_types::ImageSize;

use crate::error::{Cause, FilesError};
use crate::whole::write_png;

/// Writes 16-bit millimeters, 0 = no measurement. Depth beyond 65.535 m does not fit and counts as no
/// measurement.
///
/// # Errors
/// The file cannot be written, or `depth_m` has another number of pixels than `size`.
pub fn write_depth_mm(path: &Path, depth_m: &[f32], size: ImageSize) -> Result<(), FilesError> {
    write_gray(path, depth_m.iter().map(|&z| millimeters(z)).collect::<Vec<u16>>(), size)
}

/// Depth in millimeters, rounded; 0 where there is no measurement, and beyond 65.535 m.
#[must_use]
pub fn millimeters(depth_m: f32) -> u16 {
    let rounded = (depth_m * 1000.0).round();
    if (1.0..=f32::from(u16::MAX)).contains(&rounded) { rounded as u16 } else { 0 }
}

/// Writes 8 or 16 bits per pixel.
pub(crate) fn write_gray<T>(path: &Path, values: Vec<T>, size: ImageSize) -> Result<(), FilesError>
where
    T: image::Primitive,
    DynamicImage: From<ImageBuffer<Luma<T>, Vec<T>>>,
{
    check_count(values.len(), size).map_err(FilesError::write_file(path))?;
    let image = ImageBuffer::<Luma<T>, Vec<T>>::from_raw(size.width, size.height, values);
    image.map_or(Ok(()), |image| write_png(path, image))
}

/// Writes colors.
///
/// # Errors
/// The file cannot be written.
pub fn write_rgb(path: &Path, image: RgbImage) -> Result<(), FilesError> {
    write_png(path, image)
}

/// Whether there is one value per pixel.
pub(crate) fn check_count(count: usize, size: ImageSize) -> Result<(), Cause> {
    if count != size.pixel_count() {
        return Err(format!("{count} values for {size} pixels").into());
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn millimeters_are_rounded_and_what_does_not_fit_is_none() {
        let expected = [(1.0, 1000), (0.0126, 13), (65.535, 65535), (65.6, 0), (-1.0, 0), (0.0, 0)];
        for (depth_m, mm) in expected {
            assert_eq!(millimeters(depth_m), mm, "{depth_m} m");
        }
        assert_eq!(millimeters(f32::NAN), 0);
        assert_eq!(millimeters(f32::INFINITY), 0);
    }
}

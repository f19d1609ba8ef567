//! PNG files.

use std::path::Path;

use anyhow::Context as _;
use image::{GrayImage, ImageBuffer, Luma, RgbImage};

/// 16-bit millimetres, 0 = no measurement. Depth beyond 65.535 m does not fit and is no measurement either.
pub(crate) fn write_depth_mm(
    path: &Path,
    depth_m: &[f32],
    (width, height): (u32, u32),
) -> anyhow::Result<()> {
    let millimetres = depth_m.iter().map(|&z| millimetres(z)).collect();
    let picture: ImageBuffer<Luma<u16>, Vec<u16>> =
        ImageBuffer::from_raw(width, height, millimetres).context("depth does not fill the picture")?;
    Ok(picture.save(path)?)
}

fn millimetres(depth_m: f32) -> u16 {
    let rounded = (depth_m * 1000.0).round();
    if (1.0..=f32::from(u16::MAX)).contains(&rounded) { rounded as u16 } else { 0 }
}

/// 8-bit class indices.
pub(super) fn write_gray(path: &Path, values: &[u8], (width, height): (u32, u32)) -> anyhow::Result<()> {
    let picture =
        GrayImage::from_raw(width, height, values.to_vec()).context("labels do not fill the picture")?;
    Ok(picture.save(path)?)
}

/// Colors.
pub(super) fn write_rgb(path: &Path, picture: &RgbImage) -> anyhow::Result<()> {
    Ok(picture.save(path)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn millimetres_are_rounded_and_what_does_not_fit_is_none() {
        let expected = [(1.0, 1000), (0.0126, 13), (65.535, 65535), (65.6, 0), (-1.0, 0), (0.0, 0)];
        for (depth_m, mm) in expected {
            assert_eq!(millimetres(depth_m), mm, "{depth_m} m");
        }
        assert_eq!(millimetres(f32::NAN), 0);
        assert_eq!(millimetres(f32::INFINITY), 0);
    }
}

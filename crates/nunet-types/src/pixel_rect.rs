//! A rectangle of whole pixels.

use std::fmt;

use crate::image_size::ImageSize;

/// A rectangle of whole pixels in an image. Displayed as `960x720 at (160, 0)`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct PixelRect {
    /// The first column.
    pub x: u32,
    /// The first row.
    pub y: u32,
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl PixelRect {
    /// All of an image.
    #[must_use]
    pub const fn whole(ImageSize { width, height }: ImageSize) -> Self {
        Self { x: 0, y: 0, width, height }
    }

    /// The largest part of `image` with the aspect ratio of `shape`, rounded to whole pixels and at least one
    /// pixel wide and high. It is in the center, or half a pixel left of it or above it. No side is 0.
    #[must_use]
    pub fn centered(image: ImageSize, shape: ImageSize) -> Self {
        let fitted = |side: u32, numerator: u32, denominator: u32, limit: u32| {
            let exact = f64::from(side) * f64::from(numerator) / f64::from(denominator);
            (exact.round() as u32).clamp(1, limit)
        };
        let is_wider = u64::from(image.width) * u64::from(shape.height)
            > u64::from(shape.width) * u64::from(image.height);
        let (width, height) = if is_wider {
            (fitted(image.height, shape.width, shape.height, image.width), image.height)
        } else {
            (image.width, fitted(image.width, shape.height, shape.width, image.height))
        };
        Self { x: (image.width - width) / 2, y: (image.height - height) / 2, width, height }
    }

    /// Width and height.
    #[must_use]
    pub const fn size(&self) -> ImageSize {
        ImageSize::new(self.width, self.height)
    }
}

impl fmt::Display for PixelRect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} at ({}, {})", self.size(), self.x, self.y)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn centered(image: (u32, u32), shape: (u32, u32)) -> (u32, u32, u32, u32) {
        let PixelRect { x, y, width, height } = PixelRect::centered(image.into(), shape.into());
        (x, y, width, height)
    }

    #[test]
    fn the_centered_part_has_the_other_aspect_ratio() {
        assert_eq!(centered((1280, 720), (640, 480)), (160, 0, 960, 720));
        assert_eq!(centered((480, 640), (640, 480)), (0, 140, 480, 360));
        assert_eq!(centered((640, 480), (1280, 720)), (0, 60, 640, 360));
        assert_eq!(centered((80, 640), (640, 480)), (0, 290, 80, 60));
    }

    #[test]
    fn odd_sizes_are_rounded_and_never_empty() {
        assert_eq!(centered((641, 361), (640, 480)), (80, 0, 481, 361), "481.33 columns");
        assert_eq!(centered((1, 32_768), (640, 480)), (0, 16_383, 1, 1));
        assert_eq!(centered((640, 480), (1, 32_768)), (319, 0, 1, 480));
        assert_eq!(centered((640, 480), (640, 480)), (0, 0, 640, 480));
    }
}

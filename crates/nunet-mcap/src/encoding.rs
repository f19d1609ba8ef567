//! The pixel layouts of recorded images.

/// The pattern of a Bayer mosaic: the first two pixels of the first row, then those of the second.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BayerPattern {
    /// Red first.
    Rggb,
    /// Blue first.
    Bggr,
    /// Green first, then blue.
    Gbrg,
    /// Green first, then red.
    Grbg,
}

/// The pixel layout of a recorded image. Numbers of 16 and 32 bits are little-endian.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ImageEncoding {
    /// A JPEG or PNG file.
    File,
    /// A JPEG or PNG file of one channel, behind a color filter.
    BayerFile(BayerPattern),
    /// Three bytes a pixel: red, green, blue.
    Rgb8,
    /// Three bytes a pixel: blue, green, red.
    Bgr8,
    /// Four bytes a pixel: red, green, blue, alpha.
    Rgba8,
    /// Four bytes a pixel: blue, green, red, alpha.
    Bgra8,
    /// Three 16-bit numbers a pixel: red, green, blue.
    Rgb16,
    /// Three 16-bit numbers a pixel: blue, green, red.
    Bgr16,
    /// Four 16-bit numbers a pixel: red, green, blue, alpha.
    Rgba16,
    /// Four 16-bit numbers a pixel: blue, green, red, alpha.
    Bgra16,
    /// One byte a pixel.
    Mono8,
    /// One 16-bit number a pixel.
    Mono16,
    /// One byte a pixel, behind a color filter.
    Bayer8(BayerPattern),
    /// One 16-bit number a pixel, behind a color filter.
    Bayer16(BayerPattern),
    /// Two pixels in four bytes: Y, U, Y, V.
    Yuyv,
    /// Two pixels in four bytes: U, Y, V, Y.
    Uyvy,
    /// A plane of Y, then one of U and V in turn, half as high and wide; both with the same stride.
    Nv12,
    /// As [`Nv12`](Self::Nv12), V first.
    Nv21,
    /// A plane of Y, then one of U and one of V, half as high and wide, with half the stride.
    I420,
    /// As [`I420`](Self::I420), V first.
    Yv12,
    /// Depth: `f32` meters, NaN or 0 = none (ROS' 32FC1, REP 118).
    DepthMeters,
    /// Depth: `u16` millimeters, 0 = none (ROS' 16UC1, REP 118).
    DepthMillimeters,
}

/// The readable encodings, for messages.
pub(crate) const READABLE: &str = "rgb8, bgr8, rgba8, bgra8, rgb16, bgr16, mono8, mono16, bayer_*8, bayer_*16, yuv422 (uyvy), \
                                   yuv422_yuy2 (yuyv), nv12, nv21, i420 or yv12";

impl ImageEncoding {
    /// Whether the numbers are depth.
    #[must_use]
    pub fn is_depth(self) -> bool {
        matches!(self, Self::DepthMeters | Self::DepthMillimeters)
    }

    /// The encoding by its name in a message of ROS (`sensor_msgs/image_encodings.hpp`) or Foxglove, in any
    /// case.
    pub(crate) fn named(name: &str) -> Option<Self> {
        Some(match name.to_ascii_lowercase().as_str() {
            "rgb8" | "rgb" => Self::Rgb8,
            "bgr8" | "bgr" | "8uc3" => Self::Bgr8,
            "rgba8" | "rgba" => Self::Rgba8,
            "bgra8" | "bgra" | "8uc4" => Self::Bgra8,
            "rgb16" => Self::Rgb16,
            "bgr16" | "16uc3" => Self::Bgr16,
            "rgba16" => Self::Rgba16,
            "bgra16" | "16uc4" => Self::Bgra16,
            "mono8" | "8uc1" | "y8" | "grey" | "gray" => Self::Mono8,
            "mono16" | "y16" => Self::Mono16,
            "yuv422_yuy2" | "yuyv" | "yuy2" => Self::Yuyv,
            "yuv422" | "uyvy" => Self::Uyvy,
            "nv12" => Self::Nv12,
            "nv21" => Self::Nv21,
            "i420" | "yu12" | "yuv420" => Self::I420,
            "yv12" => Self::Yv12,
            "32fc1" => Self::DepthMeters,
            "16uc1" => Self::DepthMillimeters,
            other => return Self::bayer(other),
        })
    }

    /// `bayer_rggb8`, `bayer_gbrg16` and so on.
    fn bayer(name: &str) -> Option<Self> {
        let (pattern, bits) = name.strip_prefix("bayer_")?.split_at_checked(4)?;
        let pattern = match pattern {
            "rggb" => BayerPattern::Rggb,
            "bggr" => BayerPattern::Bggr,
            "gbrg" => BayerPattern::Gbrg,
            "grbg" => BayerPattern::Grbg,
            _ => return None,
        };
        match bits {
            "8" => Some(Self::Bayer8(pattern)),
            "16" => Some(Self::Bayer16(pattern)),
            _ => None,
        }
    }

    /// Bytes of one row without padding, in the first plane.
    pub(crate) fn row_bytes(self, width: u32) -> u64 {
        let width = u64::from(width);
        match self {
            Self::File | Self::BayerFile(_) => 0,
            Self::Mono8 | Self::Bayer8(_) => width,
            Self::Nv12 | Self::Nv21 | Self::I420 | Self::Yv12 => width,
            Self::Yuyv | Self::Uyvy => 2 * width,
            Self::Mono16 | Self::Bayer16(_) | Self::DepthMillimeters => 2 * width,
            Self::Rgb8 | Self::Bgr8 => 3 * width,
            Self::Rgba8 | Self::Bgra8 | Self::DepthMeters => 4 * width,
            Self::Rgb16 | Self::Bgr16 => 6 * width,
            Self::Rgba16 | Self::Bgra16 => 8 * width,
        }
    }

    /// Bytes of an image whose rows begin `step` bytes apart. Planes of color of an odd height round up.
    pub(crate) fn image_bytes(self, height: u32, step: u32) -> u64 {
        let (rows, step) = (u64::from(height), u64::from(step));
        match self {
            Self::Nv12 | Self::Nv21 => step * (rows + rows.div_ceil(2)),
            Self::I420 | Self::Yv12 => step * rows + 2 * step.div_ceil(2) * rows.div_ceil(2),
            _ => step * rows,
        }
    }

    /// Bytes of one number.
    pub(crate) fn number_bytes(self) -> usize {
        match self {
            Self::DepthMeters => 4,
            Self::Rgb16 | Self::Bgr16 | Self::Rgba16 | Self::Bgra16 | Self::Mono16 | Self::Bayer16(_) => 2,
            Self::DepthMillimeters => 2,
            _ => 1,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_ros_and_foxglove_are_known_in_any_case() {
        assert_eq!(ImageEncoding::named("BGR8"), Some(ImageEncoding::Bgr8));
        assert_eq!(ImageEncoding::named("16UC1"), Some(ImageEncoding::DepthMillimeters));
        assert_eq!(ImageEncoding::named("bayer_grbg16"), Some(ImageEncoding::Bayer16(BayerPattern::Grbg)));
        for unknown in ["", "bayer_rggb12", "bayer_xxxx8", "bayer_", "32FC2", "nv24"] {
            assert_eq!(ImageEncoding::named(unknown), None, "{unknown}");
        }
    }
}

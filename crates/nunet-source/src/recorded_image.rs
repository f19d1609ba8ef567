//! Images of ROS 2 and Foxglove, recorded or live, as frames.

use nunet_core::camera::{Calibration, Camera, RosCameraInfo};
use nunet_core::frame::PixelFormat;
use nunet_mcap::{BayerPattern, CameraDescription, ImageEncoding, RecordedImage};
use nunet_types::{ImageSize, SensorRegion};
use tracing::warn;

use crate::bit_depth::BitDepthCheck;
use crate::convert::{self, Bayer, RawImageView, RawLayout};
use crate::error::SourceError;
use crate::orientation::oriented_camera;
use crate::{Frame, decode_file};

/// Orientation of an image that was not turned.
const UPRIGHT: image::metadata::Orientation = image::metadata::Orientation::NoTransforms;

/// Turns the images of a topic into frames.
#[derive(Default)]
pub(crate) struct ImageConverter {
    cameras: CameraCache,
    bit_depth: BitDepthCheck,
}

impl ImageConverter {
    /// Fills the image of a frame, and its camera if it is `described`. The memory of `image` may be swapped.
    pub(crate) fn fill(
        &mut self,
        frame: &mut Frame,
        image: &mut RecordedImage,
        topic: &str,
        described: Option<&CameraDescription>,
    ) -> Result<(), SourceError> {
        let mut orientation = UPRIGHT;
        if image.encoding == Some(ImageEncoding::File) {
            std::mem::swap(&mut frame.file, &mut image.data);
            orientation = decode_file(frame)?;
        } else {
            frame.file.clear();
            let layout = layout(image.encoding).ok_or_else(|| {
                SourceError::bad_frame(format!("topic `{topic}` carries depth"))
                    .with_hint("name a topic with images")
            })?;
            let size = ImageSize::new(image.width, image.height);
            let raw = RawImageView { layout, size, row_stride: image.row_stride, bytes: &image.data };
            if let Some(maximum) = self.bit_depth.dim_maximum(&raw) {
                let hint = "scale the values to 16 bits before recording: 10 bits by 64, 12 bits by 16";
                warn!(
                    hint,
                    "the 16-bit images on topic `{topic}` are almost black: at most {maximum} of 65535"
                );
            }
            if !convert::fill(frame, raw) {
                return Err(SourceError::bad_frame(format!("an image on topic `{topic}` has too few bytes")));
            }
        }
        frame.camera = self.cameras.camera(topic, described, frame.size, orientation);
        Ok(())
    }
}

/// The camera of a topic, computed when its description changes.
#[derive(Default)]
struct CameraCache {
    made_of: Option<(CameraDescription, ImageSize, u8)>,
    camera: Option<Camera>,
}

impl CameraCache {
    /// The camera at the image's size. One that makes no sense is reported once and not used.
    fn camera(
        &mut self,
        topic: &str,
        described: Option<&CameraDescription>,
        size: ImageSize,
        orientation: image::metadata::Orientation,
    ) -> Option<Camera> {
        let described = described?;
        let is_same = |(made_of, its_size, its_turn): &(CameraDescription, ImageSize, u8)| {
            made_of == described && *its_size == size && *its_turn == orientation.to_exif()
        };
        if !self.made_of.as_ref().is_some_and(is_same) {
            self.made_of = Some((described.clone(), size, orientation.to_exif()));
            self.camera = camera(described, size, orientation)
                .inspect_err(|error| {
                    warn!("the camera of topic `{topic}` is not used: {error}");
                })
                .ok();
        }
        self.camera
    }
}

/// `None` for depth and for a file that is to be decoded.
fn layout(encoding: Option<ImageEncoding>) -> Option<RawLayout> {
    let channels = |format, channels, bytes| Some(RawLayout::Channels { format, channels, bytes });
    let bayer = |pattern| match pattern {
        BayerPattern::Rggb => Bayer::RGGB,
        BayerPattern::Bggr => Bayer::BGGR,
        BayerPattern::Gbrg => Bayer::GBRG,
        BayerPattern::Grbg => Bayer::GRBG,
    };
    match encoding? {
        ImageEncoding::Rgb8 => Some(RawLayout::Direct(PixelFormat::Rgb8)),
        ImageEncoding::Bgr8 => Some(RawLayout::Direct(PixelFormat::Bgr8)),
        ImageEncoding::Mono8 => Some(RawLayout::Direct(PixelFormat::Mono8)),
        ImageEncoding::Yuyv => Some(RawLayout::Direct(PixelFormat::Yuyv)),
        ImageEncoding::Nv12 => Some(RawLayout::Direct(PixelFormat::Nv12)),
        ImageEncoding::Rgba8 => channels(PixelFormat::Rgb8, 4, 1),
        ImageEncoding::Bgra8 => channels(PixelFormat::Bgr8, 4, 1),
        ImageEncoding::Rgb16 => channels(PixelFormat::Rgb8, 3, 2),
        ImageEncoding::Bgr16 => channels(PixelFormat::Bgr8, 3, 2),
        ImageEncoding::Rgba16 => channels(PixelFormat::Rgb8, 4, 2),
        ImageEncoding::Bgra16 => channels(PixelFormat::Bgr8, 4, 2),
        ImageEncoding::Mono16 => channels(PixelFormat::Mono8, 1, 2),
        ImageEncoding::Uyvy => Some(RawLayout::Uyvy),
        ImageEncoding::Nv21 => Some(RawLayout::Nv21),
        ImageEncoding::I420 => Some(RawLayout::Planes { v_first: false }),
        ImageEncoding::Yv12 => Some(RawLayout::Planes { v_first: true }),
        ImageEncoding::Bayer8(pattern) => Some(RawLayout::Mosaic { pattern: bayer(pattern), bytes: 1 }),
        ImageEncoding::Bayer16(pattern) => Some(RawLayout::Mosaic { pattern: bayer(pattern), bytes: 2 }),
        _ => None,
    }
}

/// The camera of an image of `size` that was turned as `orientation` states. The description is of the image
/// before.
fn camera(
    described: &CameraDescription,
    size: ImageSize,
    orientation: image::metadata::Orientation,
) -> Result<Camera, String> {
    if let Some(fault) = &described.fault {
        return Err(fault.clone());
    }
    let [fx, fy, cx, cy] = described.intrinsics;
    // Four zeros of a fisheye are an ideal fisheye, not a pinhole.
    let straight = described.coefficients.iter().all(|&coefficient| coefficient == 0.0);
    let is_pinhole = described.coefficients.is_empty() || (straight && !described.is_fisheye());
    let (distortion_model, d): (&str, &[f64]) =
        if is_pinhole { ("", &[]) } else { (&described.distortion_model, &described.coefficients) };
    let k = [fx, described.skew, cx, 0.0, fy, cy, 0.0, 0.0, 1.0];
    let (width, height, region) = (described.width, described.height, SensorRegion::default());
    let info = RosCameraInfo { width, height, k: &k, distortion_model, d, region };
    let calibration = Calibration::from_ros(&info).map_err(|error| error.to_string())?;
    if let Some(skew) = calibration.ignored_skew() {
        warn!("{skew}");
    }
    if let Some(model) = calibration.assumed_model() {
        warn!("the camera names no distortion model: its {} coefficients are read as `{model}`", d.len());
    }
    let camera = oriented_camera(&calibration.camera(), orientation).map_err(|error| error.to_string())?;
    camera.fitted_to(size.width, size.height).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_without_a_distortion_model_has_the_one_of_its_coefficients() {
        let lens = |coefficients: &[f64]| {
            let described = CameraDescription {
                width: 640,
                height: 480,
                intrinsics: [500.0, 500.0, 320.0, 240.0],
                coefficients: coefficients.to_vec(),
                ..CameraDescription::default()
            };
            camera(&described, ImageSize::new(640, 480), UPRIGHT).map(|camera| camera.distortion.to_ros())
        };
        let (barrel, none) = ([-0.3, 0.1, 0.001, 0.0005, 0.02], ("plumb_bob", vec![0.0; 5]));
        assert_eq!(lens(&barrel), Ok(("plumb_bob", barrel.to_vec())));
        assert_eq!((lens(&[]), lens(&[0.0; 5])), (Ok(none.clone()), Ok(none)));
        assert!(lens(&[0.1; 3]).is_err());
    }

    #[test]
    fn a_contradictory_camera_is_ignored_with_a_warning() {
        let described = CameraDescription {
            width: 640,
            height: 480,
            intrinsics: [500.0, 500.0, 320.0, 240.0],
            ..CameraDescription::default()
        };
        assert_eq!(camera(&described, ImageSize::new(320, 240), UPRIGHT).unwrap().intrinsics.fx_px, 250.0);
        let faulty = CameraDescription { fault: Some("its region of interest is none".into()), ..described };
        let error = camera(&faulty, ImageSize::new(320, 240), UPRIGHT).unwrap_err();
        assert_eq!(error, "its region of interest is none");
    }
}

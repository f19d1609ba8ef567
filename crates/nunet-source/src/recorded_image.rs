//! Images of ROS 2 and Foxglove, recorded or live, as frames.

use image::metadata::Orientation;
use nunet_core::camera::{Calibration, Camera, Distortion, RosCalibration};
use nunet_core::frame::PixelFormat;
use nunet_mcap::{BayerPattern, CameraDescription, ImageEncoding, RecordedImage};
use nunet_types::{ImageSize, MAX_FRAME_ID, SensorRegion};
use tracing::warn;

use crate::Frame;
use crate::bit_depth::{self, BitDepthCheck};
use crate::convert::{self, Bayer, RawImageView, RawLayout};
use crate::error::SourceError;
use crate::image_file::{decode_file, decode_mosaic};
use crate::orientation::oriented_camera;

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
        if image.is_frame_id_changed {
            let why = format!("its name is not UTF-8, or longer than {MAX_FRAME_ID} bytes");
            self.cameras.report(topic, format!("its coordinate frame becomes `{}`: {why}", image.frame_id));
        }
        let orientation = match image.encoding {
            Some(ImageEncoding::File) => self.fill_from_file(frame, image, topic, None)?,
            Some(ImageEncoding::BayerFile(pattern)) => {
                self.fill_from_file(frame, image, topic, Some(bayer(pattern)))?
            }
            _ => self.fill_from_raw(frame, image, topic)?,
        };
        frame.camera = self.cameras.camera(topic, described, frame.size, orientation);
        Ok(())
    }

    fn fill_from_file(
        &mut self,
        frame: &mut Frame,
        image: &mut RecordedImage,
        topic: &str,
        mosaic: Option<Bayer>,
    ) -> Result<Orientation, SourceError> {
        std::mem::swap(&mut frame.file, &mut image.data);
        let decoded = match mosaic {
            Some(pattern) => decode_mosaic(frame, pattern)?,
            None => decode_file(frame)?,
        };
        self.bit_depth.check(|| decoded.maximum_16_bit, format_args!("topic `{topic}`"));
        Ok(decoded.orientation)
    }

    fn fill_from_raw(
        &mut self,
        frame: &mut Frame,
        image: &RecordedImage,
        topic: &str,
    ) -> Result<Orientation, SourceError> {
        frame.file.clear();
        let layout = layout(image.encoding).ok_or_else(|| {
            SourceError::bad_frame(format!("topic `{topic}` carries depth"))
                .with_hint("name a topic with images")
        })?;
        let size = ImageSize::new(image.width, image.height);
        let raw = RawImageView { layout, size, row_stride: image.row_stride, bytes: &image.data };
        self.bit_depth.check(|| bit_depth::maximum(&raw), format_args!("topic `{topic}`"));
        if !convert::fill(frame, raw) {
            return Err(SourceError::bad_frame(format!("an image on topic `{topic}` has too few bytes")));
        }
        Ok(Orientation::NoTransforms)
    }
}

/// The camera of a topic, computed when its description changes.
#[derive(Default)]
struct CameraCache {
    made_of: Option<(CameraDescription, ImageSize, u8)>,
    camera: Option<Camera>,
    /// What was reported: why cameras were not used, and what was ignored or assumed of the others.
    reported: Vec<String>,
}

/// The most reports: a faulty driver may cause another one with every image.
const MAX_REPORTS: usize = 8;

impl CameraCache {
    /// The camera at the image's size. One that makes no sense is not used. Each problem is reported once.
    fn camera(
        &mut self,
        topic: &str,
        described: Option<&CameraDescription>,
        size: ImageSize,
        orientation: Orientation,
    ) -> Option<Camera> {
        let described = described?;
        let is_same = |(made_of, its_size, its_turn): &(CameraDescription, ImageSize, u8)| {
            made_of == described && *its_size == size && *its_turn == orientation.to_exif()
        };
        if !self.made_of.as_ref().is_some_and(is_same) {
            self.made_of = Some((described.clone(), size, orientation.to_exif()));
            let mut notes = Vec::new();
            self.camera = match camera(described, size, orientation, &mut notes) {
                Ok(camera) => Some(camera),
                Err(reason) => {
                    notes.push(format!("it is not used: {reason}"));
                    None
                }
            };
            for note in notes {
                self.report(topic, note);
            }
        }
        self.camera
    }

    /// Logs what was not reported before. A description is no help: one with NaN differs from itself, and
    /// that of a camera with autofocus changes with every image.
    fn report(&mut self, topic: &str, note: String) {
        if self.reported.len() < MAX_REPORTS && !self.reported.contains(&note) {
            warn!("the camera of topic `{topic}`: {note}");
            self.reported.push(note);
        }
    }
}

fn bayer(pattern: BayerPattern) -> Bayer {
    match pattern {
        BayerPattern::Rggb => Bayer::RGGB,
        BayerPattern::Bggr => Bayer::BGGR,
        BayerPattern::Gbrg => Bayer::GBRG,
        BayerPattern::Grbg => Bayer::GRBG,
    }
}

/// `None` for depth and for a file that is to be decoded.
fn layout(encoding: Option<ImageEncoding>) -> Option<RawLayout> {
    let channels = |format, channels, bytes| Some(RawLayout::Channels { format, channels, bytes });
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
/// before. What of it is ignored or assumed is added to `notes`.
fn camera(
    described: &CameraDescription,
    size: ImageSize,
    orientation: Orientation,
    notes: &mut Vec<String>,
) -> Result<Camera, String> {
    if let Some(fault) = &described.fault {
        return Err(fault.clone());
    }
    let [fx, fy, cx, cy] = described.intrinsics;
    // Four zeros of a fisheye are an ideal fisheye, not a pinhole. Zeros of unknown models are a pinhole.
    let straight = described.coefficients.iter().all(|&coefficient| coefficient == 0.0);
    let is_empty = described.coefficients.is_empty();
    let is_pinhole = is_empty || (straight && !Distortion::zeros_distort(&described.distortion_model));
    let (distortion_model, d): (&str, &[f64]) =
        if is_pinhole { ("", &[]) } else { (&described.distortion_model, &described.coefficients) };
    let k = [fx, described.skew, cx, 0.0, fy, cy, 0.0, 0.0, 1.0];
    let (width, height, region) = (described.width, described.height, SensorRegion::default());
    let info = RosCalibration { width, height, k: &k, distortion_model, d, region };
    let calibration = Calibration::from_ros(&info).map_err(|error| error.to_string())?;
    notes.extend(calibration.ignored_skew().map(|skew| skew.to_string()));
    notes.extend(calibration.assumed_model().map(|model| {
        format!("it names no distortion model: its {} coefficients are read as `{model}`", d.len())
    }));
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
            camera(&described, ImageSize::new(640, 480), Orientation::NoTransforms, &mut Vec::new())
                .map(|camera| camera.distortion.to_ros())
        };
        let (barrel, none) = ([-0.3, 0.1, 0.001, 0.0005, 0.02], ("plumb_bob", vec![0.0; 5]));
        assert_eq!(lens(&barrel), Ok(("plumb_bob", barrel.to_vec())));
        assert_eq!((lens(&[]), lens(&[0.0; 5])), (Ok(none.clone()), Ok(none)));
        assert!(lens(&[0.1; 3]).is_err());
    }

    #[test]
    fn zeros_are_a_fisheye_by_all_of_its_names_and_otherwise_a_pinhole() {
        let lens = |name: &str| {
            let described = CameraDescription {
                width: 640,
                height: 480,
                intrinsics: [500.0, 500.0, 320.0, 240.0],
                distortion_model: name.to_owned(),
                coefficients: vec![0.0; 4],
                ..CameraDescription::default()
            };
            camera(&described, ImageSize::new(640, 480), Orientation::NoTransforms, &mut Vec::new())
                .map(|camera| camera.distortion)
        };
        for name in ["equidistant", "kannala_brandt", "fisheye"] {
            assert!(matches!(lens(name), Ok(Distortion::KannalaBrandt(_))), "{name}: {:?}", lens(name));
        }
        for name in ["plumb_bob", "rational_polynomial", "", "a model that nobody knows"] {
            assert_eq!(lens(name), Ok(Distortion::None), "{name}");
        }
    }

    #[test]
    fn a_contradictory_camera_is_ignored_with_a_warning() {
        let described = CameraDescription {
            width: 640,
            height: 480,
            intrinsics: [500.0, 500.0, 320.0, 240.0],
            ..CameraDescription::default()
        };
        let small = |described: &CameraDescription| {
            camera(described, ImageSize::new(320, 240), Orientation::NoTransforms, &mut Vec::new())
        };
        assert_eq!(small(&described).unwrap().intrinsics.fx_px, 250.0);
        let faulty = CameraDescription { fault: Some("its region of interest is none".into()), ..described };
        assert_eq!(small(&faulty).unwrap_err(), "its region of interest is none");
    }

    #[test]
    fn each_reason_not_to_use_a_camera_is_reported_once_and_not_for_every_image() {
        let mut cache = CameraCache::default();
        let mut reported = |fx_px: f64, fault: Option<String>| {
            let intrinsics = [fx_px, 500.0, 320.0, 240.0];
            let described = CameraDescription {
                width: 640,
                height: 480,
                intrinsics,
                fault,
                ..CameraDescription::default()
            };
            let is_good = described.fault.is_none() && fx_px.is_finite();
            for _image in 0..3 {
                let used =
                    cache.camera("/c", Some(&described), ImageSize::new(640, 480), Orientation::NoTransforms);
                assert_eq!(used.is_some(), is_good);
            }
            cache.reported.len()
        };
        let flips = [f64::NAN, 500.0, f64::NAN, 500.0, f64::INFINITY, f64::NAN];
        assert_eq!(flips.map(|fx_px| reported(fx_px, None)), [1, 1, 1, 1, 2, 2]);
        let last = (0..100).map(|fault| reported(500.0, Some(fault.to_string()))).last();
        assert_eq!(last, Some(MAX_REPORTS), "a driver cannot fill the log");
    }

    /// A camera with autofocus describes itself again with every image.
    #[test]
    fn what_is_assumed_of_a_camera_is_reported_once_and_not_for_every_description() {
        let mut cache = CameraCache::default();
        for image in 0..50 {
            let described = CameraDescription {
                width: 640,
                height: 480,
                intrinsics: [500.0 + f64::from(image), 500.0, 320.0, 240.0],
                coefficients: vec![-0.3, 0.1, 0.0, 0.0, 0.0],
                ..CameraDescription::default()
            };
            let size = ImageSize::new(640, 480);
            assert!(cache.camera("/c", Some(&described), size, Orientation::NoTransforms).is_some());
        }
        let expected = "it names no distortion model: its 5 coefficients are read as `plumb_bob`";
        assert_eq!(cache.reported, [expected]);
    }

    /// The frame of a PNG on a topic.
    fn frame_of(image: impl Into<image::DynamicImage>, encoding: ImageEncoding) -> Frame {
        let mut file = std::io::Cursor::new(Vec::new());
        image.into().write_to(&mut file, image::ImageFormat::Png).unwrap();
        let mut recorded =
            RecordedImage { data: file.into_inner(), encoding: Some(encoding), ..RecordedImage::default() };
        let mut frame = Frame::default();
        ImageConverter::default().fill(&mut frame, &mut recorded, "/c/image_raw/compressed", None).unwrap();
        frame
    }

    #[test]
    fn a_coordinate_frame_that_was_changed_is_reported_once() {
        let mut converter = ImageConverter::default();
        for sequence in 0..3 {
            let mut image = RecordedImage {
                data: vec![7],
                encoding: Some(ImageEncoding::Mono8),
                width: 1,
                height: 1,
                row_stride: 1,
                frame_id: "e\u{fffd}e".to_owned(),
                is_frame_id_changed: sequence > 0,
                ..RecordedImage::default()
            };
            converter.fill(&mut Frame::default(), &mut image, "/c", None).unwrap();
            assert_eq!(converter.cameras.reported.len(), usize::from(sequence > 0));
        }
    }

    #[test]
    fn a_mosaic_in_a_file_becomes_the_color_that_it_has_raw() {
        let color = [200, 100, 50];
        let mosaic = |x: u32, y: u32| color[(x % 2 + y % 2) as usize];
        let small = image::GrayImage::from_fn(6, 4, |x, y| image::Luma([mosaic(x, y)]));
        let wide = image::ImageBuffer::from_fn(6, 4, |x, y| image::Luma([u16::from(mosaic(x, y)) * 256 + 7]));
        let encoding = ImageEncoding::BayerFile(BayerPattern::Rggb);
        for frame in [frame_of(small, encoding), frame_of(wide, encoding)] {
            assert_eq!((frame.size, frame.format), ((6, 4).into(), Some(PixelFormat::Rgb8)));
            assert!(frame.view().unwrap().bytes().as_chunks().0.iter().all(|&pixel| pixel == color));
            assert!(frame.file.is_empty() && !frame.is_turned, "the file is gray");
        }
        let in_color = frame_of(image::RgbImage::from_pixel(6, 4, image::Rgb(color)), encoding);
        assert_eq!(in_color.view().unwrap().bytes()[..3], color);
        assert!(!in_color.file.is_empty(), "it was converted before it was compressed");
    }
}

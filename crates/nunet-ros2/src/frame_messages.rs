//! The messages of a frame, encoded when they are needed.

use nunet_mcap::CameraDescription;
use nunet_mcap::ros::{Header, ImagePixels, RosMessage, Time};
use nunet_sink::image_encoder::ImageEncoder;
use nunet_sink::record::{RecordedFrame, describe};
use nunet_types::Units;

use crate::options::DepthFormat;
use crate::topic::Topic;

/// Bytes of one value of depth.
const DEPTH_BYTES: usize = size_of::<f32>();

/// Encodes the messages of a camera. Its memory is reused.
pub(crate) struct FrameEncoder {
    frame_id: String,
    depth: DepthFormat,
    images: ImageEncoder,
    pixels: Vec<u8>,
    message: Vec<u8>,
}

impl FrameEncoder {
    pub(crate) fn new(frame_id: &str, depth: DepthFormat) -> Self {
        let images = ImageEncoder::for_live_topics();
        Self { frame_id: frame_id.to_owned(), depth, images, pixels: Vec::new(), message: Vec::new() }
    }

    /// The message of `topic`; `None` if the frame has none.
    pub(crate) fn encode(&mut self, topic: Topic, record: &RecordedFrame) -> anyhow::Result<Option<&[u8]>> {
        let Self { frame_id, depth, images, pixels, message } = self;
        let stamp = Time::from_unix_nanos(record.frame.capture.unix_nanos);
        let stated = &record.frame.frame_id;
        let frame_id = if stated.is_empty() { &*frame_id } else { stated };
        let mut header = Header { stamp, frame_id: frame_id.as_str().into() };
        let camera;
        let obstacles = record.obstacles();
        let content = match topic {
            Topic::Depth => Some(RosMessage::Image(depth_image(record, 1, *depth, pixels))),
            Topic::HalfDepth => Some(RosMessage::Image(depth_image(record, 2, *depth, pixels))),
            Topic::DepthCamera | Topic::HalfDepthCamera | Topic::ImageCamera => {
                camera = match topic {
                    Topic::DepthCamera => record.depth_camera.as_ref().map(describe),
                    Topic::HalfDepthCamera => record.depth_camera.as_ref().map(describe).map(halved),
                    _ => record.camera.as_ref().map(describe),
                };
                camera.as_ref().map(RosMessage::CameraInfo)
            }
            Topic::Labels => record.labels().map(|labels| RosMessage::Image(byte_image(record, labels))),
            Topic::Confidence => {
                record.confidence().map(|confidence| RosMessage::Image(byte_image(record, confidence)))
            }
            Topic::Points => record.cloud().map(RosMessage::Cloud),
            Topic::ObstaclePoints => obstacles.as_ref().map(RosMessage::ObstaclePoints),
            Topic::Scan => obstacles.as_ref().map(RosMessage::Scan),
            Topic::Image => Some(RosMessage::CompressedImage(images.encoded(&record.frame)?)),
            Topic::LabelInfo | Topic::TfStatic | Topic::Diagnostics => None,
        };
        if let Some(obstacles) = obstacles.as_ref().filter(|_| topic.needs_obstacles()) {
            header.frame_id = obstacles.frame_id.into();
        }
        let Some(content) = content else { return Ok(None) };
        content.encode(&header, message).map_err(|reason| anyhow::anyhow!("{topic}: {reason}"))?;
        Ok(Some(message))
    }
}

/// Every `step`-th pixel of every `step`-th row. Depth without a unit stays as it is: it has no millimeters.
fn depth_image<'a>(
    record: &'a RecordedFrame,
    step: usize,
    format: DepthFormat,
    pixels: &'a mut Vec<u8>,
) -> ImagePixels<'a> {
    let depth = record.depth();
    let in_millimeters = format == DepthFormat::Millimeters && depth.scale.units == Units::Metre.name();
    let (encoding, pixel_bytes) = if in_millimeters { ("16UC1", 2) } else { ("32FC1", DEPTH_BYTES as u32) };
    let halves = |size: u32| size.div_ceil(step as u32);
    let (width, height) = (halves(depth.width), halves(depth.height));
    if step == 1 && !in_millimeters {
        return ImagePixels { width, height, encoding, pixel_bytes, data: depth.bytes };
    }
    pixels.clear();
    for row in depth.bytes.chunks_exact(depth.width.max(1) as usize * DEPTH_BYTES).step_by(step) {
        let values = row.as_chunks::<DEPTH_BYTES>().0.iter().step_by(step);
        if in_millimeters {
            pixels.extend(values.flat_map(|value| millimeters(f32::from_le_bytes(*value)).to_le_bytes()));
        } else {
            pixels.extend(values.flatten());
        }
    }
    ImagePixels { width, height, encoding, pixel_bytes, data: pixels }
}

/// 0 = no measurement, as in REP 118.
fn millimeters(meters: f32) -> u16 {
    let millimeters = (meters * 1000.0).round();
    if (1.0..=f32::from(u16::MAX)).contains(&millimeters) { millimeters as u16 } else { 0 }
}

fn byte_image<'a>(record: &RecordedFrame, data: &'a [u8]) -> ImagePixels<'a> {
    let depth = record.depth();
    ImagePixels { width: depth.width, height: depth.height, encoding: "mono8", pixel_bytes: 1, data }
}

/// The camera of every second pixel: its pixel (u, v) is pixel (2u, 2v).
fn halved(camera: CameraDescription) -> CameraDescription {
    let intrinsics = camera.intrinsics.map(|value| value / 2.0);
    let (width, height) = (camera.width.div_ceil(2), camera.height.div_ceil(2));
    CameraDescription { width, height, intrinsics, ..camera }
}

#[cfg(test)]
mod tests {
    use nunet_core::depth::{DepthEncoding, Scale};
    use nunet_core::obstacle::{Ground, ObstacleSector, Obstacles};
    use nunet_sink::results::Results;
    use nunet_types::{ImageSize, PixelRect};

    use super::*;

    fn record(size: ImageSize, depth: &[f32]) -> RecordedFrame {
        let mut record = RecordedFrame::default();
        record.copy_results(&results(size, depth));
        record
    }

    fn results(size: ImageSize, depth: &[f32]) -> Results<'_> {
        Results {
            scale: Scale::unscaled(DepthEncoding::Metric),
            size,
            depth,
            labels: None,
            confidence: None,
            cloud_size: size,
            cloud: None,
            camera: None,
            view: PixelRect::whole(size),
            obstacles: None,
            obstacle_frame: "base_footprint",
            roll_pitch_rad: None,
        }
    }

    #[test]
    fn obstacles_have_their_own_frame_and_depth_has_that_of_the_camera() {
        let found = Obstacles {
            ground: Ground::EXPECTED,
            sectors: vec![ObstacleSector::UNKNOWN; 3],
            points: Vec::new(),
            angle_min_rad: -0.3,
            angle_step_rad: 0.2,
            max_range_m: 5.0,
            used_labels: false,
        };
        let mut record = RecordedFrame::default();
        let size = ImageSize::new(1, 1);
        record.copy_results(&Results { obstacles: Some(&found), ..results(size, &[1.0]) });
        let mut encoder = FrameEncoder::new("eye", DepthFormat::Meters);
        let mut has_frame = |topic, frame: &str| {
            let message = encoder.encode(topic, &record).unwrap().unwrap();
            message.windows(frame.len()).any(|bytes| bytes == frame.as_bytes())
        };
        for topic in [Topic::Scan, Topic::ObstaclePoints] {
            assert!(has_frame(topic, "base_footprint") && !has_frame(topic, "eye"), "{topic}");
        }
        assert!(has_frame(Topic::Depth, "eye") && !has_frame(Topic::Depth, "base_footprint"));
    }

    #[test]
    fn half_depth_has_every_second_pixel_also_of_odd_sizes() {
        let depth: Vec<f32> = (0_u8..15).map(f32::from).collect();
        let record = record(ImageSize::new(5, 3), &depth);
        let mut pixels = Vec::new();
        let image = depth_image(&record, 2, DepthFormat::Meters, &mut pixels);
        assert_eq!((image.width, image.height, image.encoding), (3, 2, "32FC1"));
        let values: Vec<f32> =
            image.data.as_chunks().0.iter().map(|&value| f32::from_le_bytes(value)).collect();
        assert_eq!(values, [0.0, 2.0, 4.0, 10.0, 12.0, 14.0]);
    }

    #[test]
    fn millimeters_have_zero_where_there_is_no_measurement_or_it_does_not_fit() {
        let depth = [1.2345, f32::NAN, 65.535, 65.536, -1.0, f32::INFINITY];
        let record = record(ImageSize::new(6, 1), &depth);
        let mut pixels = Vec::new();
        let image = depth_image(&record, 1, DepthFormat::Millimeters, &mut pixels);
        let values: Vec<u16> =
            image.data.as_chunks().0.iter().map(|&value| u16::from_le_bytes(value)).collect();
        assert_eq!((image.encoding, values.as_slice()), ("16UC1", [1235_u16, 0, 65535, 0, 0, 0].as_slice()));
    }

    #[test]
    fn the_camera_of_half_depth_sees_the_same_rays() {
        let camera = CameraDescription {
            width: 641,
            height: 480,
            intrinsics: [500.0, 502.0, 320.0, 240.0],
            distortion_model: "plumb_bob".into(),
            coefficients: vec![0.1; 5],
            skew: 0.0,
            fault: None,
        };
        let half = halved(camera.clone());
        assert_eq!((half.width, half.height), (321, 240));
        let ray = |camera: &CameraDescription, u: f64| (u - camera.intrinsics[2]) / camera.intrinsics[0];
        assert_eq!(ray(&half, 100.0), ray(&camera, 200.0));
    }
}

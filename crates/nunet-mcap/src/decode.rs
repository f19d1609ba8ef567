//! Decodes messages of all supported types as images or cameras.

use foxglove::Decode;
use foxglove::messages as protobuf;
use nunet_types::{ImageSize, counted};

use crate::camera::{CameraDescription, CameraMatrices};
use crate::cdr;
use crate::channel::{ChannelKind, Content, MessageFormat};
use crate::foxglove_json::{JsonCameraCalibration, JsonCompressedImage, JsonRawImage};
use crate::image::{Purpose, Raw, RecordedImage};
use crate::image_error::ImageError;
use crate::messages::{
    FoxgloveCameraCalibration, FoxgloveCompressedImage, FoxgloveRawImage, RosCameraInfo, RosCompressedImage,
    RosImage,
};
use crate::topics::{TopicContent, is_rectified};

/// How the messages of a topic are read.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ReadMode {
    pub(crate) purpose: Purpose,
    /// Whether the images are rectified, by the topic's name in ROS: their camera is the projection P.
    pub(crate) rectified: bool,
}

impl ReadMode {
    /// As the topic's name says.
    pub(crate) fn of_topic(topic: &str, purpose: Purpose) -> Self {
        Self { purpose, rectified: is_rectified(topic) }
    }

    /// Images to look at.
    pub(crate) fn of_image_topic(topic: &str) -> Self {
        let infrared = TopicContent::of(topic) == TopicContent::Infrared;
        Self::of_topic(topic, if infrared { Purpose::Infrared } else { Purpose::Color })
    }
}

/// Decodes an image into `image`.
pub(crate) fn image(
    kind: ChannelKind,
    data: &[u8],
    read_mode: ReadMode,
    image: &mut RecordedImage,
) -> Result<(), ImageError> {
    let purpose = read_mode.purpose;
    match (kind.content, kind.form) {
        (Content::Camera, _) => Err("it describes a camera".to_owned().into()),
        (Content::RawImage, MessageFormat::Ros) => {
            image.set_ros_image(&cdr::decode::<RosImage<'_>>(data)?, purpose)
        }
        (Content::CompressedImage, MessageFormat::Ros) => {
            image.set_ros_compressed(&cdr::decode::<RosCompressedImage<'_>>(data)?, purpose)
        }
        (Content::RawImage, form) => raw_image(form, data, purpose, image),
        (Content::CompressedImage, form) => compressed_image(form, data, purpose, image),
    }
}

fn raw_image(
    form: MessageFormat,
    data: &[u8],
    purpose: Purpose,
    out: &mut RecordedImage,
) -> Result<(), ImageError> {
    let mut set = |nanos, frame_id: &str, raw: &Raw<'_>| {
        out.set_header(nanos, frame_id);
        out.set_raw(raw, purpose)
    };
    match form {
        MessageFormat::FoxgloveProtobuf => {
            let message = protobuf::RawImage::decode(data).map_err(|error| error.to_string())?;
            let protobuf::RawImage { width, height, step, encoding, data, .. } = &message;
            let (width, height, step) = (*width, *height, *step);
            let raw = Raw { width, height, step, encoding, data, big_endian: false };
            set(nanos(message.timestamp), &message.frame_id, &raw)
        }
        MessageFormat::FoxgloveJson => {
            let message = JsonRawImage::decode(data)?;
            let JsonRawImage { width, height, step, encoding, data, .. } = &message;
            let (width, height, step) = (*width, *height, *step);
            let raw = Raw { width, height, step, encoding, data, big_endian: false };
            set(message.unix_nanos, &message.frame_id, &raw)
        }
        MessageFormat::FoxgloveCdr | MessageFormat::Ros => {
            let message: FoxgloveRawImage<'_> = cdr::decode(data)?;
            let FoxgloveRawImage { width, height, step, encoding, data, .. } = &message;
            let (width, height, step) = (*width, *height, *step);
            let raw = Raw { width, height, step, encoding, data, big_endian: false };
            set(message.header.stamp.unix_nanos(), &message.header.frame_id, &raw)
        }
    }
}

fn compressed_image(
    form: MessageFormat,
    data: &[u8],
    purpose: Purpose,
    out: &mut RecordedImage,
) -> Result<(), ImageError> {
    match form {
        MessageFormat::FoxgloveProtobuf => {
            let message = protobuf::CompressedImage::decode(data).map_err(|error| error.to_string())?;
            out.set_header(nanos(message.timestamp), &message.frame_id);
            out.set_file(&message.data, &message.format, purpose)
        }
        MessageFormat::FoxgloveJson => {
            let message = JsonCompressedImage::decode(data)?;
            out.set_header(message.unix_nanos, &message.frame_id);
            out.set_file(&message.data, &message.format, purpose)
        }
        MessageFormat::FoxgloveCdr | MessageFormat::Ros => {
            let message: FoxgloveCompressedImage<'_> = cdr::decode(data)?;
            out.set_header(message.header.stamp.unix_nanos(), &message.header.frame_id);
            out.set_file(message.data, &message.format, purpose)
        }
    }
}

/// Replaces what is known of a camera by what a message says.
pub(crate) fn update_camera(
    kind: ChannelKind,
    data: &[u8],
    read_mode: ReadMode,
    known: &mut Option<CameraDescription>,
) {
    match camera(kind, data, read_mode) {
        Ok(described) => *known = Some(described),
        // One that cannot be read is known from before, or has to be reported.
        Err(reason) if known.is_none() => *known = Some(CameraDescription::unreadable(&reason)),
        Err(_) => {}
    }
}

/// Decodes a camera. One that must not be used has a fault.
pub(crate) fn camera(
    kind: ChannelKind,
    data: &[u8],
    read_mode: ReadMode,
) -> Result<CameraDescription, String> {
    let rectified = read_mode.rectified;
    let of = |(width, height), [k, r, p]: [&[f64]; 3], model: &str, d: Vec<f64>| -> Result<_, String> {
        check_matrices([k, r, p])?;
        let size = ImageSize { width, height };
        Ok(CameraDescription::of_matrices(size, CameraMatrices { k, p }, model, d, rectified))
    };
    match kind.form {
        MessageFormat::Ros => {
            Ok(CameraDescription::of_ros(&cdr::decode::<RosCameraInfo<'_>>(data)?, rectified))
        }
        MessageFormat::FoxgloveCdr => {
            let camera: FoxgloveCameraCalibration<'_> = cdr::decode(data)?;
            let matrices = [&camera.k[..], &camera.r, &camera.p];
            of((camera.width, camera.height), matrices, &camera.distortion_model, camera.d)
        }
        MessageFormat::FoxgloveProtobuf => {
            let camera = protobuf::CameraCalibration::decode(data).map_err(|error| error.to_string())?;
            let matrices = [&camera.k[..], &camera.r, &camera.p];
            of((camera.width, camera.height), matrices, &camera.distortion_model, camera.d)
        }
        MessageFormat::FoxgloveJson => {
            let camera = JsonCameraCalibration::decode(data)?;
            let matrices = [&camera.k[..], &camera.r, &camera.p];
            of((camera.width, camera.height), matrices, &camera.distortion_model, camera.d)
        }
    }
}

/// Checks the lengths of the matrices K, R and P. Protobuf omits an unknown matrix.
fn check_matrices([k, r, p]: [&[f64]; 3]) -> Result<(), String> {
    for (name, matrix, expected) in [("K", k, 9), ("R", r, 9), ("P", p, 12)] {
        if !matrix.is_empty() && matrix.len() != expected {
            return Err(format!("{name} has {}, expected {expected}", counted(matrix.len(), "value")));
        }
    }
    Ok(())
}

fn nanos(stamp: Option<protobuf::Timestamp>) -> i64 {
    let nanos = stamp.map_or(0, |stamp| stamp.total_nanos());
    i64::try_from(nanos).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests {
    use foxglove::Encode as _;

    use super::*;
    use crate::encoding::ImageEncoding;

    const READ_MODE: ReadMode = ReadMode { purpose: Purpose::Color, rectified: false };

    fn foxglove_image() -> protobuf::RawImage {
        protobuf::RawImage {
            timestamp: Some(protobuf::Timestamp::new(3, 5)),
            frame_id: "eye".into(),
            width: 2,
            height: 1,
            encoding: "mono8".into(),
            step: 2,
            data: vec![7, 8].into(),
        }
    }

    #[track_caller]
    fn assert_read(form: MessageFormat, message: &[u8]) {
        let kind = ChannelKind { content: Content::RawImage, form };
        let mut read = RecordedImage::default();
        image(kind, message, READ_MODE, &mut read).unwrap();
        assert_eq!((read.data.as_slice(), read.encoding), (&[7, 8][..], Some(ImageEncoding::Mono8)));
        assert_eq!((read.stamp_nanos, read.frame_id.as_str()), (3_000_000_005, "eye"));
    }

    #[test]
    fn an_image_is_the_same_in_protobuf_json_and_cdr() {
        let mut message = Vec::new();
        foxglove_image().encode(&mut message).unwrap();
        assert_read(MessageFormat::FoxgloveProtobuf, &message);
        assert_read(MessageFormat::FoxgloveJson, &serde_json::to_vec(&foxglove_image()).unwrap());
        // Field by field as `foxglove_msgs/msg/RawImage.msg` lists them.
        let cdr: Vec<u8> = [
            &[0, 1, 0, 0, 3, 0, 0, 0, 5, 0, 0, 0][..],
            &[4, 0, 0, 0, b'e', b'y', b'e', 0],
            &[2, 0, 0, 0, 1, 0, 0, 0],
            &[6, 0, 0, 0, b'm', b'o', b'n', b'o', b'8', 0, 0, 0],
            &[2, 0, 0, 0],
            &[2, 0, 0, 0, 7, 8],
        ]
        .concat();
        assert_read(MessageFormat::FoxgloveCdr, &cdr);
    }

    #[test]
    fn a_compressed_image_in_cdr_has_its_data_before_its_format() {
        let cdr: Vec<u8> = [
            &[0, 1, 0, 0, 3, 0, 0, 0, 5, 0, 0, 0][..],
            &[4, 0, 0, 0, b'e', b'y', b'e', 0],
            &[4, 0, 0, 0, 0xff, 0xd8, 0xff, 0xe0],
            &[5, 0, 0, 0, b'j', b'p', b'e', b'g', 0],
        ]
        .concat();
        let kind = ChannelKind { content: Content::CompressedImage, form: MessageFormat::FoxgloveCdr };
        let mut read = RecordedImage::default();
        image(kind, &cdr, READ_MODE, &mut read).unwrap();
        assert_eq!((read.data.len(), read.encoding), (4, Some(ImageEncoding::File)));
    }

    #[test]
    fn a_calibration_is_a_camera() {
        let calibration = protobuf::CameraCalibration {
            width: 640,
            height: 480,
            distortion_model: "plumb_bob".into(),
            d: vec![0.1, 0.2, 0.0, 0.0, 0.0],
            k: [500.0, 0.0, 320.0, 0.0, 501.0, 240.0, 0.0, 0.0, 1.0].to_vec(),
            ..protobuf::CameraCalibration::default()
        };
        let message = serde_json::to_vec(&calibration).unwrap();
        let kind = ChannelKind { content: Content::Camera, form: MessageFormat::FoxgloveJson };
        let read = camera(kind, &message, READ_MODE).unwrap();
        assert_eq!(read.intrinsics, [500.0, 501.0, 320.0, 240.0]);
        assert_eq!((read.distortion_model.as_str(), read.coefficients.len()), ("plumb_bob", 5));
    }

    #[test]
    fn matrices_of_another_length_are_errors_in_every_form() {
        let good = protobuf::CameraCalibration {
            width: 640,
            height: 480,
            k: [500.0, 0.0, 320.0, 0.0, 501.0, 240.0, 0.0, 0.0, 1.0].to_vec(),
            ..protobuf::CameraCalibration::default()
        };
        let read = |calibration: &protobuf::CameraCalibration, rectified| {
            let mut message = Vec::new();
            calibration.encode(&mut message).unwrap();
            let text = serde_json::to_vec(calibration).unwrap();
            let read_mode = ReadMode { rectified, ..READ_MODE };
            let kind = |form| ChannelKind { content: Content::Camera, form };
            let of_protobuf = camera(kind(MessageFormat::FoxgloveProtobuf), &message, read_mode);
            assert_eq!(of_protobuf, camera(kind(MessageFormat::FoxgloveJson), &text, read_mode));
            of_protobuf
        };
        assert_eq!(read(&good, false).unwrap().fault, None);
        for length in [1, 4, 6, 8, 10, 12] {
            let k = vec![1.0; length];
            let error = read(&protobuf::CameraCalibration { k, ..good.clone() }, false).unwrap_err();
            assert_eq!(error, format!("K has {}, expected 9", counted(length, "value")));
        }
        let error =
            read(&protobuf::CameraCalibration { r: vec![1.0; 3], ..good.clone() }, false).unwrap_err();
        assert_eq!(error, "R has 3 values, expected 9");
        let error = read(&protobuf::CameraCalibration { p: vec![1.0; 9], ..good.clone() }, true).unwrap_err();
        assert_eq!(error, "P has 9 values, expected 12");
        let fault = |calibration: &protobuf::CameraCalibration, rectified| {
            read(calibration, rectified).unwrap().fault.unwrap()
        };
        assert_eq!(fault(&good, true), "P has no values, but the images are rectified");
        let unknown = protobuf::CameraCalibration { k: Vec::new(), ..good };
        assert_eq!(fault(&unknown, false), "it is not calibrated: K has no values");
    }

    #[test]
    fn random_bytes_are_an_error_in_every_form() {
        for form in [
            MessageFormat::Ros,
            MessageFormat::FoxgloveCdr,
            MessageFormat::FoxgloveProtobuf,
            MessageFormat::FoxgloveJson,
        ] {
            for content in [Content::RawImage, Content::CompressedImage] {
                let kind = ChannelKind { content, form };
                assert!(
                    image(kind, &[0xff; 9], READ_MODE, &mut RecordedImage::default()).is_err(),
                    "{kind:?}"
                );
            }
            assert!(camera(ChannelKind { content: Content::Camera, form }, &[0xff; 9], READ_MODE).is_err());
        }
    }
}

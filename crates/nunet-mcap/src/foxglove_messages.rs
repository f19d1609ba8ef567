//! Foxglove's messages, in protobuf and in JSON, by Foxglove's own types.

use foxglove::Decode;
use foxglove::messages::{CameraCalibration, CompressedImage, RawImage, Timestamp};
use serde::de::DeserializeOwned;

use crate::channels::{Form, FoxgloveKind};
use crate::picture::{CameraDescription, Picture, Raw};

/// What a message says.
pub(crate) enum Said {
    /// The picture was filled.
    Picture,
    /// A camera; `None` of an uncalibrated one.
    Camera(Option<CameraDescription>),
}

/// Decodes a message; a picture goes into `picture`.
pub(crate) fn read(
    kind: FoxgloveKind,
    form: Form,
    message: &[u8],
    rectified: bool,
    picture: &mut Picture,
) -> Result<Said, String> {
    match kind {
        FoxgloveKind::RawImage => {
            let image: RawImage = decode(form, message)?;
            picture.set_header(nanos(image.timestamp), &image.frame_id);
            let RawImage { width, height, step, encoding, data, .. } = &image;
            let raw = Raw { width: *width, height: *height, step: *step, encoding, data };
            picture.set_raw(&raw).map(|()| Said::Picture)
        }
        FoxgloveKind::CompressedImage => {
            let image: CompressedImage = decode(form, message)?;
            picture.set_header(nanos(image.timestamp), &image.frame_id);
            picture.set_file(&image.data, &image.format).map(|()| Said::Picture)
        }
        FoxgloveKind::CameraCalibration => {
            let camera: CameraCalibration = decode(form, message)?;
            let size = (camera.width, camera.height);
            Ok(Said::Camera(if rectified {
                CameraDescription::of_projection(size, &camera.p)
            } else {
                CameraDescription::new(size, &camera.k, &camera.distortion_model, camera.d.clone())
            }))
        }
    }
}

fn decode<T: Decode + DeserializeOwned>(form: Form, message: &[u8]) -> Result<T, String>
where
    T::Error: std::fmt::Display,
{
    match form {
        Form::Protobuf => T::decode(message).map_err(|error| error.to_string()),
        Form::Json => serde_json::from_slice(message).map_err(|error| error.to_string()),
    }
}

fn nanos(stamp: Option<Timestamp>) -> i64 {
    let nanos = stamp.map_or(0, |stamp| stamp.total_nanos());
    i64::try_from(nanos).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests {
    use foxglove::Encode as _;

    use super::*;
    use crate::picture::Encoding;

    fn raw_image() -> RawImage {
        RawImage {
            timestamp: Some(Timestamp::new(3, 5)),
            frame_id: "eye".into(),
            width: 2,
            height: 1,
            encoding: "mono8".into(),
            step: 2,
            data: vec![7, 8].into(),
        }
    }

    #[track_caller]
    fn assert_read(form: Form, message: &[u8]) {
        let mut picture = Picture::default();
        assert!(matches!(
            read(FoxgloveKind::RawImage, form, message, false, &mut picture),
            Ok(Said::Picture)
        ));
        assert_eq!((picture.data.as_slice(), picture.encoding), (&[7, 8][..], Some(Encoding::Mono8)));
        assert_eq!((picture.stamp_nanos, picture.frame_id.as_str()), (3_000_000_005, "eye"));
    }

    #[test]
    fn a_picture_is_the_same_in_protobuf_and_in_json() {
        let mut message = Vec::new();
        raw_image().encode(&mut message).unwrap();
        assert_read(Form::Protobuf, &message);
        assert_read(Form::Json, &serde_json::to_vec(&raw_image()).unwrap());
    }

    #[test]
    fn a_calibration_is_a_camera() {
        let camera = CameraCalibration {
            width: 640,
            height: 480,
            distortion_model: "plumb_bob".into(),
            d: vec![0.1, 0.2, 0.0, 0.0, 0.0],
            k: [500.0, 0.0, 320.0, 0.0, 501.0, 240.0, 0.0, 0.0, 1.0].to_vec(),
            ..CameraCalibration::default()
        };
        let message = serde_json::to_vec(&camera).unwrap();
        let mut picture = Picture::default();
        let said = read(FoxgloveKind::CameraCalibration, Form::Json, &message, false, &mut picture).unwrap();
        let Said::Camera(Some(camera)) = said else { panic!("no camera") };
        assert_eq!(camera.intrinsics, [500.0, 501.0, 320.0, 240.0]);
        assert_eq!((camera.distortion_model.as_str(), camera.coefficients.len()), ("plumb_bob", 5));
    }

    #[test]
    fn rubbish_is_an_error() {
        for form in [Form::Protobuf, Form::Json] {
            assert!(read(FoxgloveKind::RawImage, form, &[0xff; 9], false, &mut Picture::default()).is_err());
        }
    }
}

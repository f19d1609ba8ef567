//! Messages of a live ROS 2 topic, read as those of a recording.

use crate::CameraDescription;
use crate::channel::{ChannelKind, Content, MessageFormat};
use crate::decode::{self, ReadMode};
use crate::image::RecordedImage;

/// Decodes the images of a topic, and the descriptions of its camera.
#[derive(Debug, Clone, Copy)]
pub struct TopicDecoder {
    kind: ChannelKind,
    read_mode: ReadMode,
}

impl TopicDecoder {
    /// For a topic with messages of a type, such as `sensor_msgs/msg/Image`; `None` if these are no images.
    #[must_use]
    pub fn new(topic: &str, type_name: &str) -> Option<Self> {
        let kind = ChannelKind::of(type_name, "cdr").filter(|kind| !kind.is_camera())?;
        (kind.form == MessageFormat::Ros).then(|| Self { kind, read_mode: ReadMode::of_image_topic(topic) })
    }

    /// Decodes an image, CDR with its four leading bytes.
    ///
    /// # Errors
    /// Why it cannot be read: it is cut off, its encoding is unknown, or its size contradicts its data.
    pub fn image(&self, message: &[u8], image: &mut RecordedImage) -> Result<(), String> {
        decode::image(self.kind, message, self.read_mode, image).map_err(|error| error.to_string())
    }

    /// Replaces what is known of the camera by what a `CameraInfo` says. A message that cannot be read
    /// changes a known camera in nothing, and an unknown one to one with a fault.
    pub fn update_camera(&self, message: &[u8], known: &mut Option<CameraDescription>) {
        let kind = ChannelKind { content: Content::Camera, form: MessageFormat::Ros };
        decode::update_camera(kind, message, self.read_mode, known);
    }
}

#[cfg(test)]
mod tests {
    use nunet_types::MAX_FRAME_ID;

    use super::*;
    use crate::ImageEncoding;
    use crate::ros::{Header, ImagePixels, RosMessage, Time};

    fn header() -> Header<'static> {
        Header { stamp: Time { sec: 3, nanosec: 5 }, frame_id: "eye".into() }
    }

    #[test]
    fn only_types_of_images_have_a_decoder() {
        for (type_name, is_image) in [
            ("sensor_msgs/msg/Image", true),
            ("sensor_msgs/msg/CompressedImage", true),
            ("sensor_msgs/msg/CameraInfo", false),
            ("foxglove_msgs/msg/RawImage", false),
            ("std_msgs/msg/String", false),
        ] {
            assert_eq!(TopicDecoder::new("/image", type_name).is_some(), is_image, "{type_name}");
        }
    }

    #[test]
    fn an_image_is_read_and_every_cut_of_it_is_an_error() {
        let image = ImagePixels { width: 2, height: 1, encoding: "mono8", pixel_bytes: 1, data: &[7, 8] };
        let mut message = Vec::new();
        RosMessage::Image(image).encode(&header(), &mut message).unwrap();
        let decoder = TopicDecoder::new("/image", "sensor_msgs/msg/Image").unwrap();
        let mut read = RecordedImage::default();
        decoder.image(&message, &mut read).unwrap();
        assert_eq!((read.encoding, read.data.as_slice()), (Some(ImageEncoding::Mono8), &[7, 8][..]));
        assert_eq!((read.stamp_nanos, read.frame_id.as_str()), (3_000_000_005, "eye"));
        for length in 0..message.len() {
            assert!(decoder.image(&message[..length], &mut read).is_err(), "{length} bytes");
        }
    }

    /// The coordinate frame of an image whose header has `frame_id`, and whether it was changed.
    fn frame_id_of(frame_id: &[u8]) -> (String, bool) {
        let image = ImagePixels { width: 2, height: 1, encoding: "mono8", pixel_bytes: 1, data: &[7, 8] };
        let (mut message, mut read) = (Vec::new(), RecordedImage::default());
        let header = Header { frame_id: "x".repeat(frame_id.len()).into(), ..header() };
        RosMessage::Image(image).encode(&header, &mut message).unwrap();
        // After the encapsulation, the stamp and the length.
        message[16..16 + frame_id.len()].copy_from_slice(frame_id);
        let decoder = TopicDecoder::new("/image", "sensor_msgs/msg/Image").unwrap();
        decoder.image(&message, &mut read).unwrap();
        assert_eq!(read.data, [7, 8]);
        (read.frame_id, read.is_frame_id_changed)
    }

    #[test]
    fn a_coordinate_frame_that_is_not_utf8_does_not_make_an_image_unreadable() {
        assert_eq!(frame_id_of(b"eye"), ("eye".to_owned(), false));
        assert_eq!(frame_id_of(b"e\xffe"), ("e\u{fffd}e".to_owned(), true));
        assert!(frame_id_of(&[0xff; 5000]).1);
    }

    #[test]
    fn a_coordinate_frame_is_as_long_as_a_header_has_room_for() {
        let most = "x".repeat(MAX_FRAME_ID);
        assert_eq!(frame_id_of(most.as_bytes()), (most.clone(), false));
        assert_eq!(frame_id_of(format!("{most}y").as_bytes()), (most.clone(), true));
        assert_eq!(frame_id_of("x".repeat(1 << 20).as_bytes()), (most, true));
        let letters = "ß".repeat(MAX_FRAME_ID / 2);
        assert_eq!(frame_id_of(format!("y{letters}").as_bytes()).0.len(), MAX_FRAME_ID - 1, "no half letter");
    }

    #[test]
    fn a_camera_is_read_whatever_the_bytes_of_its_coordinate_frame() {
        let (intrinsics, mut message, mut known) = ([5.0, 5.0, 1.5, 0.5], Vec::new(), None);
        let camera = CameraDescription { width: 4, height: 2, intrinsics, ..CameraDescription::default() };
        RosMessage::CameraInfo(&camera).encode(&header(), &mut message).unwrap();
        message[16] = 0xff;
        let decoder = TopicDecoder::new("/image", "sensor_msgs/msg/Image").unwrap();
        decoder.update_camera(&message, &mut known);
        assert_eq!(known.map(|known| (known.fault, known.intrinsics)), Some((None, intrinsics)));
    }

    #[test]
    fn a_camera_that_cannot_be_read_does_not_replace_a_known_one() {
        let camera = CameraDescription {
            width: 4,
            height: 2,
            intrinsics: [5.0, 5.0, 1.5, 0.5],
            ..CameraDescription::default()
        };
        let mut message = Vec::new();
        RosMessage::CameraInfo(&camera).encode(&header(), &mut message).unwrap();
        let decoder = TopicDecoder::new("/image", "sensor_msgs/msg/Image").unwrap();
        let mut known = None;
        decoder.update_camera(&message[..20], &mut known);
        assert!(known.as_ref().unwrap().fault.is_some());
        for message in [&message[..], &message[..20]] {
            decoder.update_camera(message, &mut known);
            assert_eq!(known.as_ref().unwrap().intrinsics, camera.intrinsics);
        }
    }
}

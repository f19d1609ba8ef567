//! One channel of a recording, and the kind of its messages.

/// The kind of a channel's messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ChannelKind {
    pub(crate) content: Content,
    pub(crate) form: MessageFormat,
}

/// The content of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Content {
    RawImage,
    CompressedImage,
    Camera,
}

/// The schema and encoding of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum MessageFormat {
    /// `sensor_msgs` in CDR.
    Ros,
    /// `foxglove_msgs` in CDR.
    FoxgloveCdr,
    /// `foxglove` in protobuf.
    FoxgloveProtobuf,
    /// `foxglove` in JSON.
    FoxgloveJson,
}

impl ChannelKind {
    /// The kind by the schema's name and the encoding of the messages. The schema's text is not needed.
    pub(crate) fn of(schema: &str, encoding: &str) -> Option<Self> {
        // ROS 2's names with and without `msg`: some recorders omit it.
        let (package, name) = schema.split_once(['/', '.'])?;
        let name = name.strip_prefix("msg/").or(name.strip_prefix("msg.")).unwrap_or(name);
        let form = match (package, encoding) {
            ("sensor_msgs", "cdr") => MessageFormat::Ros,
            ("foxglove_msgs", "cdr") => MessageFormat::FoxgloveCdr,
            ("foxglove", "protobuf") => MessageFormat::FoxgloveProtobuf,
            ("foxglove", "json") => MessageFormat::FoxgloveJson,
            _ => return None,
        };
        let content = match (form, name) {
            (MessageFormat::Ros, "Image") => Content::RawImage,
            (MessageFormat::Ros, "CameraInfo") => Content::Camera,
            (_, "CompressedImage") => Content::CompressedImage,
            (MessageFormat::Ros, _) => return None,
            (_, "RawImage") => Content::RawImage,
            (_, "CameraCalibration") => Content::Camera,
            _ => return None,
        };
        Some(Self { content, form })
    }

    pub(crate) fn is_camera(self) -> bool {
        self.content == Content::Camera
    }
}

/// The properties of a channel that this crate needs.
#[derive(Debug, Clone)]
pub(crate) struct Channel {
    pub(crate) topic: String,
    schema: String,
    encoding: String,
}

impl Channel {
    pub(crate) fn new(topic: &str, schema: String, encoding: &str) -> Self {
        Self { topic: topic.to_owned(), schema, encoding: encoding.to_owned() }
    }

    pub(crate) fn kind(&self) -> Option<ChannelKind> {
        ChannelKind::of(&self.schema, &self.encoding)
    }

    /// Whether its messages are those of an inertial sensor.
    pub(crate) fn is_imu(&self) -> bool {
        (self.schema.as_str(), self.encoding.as_str()) == ("sensor_msgs/msg/Imu", "cdr")
    }

    /// Type and encoding of its messages.
    pub(crate) fn description(&self) -> String {
        let schema = if self.schema.is_empty() { "messages without a type" } else { &self.schema };
        format!("{schema:.60} as `{:.60}`", self.encoding)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kind_is_recognized_by_type_and_encoding_together() {
        let kind = |schema, encoding| ChannelKind::of(schema, encoding).map(|kind| (kind.content, kind.form));
        assert_eq!(kind("sensor_msgs/msg/Image", "cdr"), Some((Content::RawImage, MessageFormat::Ros)));
        let expected = Some((Content::CompressedImage, MessageFormat::FoxgloveCdr));
        assert_eq!(kind("foxglove_msgs/msg/CompressedImage", "cdr"), expected);
        assert_eq!(
            kind("foxglove.CameraCalibration", "json"),
            Some((Content::Camera, MessageFormat::FoxgloveJson))
        );
        for (schema, encoding) in [
            ("sensor_msgs/msg/Image", "json"),
            ("sensor_msgs/msg/RawImage", "cdr"),
            ("foxglove_msgs/msg/Image", "cdr"),
            ("foxglove.CompressedVideo", "protobuf"),
            ("Image", "cdr"),
            ("", ""),
        ] {
            assert_eq!(kind(schema, encoding), None, "{schema} {encoding}");
        }
    }
}

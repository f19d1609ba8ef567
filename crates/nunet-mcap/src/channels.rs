//! Which channels of a recording carry pictures and which cameras.

use std::collections::{BTreeMap, HashMap};
use std::path::Path;

use mcap::records::Record;

use crate::RecordingError;
use crate::records::{Records, summary};

/// What a channel's messages are to us.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    RosImage,
    RosCompressedImage,
    RosCameraInfo,
    Foxglove(Form, FoxgloveKind),
}

/// How a Foxglove message is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Form {
    Protobuf,
    Json,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FoxgloveKind {
    RawImage,
    CompressedImage,
    CameraCalibration,
}

impl Kind {
    /// By the schema's name and the messages' encoding; a schema's text is not needed.
    fn of(schema: &str, encoding: &str) -> Option<Self> {
        let foxglove = |kind| match encoding {
            "protobuf" => Some(Self::Foxglove(Form::Protobuf, kind)),
            "json" => Some(Self::Foxglove(Form::Json, kind)),
            _ => None,
        };
        match (schema, encoding) {
            ("sensor_msgs/msg/Image", "cdr") => Some(Self::RosImage),
            ("sensor_msgs/msg/CompressedImage", "cdr") => Some(Self::RosCompressedImage),
            ("sensor_msgs/msg/CameraInfo", "cdr") => Some(Self::RosCameraInfo),
            ("foxglove.RawImage", _) => foxglove(FoxgloveKind::RawImage),
            ("foxglove.CompressedImage", _) => foxglove(FoxgloveKind::CompressedImage),
            ("foxglove.CameraCalibration", _) => foxglove(FoxgloveKind::CameraCalibration),
            _ => None,
        }
    }

    pub(crate) fn is_camera(self) -> bool {
        matches!(self, Self::RosCameraInfo | Self::Foxglove(_, FoxgloveKind::CameraCalibration))
    }
}

/// A channel as far as it matters here.
#[derive(Debug, Clone)]
pub(crate) struct Channel {
    pub(crate) topic: String,
    schema: String,
    encoding: String,
}

impl Channel {
    pub(crate) fn kind(&self) -> Option<Kind> {
        Kind::of(&self.schema, &self.encoding)
    }

    fn says(&self) -> String {
        let schema = if self.schema.is_empty() { "messages without a type" } else { &self.schema };
        format!("{schema:.60} as `{:.60}`", self.encoding)
    }
}

/// All channels of a file, known so far.
#[derive(Debug, Default)]
pub(crate) struct Channels {
    schemas: HashMap<u16, String>,
    by_id: BTreeMap<u16, Channel>,
    /// Messages of each channel, where the file's index says so.
    counts: BTreeMap<u16, u64>,
}

impl Channels {
    /// Those of the whole file: from its index, else by reading it to its end or to where it was cut, unless `given_up` says
    /// so before.
    pub(crate) fn of_file(path: &Path, given_up: &dyn Fn() -> bool) -> Result<Self, RecordingError> {
        let mut channels = Self::default();
        if let Some(summary) = summary(path)?.filter(|summary| !summary.channels.is_empty()) {
            for (&id, channel) in &summary.channels {
                let schema = channel.schema.as_ref().map(|schema| schema.name.clone()).unwrap_or_default();
                let encoding = channel.message_encoding.clone();
                channels.by_id.insert(id, Channel { topic: channel.topic.clone(), schema, encoding });
            }
            channels.counts = summary.stats.map(|stats| stats.channel_message_counts).unwrap_or_default();
            return Ok(channels);
        }
        let mut records = Records::open(path)?;
        while !given_up() {
            match records.next(|record| channels.learn(&record)) {
                Ok(Some(())) => {}
                Err(error @ (RecordingError::NotMcap { .. } | RecordingError::Io { .. })) => {
                    return Err(error);
                }
                Ok(None) | Err(_) => return Ok(channels),
            }
        }
        Err(RecordingError::GivenUp { path: path.to_owned() })
    }

    /// Takes note of a schema or a channel.
    pub(crate) fn learn(&mut self, record: &Record<'_>) {
        match record {
            Record::Schema { header, .. } => {
                self.schemas.insert(header.id, header.name.clone());
            }
            Record::Channel(channel) => {
                let schema = self.schemas.get(&channel.schema_id).cloned().unwrap_or_default();
                let (topic, encoding) = (channel.topic.clone(), channel.message_encoding.clone());
                self.by_id.insert(channel.id, Channel { topic, schema, encoding });
            }
            _ => {}
        }
    }

    /// How many messages a topic has, where the file's index says so.
    pub(crate) fn count(&self, topic: &str) -> Option<u64> {
        let of_topic = self.by_id.iter().filter(|(_, channel)| channel.topic == topic);
        let counts: Vec<u64> = of_topic.filter_map(|(id, _)| self.counts.get(id).copied()).collect();
        (!counts.is_empty()).then(|| counts.iter().sum())
    }

    pub(crate) fn get(&self, id: u16) -> Option<&Channel> {
        self.by_id.get(&id)
    }

    /// The topic to read pictures from: the one that was asked for, else the only one.
    pub(crate) fn picture_topic(&self, path: &Path, wanted: Option<&str>) -> Result<String, RecordingError> {
        let path = path.to_owned();
        if let Some(wanted) = wanted {
            let Some(channel) = self.by_id.values().find(|channel| channel.topic == wanted) else {
                return Err(RecordingError::NoSuchTopic {
                    path,
                    topic: wanted.to_owned(),
                    topics: self.topics(),
                });
            };
            return match channel.kind().filter(|kind| !kind.is_camera()) {
                Some(_) => Ok(wanted.to_owned()),
                None => {
                    Err(RecordingError::NotAPicture { path, topic: wanted.to_owned(), found: channel.says() })
                }
            };
        }
        let pictures =
            self.by_id.values().filter(|channel| channel.kind().is_some_and(|kind| !kind.is_camera()));
        let mut topics: Vec<&str> = pictures.map(|channel| channel.topic.as_str()).collect();
        topics.sort_unstable();
        topics.dedup();
        // Depth and labels are pictures to ROS; nobody means them.
        let means_colour = |topic: &&str| !topic.split('/').any(|part| part == "depth" || part == "labels");
        let colour: Vec<&str> = topics.iter().copied().filter(means_colour).collect();
        match if colour.is_empty() { &topics } else { &colour }.as_slice() {
            [] => Err(RecordingError::NoPictures { path, topics: self.topics() }),
            [topic] => Ok((*topic).to_owned()),
            several => Err(RecordingError::SeveralTopics { path, topics: list(several) }),
        }
    }

    /// The topic to read depth from: the one that was asked for, else the only one with `depth` in its name.
    pub(crate) fn depth_topic(&self, path: &Path, wanted: Option<&str>) -> Result<String, RecordingError> {
        if wanted.is_some() {
            return self.picture_topic(path, wanted);
        }
        let is_depth = |channel: &&Channel| {
            channel.kind() == Some(Kind::RosImage)
                && channel.topic.split('/').any(|part| part.contains("depth"))
        };
        let mut topics: Vec<&str> =
            self.by_id.values().filter(is_depth).map(|channel| channel.topic.as_str()).collect();
        topics.sort_unstable();
        topics.dedup();
        match topics.as_slice() {
            [] => Err(RecordingError::NoDepth { path: path.to_owned(), topics: self.topics() }),
            [topic] => Ok((*topic).to_owned()),
            several => Err(RecordingError::SeveralDepths { path: path.to_owned(), topics: list(several) }),
        }
    }

    /// The topic that describes the camera of a picture's topic, in the same namespace, as ROS' drivers have it. That of
    /// another namespace is another camera's.
    pub(crate) fn camera_topic(&self, picture_topic: &str) -> Option<String> {
        let cameras = || self.by_id.values().filter(|channel| channel.kind().is_some_and(Kind::is_camera));
        let parent = |topic: &str| topic.rsplit_once('/').map_or("", |(parent, _)| parent).to_owned();
        let beside = |namespace: &str| cameras().find(|channel| parent(&channel.topic) == namespace);
        // `/front/image_raw/compressed` and `/front/image_raw` both go with `/front/camera_info`.
        let namespace = parent(picture_topic);
        beside(&namespace).or_else(|| beside(&parent(&namespace))).map(|channel| channel.topic.clone())
    }

    fn topics(&self) -> String {
        let mut named: Vec<String> = self
            .by_id
            .values()
            .map(|channel| format!("`{:.60}` ({})", channel.topic, channel.says()))
            .collect();
        named.sort();
        named.dedup();
        if named.is_empty() { "no topics at all".to_owned() } else { some_of(named) }
    }
}

fn list(topics: &[&str]) -> String {
    some_of(topics.iter().map(|topic| format!("`{topic:.60}`")).collect())
}

/// A robot's recording may have hundreds.
fn some_of(mut named: Vec<String>) -> String {
    const SHOWN: usize = 12;
    let more = named.len().saturating_sub(SHOWN);
    named.truncate(SHOWN);
    let rest = if more > 0 { format!(", and {more} more") } else { String::new() };
    named.join(", ") + &rest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn channels(all: &[(&str, &str, &str)]) -> Channels {
        let channel = |&(topic, schema, encoding): &(&str, &str, &str)| Channel {
            topic: topic.to_owned(),
            schema: schema.to_owned(),
            encoding: encoding.to_owned(),
        };
        Channels { by_id: (1..).zip(all.iter().map(channel)).collect(), ..Channels::default() }
    }

    const IMAGE: &str = "sensor_msgs/msg/Image";
    const INFO: &str = "sensor_msgs/msg/CameraInfo";

    fn topic(all: &[(&str, &str, &str)], wanted: Option<&str>) -> Result<String, String> {
        channels(all).picture_topic(Path::new("a.mcap"), wanted).map_err(|error| error.to_string())
    }

    #[test]
    fn the_only_picture_is_found_by_its_type_and_depth_is_not_meant() {
        let all = [
            ("/imu", "sensor_msgs/msg/Imu", "cdr"),
            ("/front/image_raw", IMAGE, "cdr"),
            ("/front/depth/image_raw", IMAGE, "cdr"),
        ];
        assert_eq!(topic(&all, None).unwrap(), "/front/image_raw");
        assert_eq!(topic(&all, Some("/front/depth/image_raw")).unwrap(), "/front/depth/image_raw");
    }

    #[test]
    fn two_picture_topics_are_named() {
        let error = topic(&[("/b", IMAGE, "cdr"), ("/a", IMAGE, "cdr")], None).unwrap_err();
        assert_eq!(
            error,
            "`a.mcap` has pictures on several topics: `/a`, `/b`\nhint: --topic TOPIC names one"
        );
    }

    #[test]
    fn what_is_there_is_told_where_pictures_are_not() {
        let error = topic(&[("/old", "sensor_msgs/Image", "ros1"), ("/x", "", "json")], None).unwrap_err();
        assert!(
            error.contains(
                "it has `/old` (sensor_msgs/Image as `ros1`), `/x` (messages without a type as `json`)"
            ),
            "{error}"
        );
        assert!(topic(&[], None).unwrap_err().contains("it has no topics at all"));
        let error = topic(&[("/a", IMAGE, "cdr")], Some("/c")).unwrap_err();
        assert!(error.starts_with("`a.mcap` has no topic `/c`\nhint: it has `/a`"), "{error}");
        let error = topic(&[("/i", INFO, "cdr")], Some("/i")).unwrap_err();
        assert!(
            error.ends_with(
                "carries sensor_msgs/msg/CameraInfo as `cdr`, which is no picture that can be read"
            ),
            "{error}"
        );
    }

    #[test]
    fn a_picture_goes_with_the_camera_of_its_namespace_alone() {
        let all = channels(&[("/a/camera_info", INFO, "cdr"), ("/b/camera_info", INFO, "cdr")]);
        assert_eq!(all.camera_topic("/b/image_raw").as_deref(), Some("/b/camera_info"));
        assert_eq!(all.camera_topic("/a/image_raw/compressed").as_deref(), Some("/a/camera_info"));
        assert_eq!(all.camera_topic("/c/image_raw"), None);
    }
}

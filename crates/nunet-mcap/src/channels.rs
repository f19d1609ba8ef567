//! The channels of a recording, and which of them carry images, depth and cameras.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::Path;

use crate::channel::{Channel, ChannelKind};
use crate::record::Record;
use crate::records::Records;
use crate::topics::{color_topics, depth_topics, one_transport_each};
use crate::{RecordingError, camera_topic};

/// The longest name that is kept. Those of ROS have at most 255 bytes; a hostile file can state 65,536 names
/// that fill a record each, which compress to almost nothing.
const MAX_NAME_BYTES: usize = 1024;

/// The beginning of a name, which is the whole name in every file that is not hostile.
fn kept(name: &str) -> &str {
    &name[..name.floor_char_boundary(MAX_NAME_BYTES)]
}

/// The known channels of one file.
#[derive(Debug, Default, Clone)]
pub(crate) struct Channels {
    schemas: HashMap<u16, String>,
    by_id: BTreeMap<u16, Channel>,
    /// The number of messages of each channel, if the file's index states it.
    counts: BTreeMap<u16, u64>,
    /// Log time of the first message, if the index states it.
    start_nanos: Option<u64>,
    /// Where the file is damaged or cut off, if the search for channels found that.
    damage: Option<String>,
}

impl Channels {
    /// The channels of a whole file: from its index, otherwise by reading the file. `given_up` is
    /// called at each record.
    pub(crate) fn of_file(path: &Path, given_up: &dyn Fn() -> bool) -> Result<Self, RecordingError> {
        if let Some(summary) = Records::open_summary(path)? {
            let mut channels = Self::default();
            if channels.learn_all(summary, given_up).is_ok() && !channels.by_id.is_empty() {
                return Ok(channels);
            }
        }
        let mut channels = Self::default();
        match channels.learn_all(Records::open(path)?, given_up) {
            // The channels before the damage can be read.
            Err(RecordingError::Damaged { reason, .. }) => channels.damage = Some(reason),
            learned => learned?,
        }
        Ok(channels)
    }

    fn learn_all(&mut self, mut records: Records, given_up: &dyn Fn() -> bool) -> Result<(), RecordingError> {
        while !given_up() {
            match records.next(|record| self.learn(&record)) {
                Ok(Some(())) => {}
                Ok(None) => return Ok(()),
                Err(RecordingError::DamagedChunk { reason, .. }) => self.damage = Some(reason),
                Err(error) => return Err(error),
            }
        }
        Err(RecordingError::GivenUp { path: records.path().to_owned() })
    }

    /// Records a schema, a channel or the counts.
    pub(crate) fn learn(&mut self, record: &Record<'_>) {
        match record {
            Record::Schema { id, name } => {
                self.schemas.insert(*id, kept(name).to_owned());
            }
            Record::Channel { id, schema_id, topic, encoding } => {
                let schema = self.schemas.get(schema_id).cloned().unwrap_or_default();
                self.by_id.insert(*id, Channel::new(kept(topic), schema, kept(encoding)));
            }
            Record::Statistics { counts, start_nanos } => {
                self.counts.clone_from(counts);
                self.start_nanos = (!counts.is_empty()).then_some(*start_nanos);
            }
            Record::Message { .. }
            | Record::Metadata { .. }
            | Record::MessageIndex { .. }
            | Record::Other => {}
        }
    }

    pub(crate) fn start_nanos(&self) -> Option<u64> {
        self.start_nanos
    }

    pub(crate) fn get(&self, id: u16) -> Option<&Channel> {
        self.by_id.get(&id)
    }
}

/// The topics of a recording of one file or several.
#[derive(Debug, Default)]
pub(crate) struct RecordingTopics {
    channels: Vec<Channel>,
    counts: BTreeMap<String, u64>,
    /// Whether every file states its counts.
    is_counted: bool,
    /// Where a file is damaged or cut off.
    damage: Option<String>,
}

/// What the first message of a topic shows of all its messages.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum FirstImage {
    /// They are images.
    Image,
    /// They are depth.
    Depth,
    /// They have an encoding that cannot be read: the error of the first one.
    Unreadable(String),
}

/// Judges topics by their first messages, because names and types may be ambiguous.
pub(crate) trait FirstImages {
    /// The first message of each topic; topics without an undamaged message are missing.
    fn first_images(&self, topics: &BTreeSet<&str>) -> BTreeMap<String, FirstImage>;
}

impl RecordingTopics {
    pub(crate) fn of_files<'a>(files: impl IntoIterator<Item = &'a Channels>) -> Self {
        let mut topics = Self { is_counted: true, ..Self::default() };
        for file in files {
            topics.is_counted &= !file.counts.is_empty();
            topics.damage = topics.damage.or_else(|| file.damage.clone());
            for (id, channel) in &file.by_id {
                let count = file.counts.get(id).copied().unwrap_or_default();
                *topics.counts.entry(channel.topic.clone()).or_default() += count;
                topics.channels.push(channel.clone());
            }
        }
        topics
    }

    /// The error if nothing was found because the file is damaged.
    fn is_lost(&self, path: &Path) -> Option<RecordingError> {
        let reason = self.damage.clone().filter(|_| self.channels.is_empty())?;
        Some(RecordingError::NothingLeft { path: path.to_owned(), reason })
    }

    /// The number of messages of a topic, if every file's index states it.
    pub(crate) fn count(&self, topic: &str) -> Option<u64> {
        self.counts.get(topic).copied().filter(|_| self.is_counted)
    }

    fn image_topics(&self) -> Vec<&str> {
        self.topics_of(|kind| !kind.is_camera()).into_iter().collect()
    }

    fn topics_of(&self, is_wanted: impl Fn(ChannelKind) -> bool) -> BTreeSet<&str> {
        let wanted = self.channels.iter().filter(|channel| channel.kind().is_some_and(&is_wanted));
        wanted.map(|channel| channel.topic.as_str()).collect()
    }

    /// The topic to read images from: the requested one, otherwise the only one with color.
    ///
    /// # Errors
    /// Also if its images cannot be used: each of them would be an error.
    pub(crate) fn image_topic(
        &self,
        path: &Path,
        wanted: Option<&str>,
        first: &dyn FirstImages,
    ) -> Result<String, RecordingError> {
        let first_images = |topics: &[&str]| first.first_images(&topics.iter().copied().collect());
        let (topic, found) = match wanted {
            Some(wanted) => (self.wanted_topic(path, wanted)?, first_images(&[wanted])),
            None => {
                let all = self.image_topics();
                let color = color_topics(&all);
                let found = first_images(&color);
                (self.color_topic(path, color, &found)?, found)
            }
        };
        let reason = match found.get(&topic) {
            None | Some(FirstImage::Image) => return Ok(topic),
            Some(FirstImage::Depth) => "they are depth",
            Some(FirstImage::Unreadable(reason)) => reason.as_str(),
        };
        Err(RecordingError::UnusableImages { path: path.to_owned(), topic, reason: reason.to_owned() })
    }

    /// The only one of the topics with color that is not depth.
    fn color_topic(
        &self,
        path: &Path,
        mut color: Vec<&str>,
        found: &BTreeMap<String, FirstImage>,
    ) -> Result<String, RecordingError> {
        let named = color.len();
        color.retain(|topic| found.get(*topic) != Some(&FirstImage::Depth));
        if color.is_empty() && named > 0 {
            return Err(RecordingError::OnlyDepth { path: path.to_owned(), topics: self.all() });
        }
        match color.as_slice() {
            [] => Err(self
                .is_lost(path)
                .unwrap_or_else(|| RecordingError::NoImages { path: path.to_owned(), topics: self.all() })),
            [topic] => Ok((*topic).to_owned()),
            several => Err(RecordingError::SeveralTopics { path: path.to_owned(), topics: list(several) }),
        }
    }

    /// The topic to read depth from: the requested one, otherwise the only one by name, otherwise the only
    /// one by its messages.
    pub(crate) fn depth_topic(
        &self,
        path: &Path,
        wanted: Option<&str>,
        first: &dyn FirstImages,
    ) -> Result<String, RecordingError> {
        if let Some(wanted) = wanted {
            return self.wanted_topic(path, wanted);
        }
        let all = self.image_topics();
        let mut depth = depth_topics(&all);
        if depth.is_empty() {
            let found = first.first_images(&all.iter().copied().collect());
            depth = all.into_iter().filter(|topic| found.get(*topic) == Some(&FirstImage::Depth)).collect();
            depth = one_transport_each(&depth);
        }
        match depth.as_slice() {
            [] => Err(self
                .is_lost(path)
                .unwrap_or_else(|| RecordingError::NoDepth { path: path.to_owned(), topics: self.all() })),
            [topic] => Ok((*topic).to_owned()),
            several => Err(RecordingError::SeveralDepths { path: path.to_owned(), topics: list(several) }),
        }
    }

    fn wanted_topic(&self, path: &Path, wanted: &str) -> Result<String, RecordingError> {
        let (path, topic) = (path.to_owned(), wanted.to_owned());
        let mut channels = self.channels.iter().filter(|channel| channel.topic == wanted);
        let Some(channel) = channels.next() else {
            return Err(RecordingError::NoSuchTopic { path, topic, topics: self.all() });
        };
        match channel.kind().filter(|kind| !kind.is_camera()) {
            Some(_) => Ok(topic),
            None => Err(RecordingError::NotAnImage { path, topic, found: channel.description() }),
        }
    }

    /// The topic that describes the camera of an image topic; `None` if its namespace has none.
    ///
    /// # Errors
    /// Why none of the topics in the namespace is used.
    pub(crate) fn camera_topic(&self, image_topic: &str) -> Result<Option<String>, String> {
        let cameras: Vec<&str> = self.topics_of(ChannelKind::is_camera).into_iter().collect();
        camera_topic::choose(image_topic, &self.image_topics(), &cameras)
    }

    fn all(&self) -> String {
        let named = self
            .channels
            .iter()
            .map(|channel| format!("`{:.60}` ({})", channel.topic, channel.description()));
        let named: BTreeSet<String> = named.collect();
        if named.is_empty() { "no topics at all".to_owned() } else { some_of(named.into_iter().collect()) }
    }
}

fn list(topics: &[&str]) -> String {
    some_of(topics.iter().map(|topic| format!("`{topic:.60}`")).collect())
}

/// Limits the list, because a robot's recording may have hundreds of topics.
fn some_of(mut named: Vec<String>) -> String {
    const SHOWN: usize = 12;
    let more = named.len().saturating_sub(SHOWN);
    named.truncate(SHOWN);
    let rest = if more > 0 { format!(", and {more} more") } else { String::new() };
    named.join(", ") + &rest
}

#[cfg(test)]
mod tests {
    use nunet_types::Hint as _;

    use super::*;

    fn topics(all: &[(&str, &str, &str)]) -> RecordingTopics {
        let channels =
            all.iter().map(|(topic, schema, encoding)| Channel::new(topic, (*schema).to_owned(), encoding));
        RecordingTopics { channels: channels.collect(), ..RecordingTopics::default() }
    }

    #[test]
    fn of_a_name_that_fills_a_record_little_is_kept() {
        let long = "ß".repeat(1 << 20);
        let mut channels = Channels::default();
        channels.learn(&Record::Schema { id: 1, name: &long });
        channels.learn(&Record::Channel { id: 2, schema_id: 1, topic: &long, encoding: &long });
        assert_eq!(channels.schemas[&1].len(), MAX_NAME_BYTES);
        assert_eq!(channels.get(2).unwrap().topic.len(), MAX_NAME_BYTES);
    }

    const IMAGE: &str = "sensor_msgs/msg/Image";
    const INFO: &str = "sensor_msgs/msg/CameraInfo";

    /// The topics in it begin with depth.
    struct Depth(&'static [&'static str]);

    impl FirstImages for Depth {
        fn first_images(&self, topics: &BTreeSet<&str>) -> BTreeMap<String, FirstImage> {
            let first = |topic| if self.0.contains(topic) { FirstImage::Depth } else { FirstImage::Image };
            topics.iter().map(|topic| ((*topic).to_owned(), first(topic))).collect()
        }
    }

    fn topic(all: &[(&str, &str, &str)], wanted: Option<&str>) -> Result<String, RecordingError> {
        topics(all).image_topic(Path::new("a.mcap"), wanted, &Depth(&[]))
    }

    #[test]
    fn the_only_image_is_found_by_its_type() {
        let all = [
            ("/imu", "sensor_msgs/msg/Imu", "cdr"),
            ("/front/image_raw", IMAGE, "cdr"),
            ("/front/depth/image_raw", IMAGE, "cdr"),
        ];
        assert_eq!(topic(&all, None).unwrap(), "/front/image_raw");
        assert_eq!(topic(&all, Some("/front/depth/image_raw")).unwrap(), "/front/depth/image_raw");
    }

    #[test]
    fn two_image_topics_are_named() {
        let error = topic(&[("/b", IMAGE, "cdr"), ("/a", IMAGE, "cdr")], None).unwrap_err();
        assert_eq!(error.to_string(), "`a.mcap` has images on several topics: `/a`, `/b`");
    }

    #[test]
    fn the_first_messages_decide_where_names_do_not() {
        let all = topics(&[("/oak/left/image_raw", IMAGE, "cdr"), ("/oak/stereo/image_raw", IMAGE, "cdr")]);
        let (path, depth) = (Path::new("a.mcap"), Depth(&["/oak/stereo/image_raw"]));
        assert_eq!(all.image_topic(path, None, &depth).unwrap(), "/oak/left/image_raw");
        assert_eq!(all.depth_topic(path, None, &depth).unwrap(), "/oak/stereo/image_raw");
    }

    #[test]
    fn the_topics_that_exist_are_listed_where_images_are_missing() {
        let error = topic(&[("/old", "sensor_msgs/Image", "ros1"), ("/x", "", "json")], None).unwrap_err();
        let hint = error.hint().unwrap();
        let expected =
            "it has `/old` (sensor_msgs/Image as `ros1`), `/x` (messages without a type as `json`)";
        assert!(hint.contains(expected), "{hint}");
        assert!(topic(&[], None).unwrap_err().hint().unwrap().contains("it has no topics at all"));
        let error = topic(&[("/a", IMAGE, "cdr")], Some("/c")).unwrap_err();
        assert_eq!(error.to_string(), "`a.mcap` has no topic `/c`");
        assert!(error.hint().unwrap().starts_with("it has `/a`"));
        let error = topic(&[("/i", INFO, "cdr")], Some("/i")).unwrap_err();
        assert!(matches!(error, RecordingError::NotAnImage { .. }), "{error}");
    }

    #[test]
    fn an_image_goes_with_the_camera_of_its_namespace_alone() {
        let all = topics(&[("/a/camera_info", INFO, "cdr"), ("/b/camera_info", INFO, "cdr")]);
        let camera = |image| all.camera_topic(image).unwrap();
        assert_eq!(camera("/b/image_raw").as_deref(), Some("/b/camera_info"));
        assert_eq!(camera("/a/image_raw/compressed").as_deref(), Some("/a/camera_info"));
        assert_eq!(camera("/c/image_raw"), None);
    }

    #[test]
    fn depth_that_is_stored_raw_and_compressed_is_one_stream() {
        let compressed = "/oak/stereo/image_raw/compressed";
        let all =
            [("/oak/stereo/image_raw", IMAGE, "cdr"), (compressed, "sensor_msgs/msg/CompressedImage", "cdr")];
        let depth = Depth(&["/oak/stereo/image_raw", "/oak/stereo/image_raw/compressed"]);
        let topic = topics(&all).depth_topic(Path::new("a.mcap"), None, &depth).unwrap();
        assert_eq!(topic, "/oak/stereo/image_raw");
    }
}

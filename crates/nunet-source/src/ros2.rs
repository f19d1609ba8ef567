//! Images on a live topic of ROS 2: `ros2:TOPIC`, `ros2:TOPIC@DOMAIN` or `ros2:TOPIC@zenoh`.

mod losses;

use std::sync::Arc;
use std::time::{Duration, Instant};

use nunet_ipc::Clock;
use nunet_mcap::{CameraDescription, RecordedImage, TopicDecoder, camera_topic};
use nunet_ros2_link::environment::{self, Environment};
use nunet_ros2_link::{
    Arrival, Endpoint, Link, LinkName, MessageSubscriber, MessageType, Received, Ros2Error, Ros2ErrorKind,
    check, connect, name,
};
use nunet_types::Hint as _;
use tracing::{debug, info, warn};

use self::losses::Losses;
use crate::error::{SourceError, SourceErrorKind};
use crate::recorded_image::ImageConverter;
use crate::silence::Silence;
use crate::source::Fused;
use crate::source_type::{Properties, SourceType};
use crate::{CaptureTime, Fill, Frame, OpenOptions, Source};

const PREFIX: &str = "ros2:";
/// How long one call may wait, so that a stop is noticed.
const POLL_TIMEOUT: Duration = Duration::from_millis(100);
/// How often publishers are looked for.
const DISCOVERY_PERIOD: Duration = Duration::from_millis(200);
/// How long the first images are dropped while their camera has a publisher and is not described yet: drivers
/// send both together, in any order.
const CAMERA_GRACE: Duration = Duration::from_secs(1);
/// The longest time that a subscriber without publishers is kept before one of another type takes its place.
/// The first is kept for [`DISCOVERY_PERIOD`], each further one twice as long as the last: publishers that
/// were killed may be listed for a minute, and two of different types would take turns five times per second.
const MAX_TYPE_PERIOD: Duration = Duration::from_secs(10);
/// The node to which the subscribers belong.
const NODE: &str = "nunetd_source";
const IMAGE_TYPES: [MessageType; 2] = [MessageType::Image, MessageType::CompressedImage];

/// A live topic of ROS 2.
pub(crate) struct Ros2Topic;

impl SourceType for Ros2Topic {
    fn is_named(&self, name: &str) -> bool {
        name.starts_with(PREFIX)
    }

    fn properties(&self) -> Properties {
        Properties {
            own_pace: Some("a ROS 2 topic has the rate of its publisher"),
            is_on_network: true,
            states_frame_id: true,
            no_repeat: Some("a topic has no end"),
            // Results of a camera named `camera` would be on the topics of many drivers.
            camera: "nunet",
            ..Properties::default()
        }
    }

    fn check(&self, name: &str) -> Result<(), SourceError> {
        let (_, link) = parse(name).map_err(source_error)?;
        let environment = link.environment().map_err(source_error)?;
        check(&link, &environment).map_err(source_error)
    }

    fn open(&self, name: &str, options: OpenOptions<'_>) -> Result<Box<dyn Source>, SourceError> {
        let (topic, link) = parse(name).map_err(source_error)?;
        let environment = link.environment().map_err(source_error)?;
        let source = Ros2Source::open(&topic, &link, &environment)?;
        // The coordinate frame of the message is not that of the rotated image.
        let states_frame_id = !options.has_frame_id && options.rotation.is_none();
        Ok(Box::new(Fused::new(Ros2Source { states_frame_id, ..source })))
    }
}

/// The full name of the topic, and the network that it is in: `TOPIC`, `TOPIC@DOMAIN`, or `TOPIC@` and a
/// transport like that of `--ros2`.
fn parse(name: &str) -> Result<(String, LinkName), Ros2Error> {
    let text = name.strip_prefix(PREFIX).unwrap_or(name);
    let (topic, link) = match text.split_once('@') {
        None => (text, LinkName::Dds { domain: None }),
        Some((topic, link)) if link.starts_with(|first: char| first.is_ascii_alphabetic()) => {
            (topic, link.parse()?)
        }
        Some((topic, domain)) => {
            (topic, LinkName::Dds { domain: Some(environment::domain("the domain", domain)?) })
        }
    };
    let named = name::full_name(topic).ok_or_else(|| Ros2Error::TopicName { name: topic.to_owned() });
    Ok((named?, link))
}

/// Names the node of the subscribers. Topics work without it.
fn announce(link: &dyn Link) {
    if let Err(error) = link.announce_nodes() {
        debug!("{error}");
    }
}

fn source_error(error: Ros2Error) -> SourceError {
    let kind = match error.kind() {
        Ros2ErrorKind::Argument => SourceErrorKind::Argument,
        _ => SourceErrorKind::Unavailable,
    };
    let hint = error.hint();
    let converted = match std::error::Error::source(&error) {
        None => SourceError::new(kind, error.to_string()),
        Some(_) => SourceError::new(kind, "cannot read a ROS 2 topic").with_cause(error),
    };
    hint.into_iter().fold(converted, SourceError::with_hint)
}

/// A subscriber of an image topic and of its camera. Publishers may come and go.
pub struct Ros2Source {
    topic: String,
    /// Whether frames have the coordinate frame of their message.
    states_frame_id: bool,
    images: Option<Images>,
    cameras: Box<dyn MessageSubscriber>,
    /// Whether a publisher has described the camera, if only to state that it is not calibrated.
    has_description: bool,
    described: Option<CameraDescription>,
    converter: ImageConverter,
    image: RecordedImage,
    /// The bytes of the last message.
    message: Vec<u8>,
    camera_message: Vec<u8>,
    /// Images so far, also lost and replaced ones.
    count: u64,
    /// The first image that came without its camera.
    first_image: Option<Instant>,
    looked: Option<Instant>,
    silence: Silence,
    losses: Losses,
    /// Last: the subscribers end before it.
    link: Arc<dyn Link>,
}

/// The subscriber of images, whose type is known once there is a publisher.
struct Images {
    message_type: MessageType,
    decoder: TopicDecoder,
    subscriber: Box<dyn MessageSubscriber>,
    publishers: usize,
    /// When it was made, and how long it is kept without publishers.
    made: Instant,
    kept_for: Duration,
}

impl Ros2Source {
    /// Waits for images on `topic`, a full name.
    ///
    /// # Errors
    /// The network cannot be used.
    pub fn open(topic: &str, link: &LinkName, environment: &Environment) -> Result<Self, SourceError> {
        let link = connect(link, environment).map_err(source_error)?;
        Self::over(topic, link).map_err(source_error)
    }

    /// The same over an open connection.
    fn over(topic: &str, link: Arc<dyn Link>) -> Result<Self, Ros2Error> {
        let endpoint = Endpoint { topic: &camera_topic(topic), message_type: MessageType::CameraInfo };
        let cameras = link.subscriber(NODE, &endpoint)?;
        announce(&*link);
        let mut silence = Silence::default();
        silence.begins(Instant::now());
        Ok(Self {
            topic: topic.to_owned(),
            states_frame_id: true,
            images: None,
            cameras,
            has_description: false,
            described: None,
            converter: ImageConverter::default(),
            image: RecordedImage::default(),
            message: Vec::new(),
            camera_message: Vec::new(),
            count: 0,
            first_image: None,
            looked: None,
            silence,
            losses: Losses::default(),
            link,
        })
    }

    fn try_fill(&mut self, frame: &mut Frame) -> Result<Fill, Ros2Error> {
        let now = Instant::now();
        if self.looked.is_none_or(|last| now.duration_since(last) >= DISCOVERY_PERIOD) {
            self.looked = Some(now);
            self.look_for_publishers(now)?;
        }
        let Some(images) = &mut self.images else {
            std::thread::sleep(POLL_TIMEOUT);
            return Ok(Fill::Nothing);
        };
        let taken = images.subscriber.take(&mut self.message, POLL_TIMEOUT);
        if taken == Arrival::Nothing {
            self.remind_of_silence();
            return Ok(Fill::Nothing);
        }
        self.silence.ends(Instant::now());
        images.kept_for = DISCOVERY_PERIOD;
        Ok(match taken {
            Arrival::Message(received) => self.describe(received, frame)?,
            Arrival::TooLarge { bytes, limit } => {
                self.number(frame, 0, 0);
                Fill::Failed(SourceError::bad_frame(format!(
                    "a message on topic `{}` has {bytes} bytes, expected at most {limit}",
                    self.topic
                )))
            }
            Arrival::Nothing => Fill::Nothing,
        })
    }

    /// Connects to publishers of images and of the camera, as soon as the type of the images is known.
    fn look_for_publishers(&mut self, now: Instant) -> Result<(), Ros2Error> {
        self.cameras.update()?;
        if let Some(images) = &mut self.images {
            images.publishers = images.subscriber.update()?;
            if images.publishers > 0 || now.duration_since(images.made) < images.kept_for {
                return Ok(());
            }
        }
        let types = self.link.published_types(&self.topic)?;
        let current = self.images.as_ref().map(|images| images.message_type);
        let is_new =
            |known: &MessageType| types.iter().any(|name| name == known.name()) && current != Some(*known);
        match IMAGE_TYPES.into_iter().find(is_new) {
            Some(message_type) => self.subscribe(message_type, now),
            None => {
                self.remind_of_type(&types);
                Ok(())
            }
        }
    }

    fn subscribe(&mut self, message_type: MessageType, now: Instant) -> Result<(), Ros2Error> {
        // It ends first: a topic has one type at a time.
        let last_kept_for = self.images.take().map(|last| last.kept_for);
        let Some(decoder) = TopicDecoder::new(&self.topic, message_type.name()) else { return Ok(()) };
        let endpoint = Endpoint { topic: &self.topic, message_type };
        let mut subscriber = self.link.subscriber(NODE, &endpoint)?;
        let publishers = subscriber.update()?;
        announce(&*self.link);
        info!("subscribed to topic `{}` ({})", self.topic, message_type.name());
        if last_kept_for.is_none() {
            self.silence.begins(now);
        }
        let kept_for = last_kept_for.map_or(DISCOVERY_PERIOD, |last| (2 * last).min(MAX_TYPE_PERIOD));
        self.images = Some(Images { message_type, decoder, subscriber, publishers, made: now, kept_for });
        Ok(())
    }

    fn describe(&mut self, received: Received, frame: &mut Frame) -> Result<Fill, Ros2Error> {
        let Received { lost, replaced, .. } = received;
        self.losses.add(lost, &self.topic);
        let Some(Images { decoder, .. }) = &self.images else { return Ok(Fill::Nothing) };
        let decoder = *decoder;
        self.update_camera(decoder);
        if self.is_camera_expected()? {
            self.count += lost + replaced + 1;
            return Ok(Fill::Nothing);
        }
        self.number(frame, lost, replaced);
        Ok(match decoder.image(&self.message, &mut self.image) {
            Ok(()) => self.fill_image(received, frame),
            Err(reason) => {
                let message = format!("cannot read an image on topic `{}`: {reason}", self.topic);
                Fill::Failed(SourceError::bad_frame(message))
            }
        })
    }

    fn fill_image(&mut self, received: Received, frame: &mut Frame) -> Fill {
        self.image.log_nanos = u64::try_from(received.unix_nanos).unwrap_or(0);
        let unix_nanos = self.image.unix_nanos();
        frame.capture = CaptureTime { nanos: unix_nanos, clock: Clock::Unix, unix_nanos };
        if self.states_frame_id {
            frame.frame_id.clone_from(&self.image.frame_id);
        }
        let Self { converter, image, topic, described, .. } = self;
        match converter.fill(frame, image, topic, described.as_ref()) {
            Ok(()) => Fill::Frame,
            Err(error) => Fill::Failed(error),
        }
    }

    /// Reads the description of the camera that has come meanwhile.
    fn update_camera(&mut self, decoder: TopicDecoder) {
        if let Arrival::Message(_) = self.cameras.take(&mut self.camera_message, Duration::ZERO) {
            decoder.update_camera(&self.camera_message, &mut self.described);
            self.has_description = true;
        }
    }

    /// Whether the first description of the camera is probably on its way.
    fn is_camera_expected(&mut self) -> Result<bool, Ros2Error> {
        let now = Instant::now();
        let is_late = now.duration_since(*self.first_image.get_or_insert(now)) >= CAMERA_GRACE;
        // Its publisher may have been found after that of the images.
        Ok(!self.has_description && !is_late && self.cameras.update()? > 0)
    }

    /// Numbers a frame, after others that were lost or replaced.
    fn number(&mut self, frame: &mut Frame, lost: u64, replaced: u64) {
        self.count += lost + replaced + 1;
        (frame.sequence, frame.superseded) = (self.count - 1, replaced);
    }

    fn remind_of_silence(&mut self) {
        let publishers = self.images.as_ref().map_or(0, |images| images.publishers);
        let what = if publishers == 0 { "nothing publishes it" } else { "its publisher sends nothing" };
        self.remind(what);
    }

    /// Reports that there is no publisher of images. Existing publishers are found within a second.
    fn remind_of_type(&mut self, types: &[String]) {
        if types.iter().all(|name| IMAGE_TYPES.iter().any(|known| known.name() == name)) {
            return self.remind("nothing publishes it");
        }
        let [image, compressed] = IMAGE_TYPES.map(MessageType::name);
        self.remind(&format!("it has type {}, expected {image} or {compressed}", types.join(", ")));
    }

    fn remind(&mut self, what: &str) {
        let now = Instant::now();
        if self.silence.is_long(now) && self.silence.is_news(now) {
            warn!("waiting for topic `{}`: {what}", self.topic);
        }
    }
}

impl Source for Ros2Source {
    fn fill(&mut self, frame: &mut Frame) -> Fill {
        self.try_fill(frame).unwrap_or_else(|error| Fill::Broken(source_error(error)))
    }

    fn is_live(&self) -> bool {
        true
    }

    fn is_waiting(&self) -> bool {
        self.silence.is_waiting()
    }
}

#[cfg(test)]
mod tests;

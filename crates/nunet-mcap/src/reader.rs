//! A recording as a sequence of images with their camera.

use std::path::Path;

use crate::bag::{Bag, RecordingPart};
use crate::camera::CameraDescription;
use crate::channel::Channel;
use crate::channels::{Channels, RecordingTopics};
use crate::damage::Damage;
use crate::decode::{self, ReadMode};
use crate::image::{Purpose, RecordedImage};
use crate::peek::{LOOK_AHEAD, LOOK_AHEAD_BYTES, Peek};
use crate::record::Record;
use crate::records::Records;
use crate::writer::ABOUT;
use crate::{RecordingError, attitude, parts};

/// How many records without an image are read before [`Recording::next`] returns [`Next::Nothing`].
const RECORDS_PER_CALL: usize = 256;

/// The model of a recording with nunetd's results; `None` for any other file.
#[must_use]
pub fn model_of_results(path: &Path) -> Option<String> {
    let first = parts::parts(path).ok()?.into_iter().next()?;
    let mut records = Records::open(&first).ok()?;
    for _ in 0..LOOK_AHEAD {
        let found = records.next(|record| match record {
            Record::Metadata { name, entries } if name == ABOUT => {
                Some(entries.get("model").map(|model| (*model).to_owned()))
            }
            Record::Message { .. } => Some(None), // it is before the first one
            _ => None,
        });
        match found {
            Ok(Some(None)) => {}
            Ok(Some(Some(model))) => return model,
            Ok(None) | Err(_) => return None,
        }
    }
    None
}

/// A recording that is read from its beginning; of a split bag, part after part.
pub struct Recording {
    parts: Vec<RecordingPart>,
    /// Parts that are missing, which are reported at the end.
    missing: Vec<RecordingError>,
    damage: Damage,
    /// Which part is being read.
    part: usize,
    topic: String,
    camera_topic: Option<String>,
    attitude_topic: Option<String>,
    /// The last attitude that belongs to no image yet, with its stamp.
    attitude: Option<(i64, [f32; 2])>,
    read_mode: ReadMode,
    records: Records,
    channels: Channels,
    camera: Option<CameraDescription>,
    first_camera: Option<CameraDescription>,
    images: u64,
    count: Option<u64>,
}

/// The outcome of [`Recording::next`].
#[derive(Debug)]
pub enum Next {
    /// An image.
    Image,
    /// An image that cannot be read, or a part that ends early; the next one may be good.
    Bad(RecordingError),
    /// No image among many records; call again.
    Nothing,
    /// The recording has ended and is complete.
    End,
    /// The recording ends here because it is damaged or truncated.
    Cut(RecordingError),
}

impl Recording {
    /// Opens a recording and finds the topic with images (`topic`, if there are several) and its camera.
    ///
    /// # Errors
    /// No file, not an MCAP file, no topic or several topics with images, or a topic whose images cannot be
    /// used: they are depth, or have an encoding that cannot be read.
    pub fn open(path: &Path, topic: Option<&str>) -> Result<Self, RecordingError> {
        Self::open_unless(path, topic, &|| false)
    }

    /// [`open`](Self::open) for a program that may be asked to stop meanwhile: a file without an index is
    /// read to its end, which takes long for a large one, and `given_up` is called at each record.
    ///
    /// # Errors
    /// Those of [`open`](Self::open), and [`RecordingError::GivenUp`].
    pub fn open_unless(
        path: &Path,
        topic: Option<&str>,
        given_up: &dyn Fn() -> bool,
    ) -> Result<Self, RecordingError> {
        let bag = Bag::open(path, given_up)?;
        let topics = RecordingTopics::of_files(bag.parts.iter().map(|part| &part.channels));
        let topic = topics.image_topic(path, topic, &Peek(&bag.parts))?;
        let read_mode = ReadMode::of_image_topic(&topic);
        Self::of_topic(bag, &topics, topic, read_mode)
    }

    /// Opens a recording's depth: on `topic`, else on the only topic with depth.
    ///
    /// # Errors
    /// As [`Recording::open`].
    pub fn open_depth(path: &Path, topic: Option<&str>) -> Result<Self, RecordingError> {
        let bag = Bag::open(path, &|| false)?;
        let topics = RecordingTopics::of_files(bag.parts.iter().map(|part| &part.channels));
        let topic = topics.depth_topic(path, topic, &Peek(&bag.parts))?;
        let read_mode = ReadMode::of_topic(&topic, Purpose::Depth);
        Self::of_topic(bag, &topics, topic, read_mode)
    }

    fn of_topic(
        bag: Bag,
        topics: &RecordingTopics,
        topic: String,
        read_mode: ReadMode,
    ) -> Result<Self, RecordingError> {
        let (camera_topic, first_camera) = match topics.camera_topic(&topic) {
            Ok(camera_topic) => (camera_topic, None),
            Err(reason) => (None, Some(CameraDescription::unusable(reason))),
        };
        let mut recording = Self {
            camera_topic,
            read_mode,
            count: topics.count(&topic),
            attitude_topic: attitude::topic_of(&topic),
            attitude: None,
            topic,
            records: Records::open(&bag.parts[0].path)?,
            channels: bag.parts[0].channels.clone(),
            parts: bag.parts,
            missing: bag.missing,
            damage: Damage::default(),
            part: 0,
            camera: first_camera.clone(),
            first_camera,
            images: 0,
        };
        recording.find_first_camera()?;
        Ok(recording)
    }

    /// The topic whose images are read.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// The number of images, if the file's index states it.
    #[must_use]
    pub fn image_count(&self) -> Option<u64> {
        self.count
    }

    /// The camera of the last description. Before the first one, that of the first.
    #[must_use]
    pub fn camera(&self) -> Option<&CameraDescription> {
        self.camera.as_ref()
    }

    /// Restarts from the beginning.
    ///
    /// # Errors
    /// The file does not exist anymore.
    pub fn rewind(&mut self) -> Result<(), RecordingError> {
        self.open_part(0)?;
        self.camera.clone_from(&self.first_camera);
        self.images = 0;
        Ok(())
    }

    fn open_part(&mut self, part: usize) -> Result<(), RecordingError> {
        self.records = Records::open(&self.parts[part].path)?;
        // Channels of a damaged chunk are known from the index.
        self.channels = self.parts[part].channels.clone();
        self.damage = Damage::default();
        self.part = part;
        Ok(())
    }

    /// Reads up to the next image into `image`.
    pub fn next(&mut self, image: &mut RecordedImage) -> Next {
        for _ in 0..RECORDS_PER_CALL {
            if let Some(error) = self.damage.report() {
                self.images += 1;
                return Next::Bad(error);
            }
            let is_last = self.part + 1 == self.parts.len();
            let step = self.damage.take_deferred().map_or_else(|| self.step(image), Err);
            match &step {
                Err(RecordingError::DamagedChunk { path, reason }) => {
                    if let Some(error) = self.damage.begin(path, reason) {
                        self.images += 1;
                        return Next::Bad(error);
                    }
                    continue;
                }
                Ok(Some(RecordOutcome::Index(images))) => self.damage.count(*images),
                _ => self.damage.close(),
            }
            match step {
                Ok(Some(RecordOutcome::Image)) => return Next::Image,
                Ok(Some(RecordOutcome::Bad(error))) => return Next::Bad(error),
                Ok(Some(RecordOutcome::Index(_) | RecordOutcome::Other)) => {}
                Ok(None) if self.damage.is_pending() => {}
                Ok(None) if is_last => return self.missing.pop().map_or(Next::End, Next::Bad),
                Err(error) if self.damage.is_pending() => self.damage.defer(error),
                Err(error) if is_last => return Next::Cut(error),
                Ok(None) => {
                    if let Err(error) = self.open_part(self.part + 1) {
                        return Next::Cut(error);
                    }
                }
                // Continue with the other parts.
                Err(error) => {
                    return self.open_part(self.part + 1).map_or_else(Next::Cut, |()| Next::Bad(error));
                }
            }
        }
        Next::Nothing
    }

    fn step(&mut self, image: &mut RecordedImage) -> Result<Option<RecordOutcome>, RecordingError> {
        let Self { channels, topic, camera_topic, attitude_topic, read_mode, camera, images, .. } = self;
        let last_attitude = &mut self.attitude;
        self.records.next(|record| {
            channels.learn(&record);
            let is_image = |id| {
                let channel = channels.get(id).filter(|channel| channel.topic == *topic);
                channel.and_then(Channel::kind).is_some_and(|kind| !kind.is_camera())
            };
            if let Record::MessageIndex { channel_id, messages } = record {
                return RecordOutcome::Index(if is_image(channel_id) { messages } else { 0 });
            }
            let Record::Message { channel_id, log_time, data } = record else { return RecordOutcome::Other };
            let Some(channel) = channels.get(channel_id) else { return RecordOutcome::Other };
            if channel.is_imu() && Some(&channel.topic) == attitude_topic.as_ref() {
                *last_attitude = attitude::read(data);
            }
            let Some(kind) = channel.kind() else { return RecordOutcome::Other };
            if channel.topic == *topic && !kind.is_camera() {
                *images += 1;
                image.log_nanos = log_time;
                let decoded = decode::image(kind, data, *read_mode, image);
                let own = last_attitude.take().filter(|(stamp_nanos, _)| *stamp_nanos == image.stamp_nanos);
                image.roll_pitch_rad = own.map(|(_, roll_pitch_rad)| roll_pitch_rad);
                return match decoded {
                    Ok(()) => RecordOutcome::Image,
                    Err(error) => RecordOutcome::Bad(RecordingError::Message {
                        topic: topic.clone(),
                        number: *images,
                        reason: error.to_string(),
                    }),
                };
            }
            if kind.is_camera() && Some(&channel.topic) == camera_topic.as_ref() {
                decode::update_camera(kind, data, *read_mode, camera);
            }
            RecordOutcome::Other
        })
    }

    /// Searches for the first description of the camera, because images may precede it.
    fn find_first_camera(&mut self) -> Result<(), RecordingError> {
        let Some(camera_topic) = self.camera_topic.clone() else { return Ok(()) };
        let (mut channels, read_mode, mut bytes) = (self.parts[0].channels.clone(), self.read_mode, 0);
        for _ in 0..LOOK_AHEAD {
            let found = self.records.next(|record| {
                channels.learn(&record);
                let Record::Message { channel_id, data, .. } = record else { return None };
                bytes += data.len();
                let channel = channels.get(channel_id).filter(|channel| channel.topic == camera_topic)?;
                let kind = channel.kind().filter(|kind| kind.is_camera())?;
                decode::camera(kind, data, read_mode).ok()
            });
            match found {
                Ok(Some(Some(camera))) => {
                    self.first_camera = Some(camera);
                    break;
                }
                Ok(Some(None)) if bytes < LOOK_AHEAD_BYTES => {}
                Err(RecordingError::DamagedChunk { .. }) => {}
                _ => break,
            }
        }
        self.rewind()
    }
}

enum RecordOutcome {
    Image,
    Bad(RecordingError),
    /// The number of images in the previous chunk.
    Index(u64),
    Other,
}

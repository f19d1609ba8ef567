//! A recording as a sequence of pictures with their camera.

use std::path::{Path, PathBuf};

use mcap::records::{MessageHeader, Record};

use crate::channels::{Channels, Kind};
use crate::foxglove_messages::{self, Said};
use crate::messages::{CameraInfo, CompressedImage, Image};
use crate::records::Records;
use crate::writer::ABOUT;
use crate::{CameraDescription, Picture, RecordingError, cdr};

/// How many records are looked through for the camera of the first pictures, and how many bytes of messages.
const LOOK_AHEAD: usize = 10_000;
const LOOK_AHEAD_BYTES: usize = 64 << 20;
/// How many records without a picture are read before the caller is asked again.
const PATIENCE: usize = 256;

/// The model whose results stand in a recording that nunetd has written; `None` of every other recording, and of what is
/// no recording.
#[must_use]
pub fn model_of_results(path: &Path) -> Option<String> {
    let mut records = Records::open(path).ok()?;
    for _ in 0..LOOK_AHEAD {
        let found = records.next(|record| match record {
            Record::Metadata(about) if about.name == ABOUT => Some(about.metadata.get("model").cloned()),
            Record::Message { .. } => Some(None), // it stands before the first one
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

/// A recording that is read from its beginning.
pub struct Recording {
    path: PathBuf,
    topic: String,
    camera_topic: Option<String>,
    /// Whether the pictures were freed of their lens, as ROS' names say.
    rectified: bool,
    records: Records,
    channels: Channels,
    camera: Option<CameraDescription>,
    first_camera: Option<CameraDescription>,
    pictures: u64,
    count: Option<u64>,
}

/// What came next.
#[derive(Debug)]
pub enum Next {
    /// A picture.
    Picture,
    /// A picture that makes no sense; the next one may be good.
    Bad(RecordingError),
    /// No picture for a while; ask again.
    Nothing,
    /// The recording is over, whole.
    End,
    /// The recording is over because it is damaged or was cut off here.
    Cut(RecordingError),
}

impl Recording {
    /// Opens a recording and finds the topic with pictures (`topic`, where there are several) and its camera.
    ///
    /// # Errors
    /// No file, no MCAP, no topic or several topics with pictures.
    pub fn open(path: &Path, topic: Option<&str>) -> Result<Self, RecordingError> {
        Self::open_unless(path, topic, &|| false)
    }

    /// [`open`](Self::open) for a program that may be asked to stop meanwhile: a file without an index is read to its end,
    /// which takes long where it is large, and `given_up` is asked at each record.
    ///
    /// # Errors
    /// Those of [`open`](Self::open), and [`RecordingError::GivenUp`].
    pub fn open_unless(
        path: &Path,
        topic: Option<&str>,
        given_up: &dyn Fn() -> bool,
    ) -> Result<Self, RecordingError> {
        let channels = Channels::of_file(path, given_up)?;
        let topic = channels.picture_topic(path, topic)?;
        Self::of_topic(path, &channels, topic)
    }

    /// Opens a recording's depth: on `topic`, else on the only topic with `depth` in its name.
    ///
    /// # Errors
    /// As [`Recording::open`].
    pub fn open_depth(path: &Path, topic: Option<&str>) -> Result<Self, RecordingError> {
        let channels = Channels::of_file(path, &|| false)?;
        let topic = channels.depth_topic(path, topic)?;
        Self::of_topic(path, &channels, topic)
    }

    fn of_topic(path: &Path, channels: &Channels, topic: String) -> Result<Self, RecordingError> {
        let mut recording = Self {
            path: path.to_owned(),
            camera_topic: channels.camera_topic(&topic),
            rectified: topic.split('/').any(|part| part.starts_with("image_rect")),
            count: channels.count(&topic),
            topic,
            records: Records::open(path)?,
            channels: Channels::default(),
            camera: None,
            first_camera: None,
            pictures: 0,
        };
        recording.find_first_camera()?;
        Ok(recording)
    }

    /// The topic whose pictures are read.
    #[must_use]
    pub fn topic(&self) -> &str {
        &self.topic
    }

    /// How many pictures there are, where the file's index says so.
    #[must_use]
    pub fn picture_count(&self) -> Option<u64> {
        self.count
    }

    /// The camera as last described; at first as it will be described first.
    #[must_use]
    pub fn camera(&self) -> Option<&CameraDescription> {
        self.camera.as_ref()
    }

    /// Begins again.
    ///
    /// # Errors
    /// The file is gone.
    pub fn rewind(&mut self) -> Result<(), RecordingError> {
        self.records = Records::open(&self.path)?;
        self.channels = Channels::default();
        self.camera.clone_from(&self.first_camera);
        self.pictures = 0;
        Ok(())
    }

    /// Reads up to the next picture into `picture`.
    pub fn next(&mut self, picture: &mut Picture) -> Next {
        for _ in 0..PATIENCE {
            match self.step(picture) {
                Ok(Some(Step::Picture)) => return Next::Picture,
                Ok(Some(Step::Bad(error))) => return Next::Bad(error),
                Ok(Some(Step::Other)) => {}
                Ok(None) => return Next::End,
                Err(error) => return Next::Cut(error),
            }
        }
        Next::Nothing
    }

    fn step(&mut self, picture: &mut Picture) -> Result<Option<Step>, RecordingError> {
        let Self { channels, topic, camera_topic, rectified, camera, pictures, .. } = self;
        self.records.next(|record| {
            channels.learn(&record);
            let Record::Message { header, data } = record else { return Step::Other };
            let Some(channel) = channels.get(header.channel_id) else { return Step::Other };
            let Some(kind) = channel.kind() else { return Step::Other };
            let is_picture = channel.topic == *topic && !kind.is_camera();
            if !is_picture && Some(&channel.topic) != camera_topic.as_ref() {
                return Step::Other;
            }
            *pictures += u64::from(is_picture);
            match said(kind, &header, &data, *rectified, picture) {
                Ok(Said::Picture) => Step::Picture,
                Ok(Said::Camera(described)) => {
                    *camera = described;
                    Step::Other
                }
                Err(reason) if is_picture => {
                    Step::Bad(RecordingError::Message { topic: topic.clone(), number: *pictures, reason })
                }
                Err(_) => Step::Other, // a camera that is described badly once is known from before
            }
        })
    }

    /// Pictures may come before their camera is described.
    fn find_first_camera(&mut self) -> Result<(), RecordingError> {
        let Some(camera_topic) = self.camera_topic.clone() else { return Ok(()) };
        let (mut channels, rectified, mut bytes) = (Channels::default(), self.rectified, 0);
        for _ in 0..LOOK_AHEAD {
            let found = self.records.next(|record| {
                channels.learn(&record);
                let Record::Message { header, data } = record else { return None };
                bytes += data.len();
                let channel =
                    channels.get(header.channel_id).filter(|channel| channel.topic == camera_topic)?;
                match said(channel.kind()?, &header, &data, rectified, &mut Picture::default()) {
                    Ok(Said::Camera(camera)) => Some(camera),
                    _ => None,
                }
            });
            match found {
                // One that is not calibrated now will not be later.
                Ok(Some(Some(camera))) => {
                    self.first_camera = camera;
                    break;
                }
                Ok(Some(None)) if bytes < LOOK_AHEAD_BYTES => {}
                _ => break,
            }
        }
        self.rewind()
    }
}

enum Step {
    Picture,
    Bad(RecordingError),
    Other,
}

fn said(
    kind: Kind,
    header: &MessageHeader,
    data: &[u8],
    rectified: bool,
    picture: &mut Picture,
) -> Result<Said, String> {
    picture.log_nanos = header.log_time;
    match kind {
        Kind::RosImage => {
            let image: Image<'_> = cdr::decode(data)?;
            picture.set_ros_image(&image).map(|()| Said::Picture)
        }
        Kind::RosCompressedImage => {
            let image: CompressedImage<'_> = cdr::decode(data)?;
            picture.set_ros_compressed(&image).map(|()| Said::Picture)
        }
        Kind::RosCameraInfo => {
            let info: CameraInfo<'_> = cdr::decode(data)?;
            Ok(Said::Camera(CameraDescription::of_ros(&info, rectified)))
        }
        Kind::Foxglove(form, kind) => foxglove_messages::read(kind, form, data, rectified, picture),
    }
}

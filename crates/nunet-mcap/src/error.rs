//! The errors of recordings.

use std::borrow::Cow;
use std::path::PathBuf;

use nunet_types::Hint;

/// The kind of a [`RecordingError`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum RecordingErrorKind {
    /// The file cannot be opened, read or written.
    Io,
    /// The file exists already, or another process writes it.
    Occupied,
    /// The file is not an MCAP file.
    Format,
    /// The file is damaged or cut off.
    Damaged,
    /// Reading was canceled by the caller.
    GivenUp,
    /// The recording has no images or no depth.
    NothingToRead,
    /// The requested topic is missing or has another content, or a topic must be requested.
    Topic,
    /// One message cannot be read.
    Message,
}

/// An error of reading or writing a recording.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// The file cannot be opened, read or written.
    #[error("cannot {what} the recording `{}`", path.display())]
    Io {
        /// The failed operation: open, read, write.
        what: &'static str,
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// The file exists already.
    #[error("`{}` already exists", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// Another recording is being written into the file.
    #[error("`{}` is being written by another process", path.display())]
    InUse {
        /// The file.
        path: PathBuf,
    },
    /// The file does not begin as MCAP files do.
    #[error("`{}` is not an MCAP file: {reason}", path.display())]
    NotMcap {
        /// The file.
        path: PathBuf,
        /// What it is instead.
        reason: &'static str,
    },
    /// The folder is not a recording.
    #[error("`{}` is a folder without a recording: {reason}", path.display())]
    NotARecordingFolder {
        /// The folder.
        path: PathBuf,
        /// What was found.
        reason: String,
        /// What to name instead.
        hint: String,
    },
    /// The file is damaged or truncated here; all messages before were read.
    #[error("the recording `{}` is damaged or cut off: {reason}; every message before was read", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What was found.
        reason: String,
    },
    /// A chunk of the file is damaged; the rest can be read.
    #[error("the recording `{}` has a damaged chunk, and an image in it is lost: {reason}", path.display())]
    DamagedChunk {
        /// The file.
        path: PathBuf,
        /// What was found.
        reason: String,
    },
    /// The file is damaged or cut off before its first message.
    #[error("the recording `{}` has nothing before the place where it is damaged or cut off: {reason}", path.display())]
    NothingLeft {
        /// The file.
        path: PathBuf,
        /// What was found.
        reason: String,
    },
    /// Parts of a split recording are missing, by their numbers.
    #[error("parts of the recording are missing before `{}`: {count}, from number {first}", path.display())]
    MissingParts {
        /// The part behind them.
        path: PathBuf,
        /// The number of the first one.
        first: u64,
        /// How many.
        count: u64,
    },
    /// The file has no index, and the search for its topics was canceled by a shutdown.
    #[error("the recording `{}` was not read to its end: a stop was requested", path.display())]
    GivenUp {
        /// The file.
        path: PathBuf,
    },
    /// No topic carries images.
    #[error("`{}` has no topic with images", path.display())]
    NoImages {
        /// The file.
        path: PathBuf,
        /// The topics that exist.
        topics: String,
    },
    /// Every topic that could carry images carries depth.
    #[error("`{}` has depth but no images", path.display())]
    OnlyDepth {
        /// The file.
        path: PathBuf,
        /// The topics that exist.
        topics: String,
    },
    /// Several topics carry images.
    #[error("`{}` has images on several topics: {topics}", path.display())]
    SeveralTopics {
        /// The file.
        path: PathBuf,
        /// Their names.
        topics: String,
    },
    /// No topic carries depth.
    #[error("`{}` has no topic with depth", path.display())]
    NoDepth {
        /// The file.
        path: PathBuf,
        /// The topics that exist.
        topics: String,
    },
    /// Several topics carry depth.
    #[error("`{}` has depth on several topics: {topics}", path.display())]
    SeveralDepths {
        /// The file.
        path: PathBuf,
        /// Their names.
        topics: String,
    },
    /// The requested topic does not exist.
    #[error("`{}` has no topic `{topic:.60}`", path.display())]
    NoSuchTopic {
        /// The file.
        path: PathBuf,
        /// What was asked for.
        topic: String,
        /// The topics that exist.
        topics: String,
    },
    /// The requested topic has messages of another type.
    #[error("topic `{topic:.60}` of `{}` carries {found}, which is not an image that can be read", path.display())]
    NotAnImage {
        /// The file.
        path: PathBuf,
        /// What was asked for.
        topic: String,
        /// Type and encoding of its messages.
        found: String,
    },
    /// The images of a topic cannot be used: they are depth, or their encoding cannot be read.
    #[error("topic `{topic:.60}` of `{}` has no images that can be used: {reason:.600}", path.display())]
    UnusableImages {
        /// The file.
        path: PathBuf,
        /// The topic.
        topic: String,
        /// Why not.
        reason: String,
    },
    /// One message cannot be read; the next one may be good.
    #[error("message {number} on topic `{topic:.60}`: {reason:.600}")]
    Message {
        /// The topic.
        topic: String,
        /// Which of the topic's messages, from 1.
        number: u64,
        /// What is wrong with it.
        reason: String,
    },
    /// The recording cannot be continued.
    #[error("cannot write the recording `{}`", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        source: mcap::McapError,
    },
    /// A message is larger than the format allows.
    #[error("cannot encode a message of topic `{topic}`: {reason}")]
    Encode {
        /// The topic.
        topic: String,
        /// Why.
        reason: String,
    },
}

impl RecordingError {
    /// The kind of the error.
    #[must_use]
    pub fn kind(&self) -> RecordingErrorKind {
        match self {
            Self::Io { .. } | Self::Write { .. } | Self::Encode { .. } => RecordingErrorKind::Io,
            Self::Exists { .. } | Self::InUse { .. } => RecordingErrorKind::Occupied,
            Self::NotMcap { .. } | Self::NotARecordingFolder { .. } => RecordingErrorKind::Format,
            Self::Damaged { .. }
            | Self::DamagedChunk { .. }
            | Self::NothingLeft { .. }
            | Self::MissingParts { .. } => RecordingErrorKind::Damaged,
            Self::GivenUp { .. } => RecordingErrorKind::GivenUp,
            Self::NoImages { .. } | Self::OnlyDepth { .. } | Self::NoDepth { .. } => {
                RecordingErrorKind::NothingToRead
            }
            Self::SeveralTopics { .. }
            | Self::SeveralDepths { .. }
            | Self::NoSuchTopic { .. }
            | Self::NotAnImage { .. }
            | Self::UnusableImages { .. } => RecordingErrorKind::Topic,
            Self::Message { .. } => RecordingErrorKind::Message,
        }
    }
}

impl Hint for RecordingError {
    fn setting(&self) -> Option<&'static str> {
        match self {
            Self::SeveralTopics { .. } | Self::UnusableImages { .. } => Some("topic"),
            Self::SeveralDepths { .. } | Self::NoDepth { .. } => Some("depth-topic"),
            Self::Exists { .. } => Some("force"),
            _ => None,
        }
    }

    fn hint(&self) -> Option<Cow<'static, str>> {
        Some(match self {
            Self::Exists { .. } => "choose another name, or allow the file to be overwritten".into(),
            Self::InUse { .. } => "stop the other process, or choose another name".into(),
            Self::NotMcap { path, reason } => return crate::other_files::conversion_hint(path, reason),
            Self::NotARecordingFolder { hint, .. } => hint.clone().into(),
            Self::NoImages { topics, .. } if topics.contains("as `ros1`") => format!(
                "messages in ROS 1's encoding are not read: convert the original bag with `rosbags-convert --dst-storage \
                 mcap` (`pip install rosbags`); it has {topics}"
            )
            .into(),
            Self::NoImages { topics, .. } => format!(
                "sensor_msgs/msg/Image and CompressedImage in CDR and foxglove.RawImage and CompressedImage in protobuf, JSON \
                 and CDR are read; it has {topics}"
            )
            .into(),
            Self::OnlyDepth { topics, .. } => {
                format!("record the color or gray images of a camera; it has {topics}").into()
            }
            Self::SeveralTopics { .. } | Self::SeveralDepths { .. } => "name one of the topics".into(),
            Self::NoDepth { topics, .. } => format!(
                "depth is read from images in 32FC1 or 16UC1 (raw or PNG) and from compressedDepth; name the topic if it is one of \
                 {topics}"
            )
            .into(),
            Self::NoSuchTopic { topics, .. } => format!("it has {topics}").into(),
            Self::NotAnImage { .. } => "name a topic with images, or omit the topic".into(),
            Self::UnusableImages { .. } => "name a topic with color or gray images".into(),
            Self::NothingLeft { .. } => "copy the recording again: nothing can be recovered from this file".into(),
            Self::Damaged { .. } => "copy the recording again, or repair it with `mcap recover`".into(),
            Self::DamagedChunk { .. } => "copy the recording again: the other images can be read".into(),
            Self::MissingParts { .. } => "copy the missing parts into the folder of the recording".into(),
            Self::Write { source: mcap::McapError::Io(error), .. } | Self::Io { source: error, .. }
                if error.kind() == std::io::ErrorKind::StorageFull =>
            {
                "free some space, or write to another disk".into()
            }
            Self::Io { .. }
            | Self::GivenUp { .. }
            | Self::Message { .. }
            | Self::Write { .. }
            | Self::Encode { .. } => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_that_is_cut_in_its_first_record_has_a_hint() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.mcap");
        for bytes in [&b"\x89MCAP0\r\n"[..], b"\x89MCAP0\r\n\x01\x10\0\0\0\0\0\0\0ros2"] {
            std::fs::write(&path, bytes).unwrap();
            let error = crate::Recording::open(&path, None).map(drop).unwrap_err();
            assert_eq!(error.kind(), RecordingErrorKind::Damaged, "{error}");
            assert!(error.hint().is_some_and(|hint| hint.contains("copy the recording again")), "{error}");
        }
    }
}

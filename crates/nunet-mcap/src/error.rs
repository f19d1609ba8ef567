//! What can be wrong with a recording.

use std::path::PathBuf;

/// An error of reading or writing a recording.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RecordingError {
    /// The file cannot be opened, read or written.
    #[error("cannot {what} the recording `{}`", path.display())]
    Io {
        /// open, read, write.
        what: &'static str,
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// There is a file where the recording is to be made.
    #[error("`{}` is there already, and a recording is never overwritten\nhint: --force, or another name", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// Another recording is being written into the file.
    #[error("`{}` is being written by another process\nhint: stop that one, or choose another name", path.display())]
    InUse {
        /// The file.
        path: PathBuf,
    },
    /// The file does not begin as MCAP files do.
    #[error("`{}` is no MCAP file: {reason}", path.display())]
    NotMcap {
        /// The file.
        path: PathBuf,
        /// What it is instead.
        reason: &'static str,
    },
    /// The file is damaged or cut off; every message before was read.
    #[error("the recording `{}` is damaged or cut off: every message before was read", path.display())]
    Damaged {
        /// The file.
        path: PathBuf,
        /// What was found.
        source: mcap::McapError,
    },
    /// The file has no index, and was not read to its end to find its topics, because the program was asked to stop.
    #[error("the recording `{}` was not read to its end: a stop was requested", path.display())]
    GivenUp {
        /// The file.
        path: PathBuf,
    },
    /// No topic carries pictures.
    #[error(
        "`{}` has no topic with pictures\nhint: sensor_msgs/msg/Image and CompressedImage in CDR, foxglove.RawImage and \
         CompressedImage are read; it has {topics}",
        path.display()
    )]
    NoPictures {
        /// The file.
        path: PathBuf,
        /// What there is.
        topics: String,
    },
    /// Several topics carry pictures.
    #[error("`{}` has pictures on several topics: {topics}\nhint: --topic TOPIC names one", path.display())]
    SeveralTopics {
        /// The file.
        path: PathBuf,
        /// Their names.
        topics: String,
    },
    /// No topic carries depth.
    #[error(
        "`{}` has no topic with depth\nhint: sensor_msgs/msg/Image in 32FC1 or 16UC1 on a topic with `depth` in its name, \
         or --depth-topic; it has {topics}",
        path.display()
    )]
    NoDepth {
        /// The file.
        path: PathBuf,
        /// What there is.
        topics: String,
    },
    /// Several topics carry depth.
    #[error("`{}` has depth on several topics: {topics}\nhint: --depth-topic TOPIC names one", path.display())]
    SeveralDepths {
        /// The file.
        path: PathBuf,
        /// Their names.
        topics: String,
    },
    /// The topic that was asked for is not there.
    #[error("`{}` has no topic `{topic:.60}`\nhint: it has {topics}", path.display())]
    NoSuchTopic {
        /// The file.
        path: PathBuf,
        /// What was asked for.
        topic: String,
        /// What there is.
        topics: String,
    },
    /// The topic that was asked for carries something else.
    #[error("topic `{topic:.60}` of `{}` carries {found}, which is no picture that can be read", path.display())]
    NotAPicture {
        /// The file.
        path: PathBuf,
        /// What was asked for.
        topic: String,
        /// Type and encoding of its messages.
        found: String,
    },
    /// One message makes no sense; the next one may be good.
    #[error("message {number} on topic `{topic:.60}`: {reason:.600}")]
    Message {
        /// The topic.
        topic: String,
        /// Which of the topic's messages, from 1.
        number: u64,
        /// What is wrong with it.
        reason: String,
    },
    /// The recording cannot be written further.
    #[error("cannot write the recording `{}`", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        source: mcap::McapError,
    },
    /// A message is larger than the format can say.
    #[error("cannot encode a message of topic `{topic}`: {reason}")]
    Encode {
        /// The topic.
        topic: String,
        /// Why.
        reason: String,
    },
}

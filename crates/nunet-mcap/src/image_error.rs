//! Why a message has no image that can be read.

use crate::encoding::READABLE;

/// Why a message has no image that can be read. The first two hold for all messages of a topic.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(crate) enum ImageError {
    /// Depth, on a topic that is read as images.
    #[error("`{format:.60}` is depth, not an image")]
    Depth {
        /// As the message states it.
        format: String,
    },
    /// Its encoding cannot be read.
    #[error("encoding `{encoding:.60}` cannot be read, expected {READABLE}")]
    Encoding {
        /// As the message states it.
        encoding: String,
    },
    /// The message is damaged.
    #[error("{0}")]
    Message(String),
}

impl From<String> for ImageError {
    fn from(reason: String) -> Self {
        Self::Message(reason)
    }
}

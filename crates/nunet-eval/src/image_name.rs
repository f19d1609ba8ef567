//! How errors name an image of a dataset.

use std::fmt;
use std::path::{Path, PathBuf};

/// An image, depth or labels of a dataset, as errors name it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ImageName {
    /// A file.
    File(PathBuf),
    /// A message of a recording. It is read from a temporary copy, whose path would help nobody.
    Message {
        /// The id of the pair of image and depth.
        id: String,
        /// The topic.
        topic: String,
    },
}

impl fmt::Display for ImageName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(path) => write!(f, "`{}`", path.display()),
            Self::Message { id, topic } => write!(f, "`{id}` of the topic `{topic}`"),
        }
    }
}

impl From<&Path> for ImageName {
    fn from(path: &Path) -> Self {
        Self::File(path.to_owned())
    }
}

//! How errors name an image of a dataset.

use std::fmt;
use std::path::{Path, PathBuf};

/// An image, depth or labels of a dataset, as errors name it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ImageName {
    /// A file.
    File(PathBuf),
    /// A file that was looked for with several endings.
    OneOf {
        /// Its folder.
        folder: PathBuf,
        /// Its possible names in the folder.
        names: Vec<String>,
    },
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
            Self::OneOf { folder, names } => {
                let mut shown = folder.join(names.first().map_or("", String::as_str)).display().to_string();
                for (index, name) in names.iter().enumerate().skip(1) {
                    let separator = if index + 1 == names.len() { "` or `" } else { "`, `" };
                    shown.extend([separator, name]);
                }
                write!(f, "`{shown}`")
            }
            Self::Message { id, topic } => write!(f, "`{id}` of the topic `{topic}`"),
        }
    }
}

impl From<&Path> for ImageName {
    fn from(path: &Path) -> Self {
        Self::File(path.to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_with_several_possible_endings_is_named_with_each_of_them() {
        let one_of = |names: &[&str]| {
            let names = names.iter().map(|name| (*name).to_owned()).collect();
            ImageName::OneOf { folder: "data/rgb".into(), names }.to_string()
        };
        assert_eq!(one_of(&["a.png"]), "`data/rgb/a.png`");
        assert_eq!(one_of(&["a.png", "a.npy"]), "`data/rgb/a.png` or `a.npy`");
        assert_eq!(one_of(&["a.jpg", "a.jpeg", "a.png"]), "`data/rgb/a.jpg`, `a.jpeg` or `a.png`");
    }
}

//! Camera names, and the names of the services made from them.

use std::borrow::Cow;
use std::fmt;
use std::str::FromStr;

use nunet_types::{Hint, Topic, printable};

/// The longest camera name, in bytes.
pub const MAX_CAMERA_NAME_BYTES: usize = 64;

/// The characters of a camera name besides letters and digits.
const PUNCTUATION: &str = "_-.";

/// A checked camera name: 1 to 64 of `a-z A-Z 0-9 _ - .`, beginning with a letter or a digit.
///
/// Such a name is safe in a service name, in a file name, in a ROS topic's prefix and on a terminal.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct CameraName(String);

/// Why a text is not a camera name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CameraNameError {
    /// It is empty.
    #[error("camera name is empty")]
    Empty,
    /// Too many bytes.
    #[error("camera name has {bytes} bytes, expected at most {MAX_CAMERA_NAME_BYTES}")]
    TooLong {
        /// How many there are.
        bytes: usize,
    },
    /// A character that is not allowed at its position.
    #[error(
        "camera name `{}` has {character:?} at character {position}, expected {expected}",
        printable::one_line(name)
    )]
    Character {
        /// The whole name.
        name: String,
        /// The character.
        character: char,
        /// Its position, counted from 1.
        position: usize,
        /// What is allowed there.
        expected: &'static str,
        /// A name without such characters.
        suggestion: String,
    },
}

impl Hint for CameraNameError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        Some(match self {
            Self::Empty => Cow::Borrowed("use a name like `front` or `left-arm.0`"),
            Self::TooLong { .. } => Cow::Borrowed("choose a shorter name"),
            Self::Character { suggestion, .. } => Cow::Owned(format!("use a name like `{suggestion}`")),
        })
    }
}

impl CameraName {
    /// Checks a name.
    ///
    /// # Errors
    /// [`CameraNameError`] says which character is wrong, and where.
    pub fn new(name: &str) -> Result<Self, CameraNameError> {
        if name.is_empty() {
            return Err(CameraNameError::Empty);
        }
        if name.len() > MAX_CAMERA_NAME_BYTES {
            return Err(CameraNameError::TooLong { bytes: name.len() });
        }
        for (index, character) in name.chars().enumerate() {
            let simple = character.is_ascii_alphanumeric();
            let expected = match index {
                0 if !simple => "a letter or a digit",
                _ if !simple && !PUNCTUATION.contains(character) => "one of `a-z A-Z 0-9 _ - .`",
                _ => continue,
            };
            let (name, suggestion) = (name.to_owned(), suggestion(name));
            return Err(CameraNameError::Character {
                name,
                character,
                position: index + 1,
                expected,
                suggestion,
            });
        }
        Ok(Self(name.to_owned()))
    }

    /// The name as it was given.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }

    /// The service that carries a topic: `nunet/CAMERA/TOPIC`.
    #[must_use]
    pub fn service(&self, topic: Topic) -> String {
        format!("nunet/{self}/{topic}")
    }

    /// The event service that wakes readers: `nunet/CAMERA/wake`.
    #[must_use]
    pub fn wake_service(&self) -> String {
        format!("nunet/{self}/wake")
    }
}

fn suggestion(name: &str) -> String {
    let allowed = |c: char| c.is_ascii_alphanumeric() || PUNCTUATION.contains(c);
    let fixed: String = name.chars().map(|c| if allowed(c) { c } else { '_' }).collect();
    let fixed = fixed.trim_start_matches(|c: char| !c.is_ascii_alphanumeric());
    if fixed.is_empty() { "front".to_owned() } else { fixed.to_owned() }
}

impl fmt::Display for CameraName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(&self.0)
    }
}

impl FromStr for CameraName {
    type Err = CameraNameError;

    fn from_str(name: &str) -> Result<Self, CameraNameError> {
        Self::new(name)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn service_names_are_those_of_the_contract() {
        let camera = CameraName::new("front").unwrap();
        assert_eq!(camera.service(Topic::Depth), "nunet/front/depth");
        assert_eq!(camera.wake_service(), "nunet/front/wake");
    }

    #[test]
    fn a_slash_is_refused_with_its_place_and_a_name_that_would_do() {
        let error = CameraName::new("left/arm").unwrap_err();
        assert!(error.hint().unwrap().contains("`left_arm`"), "{error:?}");
        let expected = CameraNameError::Character {
            name: "left/arm".into(),
            character: '/',
            position: 5,
            expected: "one of `a-z A-Z 0-9 _ - .`",
            suggestion: "left_arm".into(),
        };
        assert_eq!(error, expected);
    }

    #[test]
    fn a_name_must_not_begin_like_an_option_or_a_hidden_file() {
        for name in ["-v", ".hidden", "_"] {
            assert!(
                matches!(CameraName::new(name), Err(CameraNameError::Character { position: 1, .. })),
                "{name}"
            );
        }
    }

    #[test]
    fn length_is_bounded() {
        assert!(CameraName::new(&"a".repeat(64)).is_ok());
        assert_eq!(CameraName::new(&"a".repeat(65)), Err(CameraNameError::TooLong { bytes: 65 }));
        assert_eq!(CameraName::new(""), Err(CameraNameError::Empty));
    }

    proptest! {
        #[test]
        fn every_suggested_name_is_itself_a_name(name in ".{1,64}") {
            if let Err(CameraNameError::Character { suggestion, .. }) = CameraName::new(&name) {
                prop_assert!(CameraName::new(&suggestion).is_ok(), "{suggestion}");
            }
        }
    }
}

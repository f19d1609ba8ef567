//! What is wrong with the description of a model.

use std::borrow::Cow;

use nunet_types::Hint;

use super::SidecarError;
use crate::depth::DepthEncoding;
use crate::error_kind::ErrorKind;
use crate::text::shortened;

/// What is wrong with the description of a model.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// Neither metadata nor sidecar.
    #[error("the file has no `nunet.version` in its metadata, and there is no sidecar `{sidecar}`")]
    Undescribed {
        /// The name that the sidecar would have.
        sidecar: String,
    },
    /// Metadata of another version of the contract.
    #[error("metadata `nunet.version` is `{version:.60}`, expected `{expected}`")]
    Version {
        /// The file's version.
        version: String,
        /// The supported version.
        expected: &'static str,
    },
    /// A required key is absent.
    #[error("metadata `{key}` is missing")]
    Missing {
        /// The key.
        key: &'static str,
    },
    /// A value that is not valid for its key.
    #[error("metadata `{key}` is `{value}`: {reason}")]
    Invalid {
        /// The key.
        key: &'static str,
        /// Its value, shortened.
        value: String,
        /// What is wrong with it.
        reason: String,
    },
    /// An invalid sidecar.
    #[error("cannot read the sidecar `{sidecar}`")]
    Sidecar {
        /// The sidecar's file name.
        sidecar: String,
        /// What is wrong with it.
        source: SidecarError,
    },
}

/// The most characters of a value that a message repeats.
const SHOWN: usize = 60;

impl ModelError {
    /// A value that is not valid for its key, shortened.
    pub(super) fn invalid(key: &'static str, value: &str, reason: impl ToString) -> Self {
        let mut shown: String = value.chars().take(SHOWN).collect();
        if shown.len() < value.len() {
            shown.push('…');
        }
        Self::Invalid { key, value: shown, reason: shortened(&reason.to_string()) }
    }

    /// [`ErrorKind::Model`].
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        ErrorKind::Model
    }
}

impl Hint for ModelError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        match self {
            Self::Undescribed { sidecar } => Some(
                format!(
                    "describe a foreign network in `{sidecar}`: [input] tensor, layout, size and [output] depth, \
                     encoding"
                )
                .into(),
            ),
            Self::Version { .. } => {
                Some("export the model again with the recipe of this release, or use the release it was made for".into())
            }
            Self::Invalid { key: "nunet.depth.encoding", .. } => {
                Some(format!("use one of {}", DepthEncoding::names()).into())
            }
            Self::Invalid { key: "nunet.state", .. } => Some(
                "list each input and output once, with a fixed positive shape; a network without state has no such key"
                    .into(),
            ),
            Self::Missing { .. } | Self::Invalid { .. } | Self::Sidecar { .. } => None,
        }
    }
}

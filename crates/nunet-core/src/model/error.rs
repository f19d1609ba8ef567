//! What can be wrong with what a model says of itself.

use crate::text::shortened;

/// What is wrong with a model's description.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// Neither metadata nor sidecar.
    #[error(
        "it has no `nunet.version` in its metadata, and there is no sidecar `{sidecar}`\nhint: describe a foreign \
         network in `{sidecar}`: [input] tensor, layout, size and [output] depth, encoding"
    )]
    Undescribed {
        /// The name that the sidecar would have.
        sidecar: String,
    },
    /// Metadata of another version of the contract.
    #[error(
        "its metadata has `nunet.version` `{version:.60}`, but this program reads version `{expected}`\nhint: export the \
         model again with this release's recipe, or use the release that it was made for"
    )]
    Version {
        /// The file's.
        version: String,
        /// Ours.
        expected: &'static str,
    },
    /// A key that must be there is not.
    #[error("its metadata has no `{key}`")]
    Missing {
        /// The key.
        key: &'static str,
    },
    /// A key has a value that means nothing.
    #[error("its metadata has `{key}` `{value}`: {reason}")]
    Invalid {
        /// The key.
        key: &'static str,
        /// Its value, cut short.
        value: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The sidecar is not what a sidecar is.
    #[error("its sidecar `{sidecar}` is wrong: {reason}")]
    Sidecar {
        /// The sidecar's file name.
        sidecar: String,
        /// What is wrong with it.
        reason: String,
    },
}

/// The most characters of a value that a message repeats.
const SHOWN: usize = 60;

impl ModelError {
    /// A value that means nothing, cut to a length that a terminal bears.
    pub(super) fn invalid(key: &'static str, value: &str, reason: impl ToString) -> Self {
        let mut shown: String = value.chars().take(SHOWN).collect();
        if shown.len() < value.len() {
            shown.push('…');
        }
        Self::Invalid { key, value: shown, reason: shortened(&reason.to_string()) }
    }
}

//! The errors of filters.

use std::borrow::Cow;

use nunet_types::Hint;

use crate::error_kind::ErrorKind;

/// Why a filter's text or buffers are invalid.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FilterError {
    /// An unknown name.
    #[error("`{text}` is not a filter")]
    UnknownFilter {
        /// The text.
        text: String,
    },
    /// One filter twice.
    #[error("filter `{filter}` is given twice")]
    FilterTwice {
        /// The filter.
        filter: &'static str,
        /// How it is written.
        example: &'static str,
    },
    /// Text that is not `key:value`.
    #[error("`{text}` is not a setting of filter `{filter}`")]
    NoSetting {
        /// The filter.
        filter: &'static str,
        /// The text.
        text: String,
        /// How it is written.
        example: &'static str,
    },
    /// A setting that the filter does not have.
    #[error("filter `{filter}` has no setting `{key}`")]
    UnknownKey {
        /// The filter.
        filter: &'static str,
        /// The text.
        key: String,
        /// The filter's settings.
        known: &'static [&'static str],
    },
    /// A setting twice.
    #[error("setting `{key}` of filter `{filter}` is given twice")]
    KeyTwice {
        /// The filter.
        filter: &'static str,
        /// The setting.
        key: &'static str,
    },
    /// A setting that is not a number, or out of its range.
    #[error("setting `{key}` of filter `{filter}` is `{text}`, expected {expected}")]
    Value {
        /// The filter.
        filter: &'static str,
        /// The setting.
        key: &'static str,
        /// The text.
        text: String,
        /// What is accepted.
        expected: String,
    },
    /// A depth map smaller than one block of decimation.
    #[error("a depth map of {width}x{height} has no block of {factor}x{factor} pixels")]
    TooSmall {
        /// Width, pixels.
        width: u32,
        /// Height, pixels.
        height: u32,
        /// Pixels along each side of a block.
        factor: u32,
    },
    /// A buffer of another size than the filter's.
    #[error("the buffer `{buffer}` of filter `{filter}` has {got} elements, expected {expected}")]
    Size {
        /// The filter.
        filter: &'static str,
        /// The buffer.
        buffer: &'static str,
        /// Elements given.
        got: usize,
        /// Elements needed.
        expected: usize,
    },
}

impl FilterError {
    /// The kind of the error.
    #[must_use]
    pub fn kind(&self) -> ErrorKind {
        match self {
            Self::Size { .. } => ErrorKind::Buffer,
            _ => ErrorKind::Argument,
        }
    }
}

impl Hint for FilterError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        Some(match self {
            Self::UnknownFilter { .. } => "use one of decimation, spatial, temporal, holes".into(),
            Self::FilterTwice { example, .. } => {
                format!("write all of its settings together, as in `{example}`").into()
            }
            Self::NoSetting { example, .. } => format!("write it as in `{example}`").into(),
            Self::UnknownKey { known, .. } => format!("its settings are {}", known.join(", ")).into(),
            Self::TooSmall { .. } => "use a smaller decimation".into(),
            Self::KeyTwice { .. } | Self::Value { .. } | Self::Size { .. } => return None,
        })
    }
}

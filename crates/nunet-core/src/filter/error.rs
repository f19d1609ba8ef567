//! What is wrong with a filter as it was written, or with its buffers.

/// What is wrong with a filter.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FilterError {
    /// The name of a filter is none of ours.
    #[error("`{text}` is no filter\nhint: one of decimation, spatial, temporal, holes")]
    UnknownFilter {
        /// What was written.
        text: String,
    },
    /// Two settings of one filter.
    #[error("filter `{filter}` is given twice\nhint: write all of its settings together, as in `{example}`")]
    FilterTwice {
        /// The filter.
        filter: &'static str,
        /// How it is written.
        example: &'static str,
    },
    /// Something that is not `key:value`.
    #[error("`{text}` is no setting of filter `{filter}`\nhint: write it as in `{example}`")]
    NoSetting {
        /// The filter.
        filter: &'static str,
        /// What was written.
        text: String,
        /// How it is written.
        example: &'static str,
    },
    /// The name of a setting is none of the filter's.
    #[error("filter `{filter}` has no `{key}`\nhint: it has {}", known.join(", "))]
    UnknownKey {
        /// The filter.
        filter: &'static str,
        /// What was written.
        key: String,
        /// What it has.
        known: &'static [&'static str],
    },
    /// A setting that is given two values.
    #[error("`{key}` of filter `{filter}` is given twice")]
    KeyTwice {
        /// The filter.
        filter: &'static str,
        /// The setting.
        key: &'static str,
    },
    /// A setting that is out of its range, or no number at all.
    #[error("`{key}` of filter `{filter}` is `{text}`; expected {expected}")]
    Value {
        /// The filter.
        filter: &'static str,
        /// The setting.
        key: &'static str,
        /// What was written.
        text: String,
        /// What is taken.
        expected: String,
    },
    /// Not one block of decimation fits.
    #[error(
        "a depth map of `{width}x{height}` holds no block of `{factor}x{factor}` pixels\nhint: a smaller \
         `decimation`"
    )]
    TooSmall {
        /// The network's pixels from left to right.
        width: u32,
        /// The network's pixels from top to bottom.
        height: u32,
        /// Pixels on each side of a block.
        factor: u32,
    },
    /// A buffer of another size than the filter was made for.
    #[error("the `{buffer}` of filter `{filter}` holds `{got}` elements; it was made for `{expected}`")]
    Size {
        /// The filter.
        filter: &'static str,
        /// Which buffer.
        buffer: &'static str,
        /// Elements given.
        got: usize,
        /// Elements needed.
        expected: usize,
    },
}

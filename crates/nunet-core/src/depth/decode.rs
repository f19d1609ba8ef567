//! What a network's number `v` means, undone in place.

use std::fmt;
use std::str::FromStr;

/// What a network's number `v` means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Encoding {
    /// Metres: z = v.
    Metric,
    /// Inverse metres: z = 1 / v.
    Inverse,
    /// Logarithm of metres: z = exp(v).
    Log,
    /// Nearer or farther, without a unit: kept as it is.
    Relative,
    /// 0 for a picture's nearest point to 1 for its farthest, without a unit: kept as it is.
    MinMax,
}

impl Encoding {
    /// All encodings, in the order of the documentation.
    pub const ALL: [Self; 5] = [
        Self::Metric,
        Self::Inverse,
        Self::Log,
        Self::Relative,
        Self::MinMax,
    ];

    /// The name in a model's metadata.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Metric => "metric",
            Self::Inverse => "inverse",
            Self::Log => "log",
            Self::Relative => "relative",
            Self::MinMax => "minmax",
        }
    }

    /// Whether the decoded numbers are metres.
    #[must_use]
    pub fn is_metric(self) -> bool {
        matches!(self, Self::Metric | Self::Inverse | Self::Log)
    }

    /// Turns the network's numbers into depth, in place, and returns how many of them are no measurement (NaN).
    ///
    /// Metres come out of the metric encodings: what the network says, if it lies in `range`, times `focal_factor`;
    /// the range is the network's, so it is checked before the factor. The encodings without a unit ignore both and
    /// lose nothing but what is not finite.
    pub fn decode(self, values: &mut [f32], range: DepthRange, focal_factor: f32) -> u32 {
        todo!("{values:?} {range:?} {focal_factor}")
    }
}

impl fmt::Display for Encoding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Encoding {
    type Err = DepthError;

    fn from_str(text: &str) -> Result<Self, DepthError> {
        Self::ALL
            .into_iter()
            .find(|encoding| encoding.name() == text)
            .ok_or_else(|| DepthError::UnknownEncoding {
                text: text.to_owned(),
            })
    }
}

/// The depths that a network can measure; what lies outside is no measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthRange {
    min_m: f32,
    max_m: f32,
}

impl DepthRange {
    /// From `min_m` to `max_m`, both included, metres.
    ///
    /// # Errors
    /// Numbers that are not finite, a negative minimum, a maximum not above the minimum.
    pub fn new(min_m: f32, max_m: f32) -> Result<Self, DepthError> {
        if min_m.is_finite() && max_m.is_finite() && 0.0 <= min_m && min_m < max_m {
            Ok(Self { min_m, max_m })
        } else {
            Err(DepthError::Range { min_m, max_m })
        }
    }

    /// The nearest depth, metres.
    #[must_use]
    pub fn min_m(self) -> f32 {
        self.min_m
    }

    /// The farthest depth, metres.
    #[must_use]
    pub fn max_m(self) -> f32 {
        self.max_m
    }
}

/// What is wrong with the description of a network's depth.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum DepthError {
    /// The name of an encoding is none of ours.
    #[error("`{text}` is no depth encoding\nhint: one of metric, inverse, log, relative, minmax")]
    UnknownEncoding {
        /// What was written.
        text: String,
    },
    /// No depth lies in the range.
    #[error(
        "depth range `{min_m}` to `{max_m}` m; it must be finite, start at 0 or more, and end above its start"
    )]
    Range {
        /// The nearest depth, metres.
        min_m: f32,
        /// The farthest depth, metres.
        max_m: f32,
    },
}

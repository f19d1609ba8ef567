//! The macro that makes [`DepthEncoding`] of the table of all encodings, and what all of them have in common.

use std::fmt;
use std::str::FromStr;

use super::decode::NetworkOutput;
use super::{DepthEncoding, DepthError, DepthRange, OutputScale};

/// The meaning of decoded depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DepthKind {
    /// Meters.
    Metric,
    /// Without a unit.
    Relative,
    /// Without a unit, already stretched to 0..1 from the nearest point of an image to the farthest.
    MinMax,
}

// One macro, so that no encoding is missing in one of the places. It is called in `mod.rs` and takes the
// names from there.
macro_rules! depth_encodings {
    ($($(#[$doc:meta])* $encoding:ident = $name:literal, $kind:ident, |$output:ident| $decode:expr;)+) => {
        /// The meaning of a network's output value `v`.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        pub enum DepthEncoding { $($(#[$doc])* $encoding,)+ }

        impl DepthEncoding {
            /// All encodings, in the order of the documentation.
            pub const ALL: [Self; [$($name),+].len()] = [$(Self::$encoding),+];

            /// The name in metadata and sidecars.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self { $(Self::$encoding => $name,)+ }
            }

            /// The meaning of the decoded values.
            #[must_use]
            pub fn kind(self) -> DepthKind {
                match self { $(Self::$encoding => DepthKind::$kind,)+ }
            }

            fn decode_output(self, network_output: NetworkOutput<'_>) -> u32 {
                match self {
                    $(Self::$encoding => {
                        let $output = network_output;
                        $decode
                    })+
                }
            }
        }
    };
}
pub(super) use depth_encodings;

impl DepthEncoding {
    /// Whether the decoded values are meters.
    #[must_use]
    pub fn is_metric(self) -> bool {
        self.kind() == DepthKind::Metric
    }

    /// Decodes network outputs to depth in place, and returns the number of invalid values (NaN).
    ///
    /// `output` is applied first. For the metric encodings a depth outside `range` is not a measurement;
    /// valid depth is multiplied by `focal_factor`. The range is the network's, so it is checked before the
    /// factor. The other encodings ignore both.
    pub fn decode(
        self,
        values: &mut [f32],
        output: OutputScale,
        range: DepthRange,
        focal_factor: f32,
    ) -> u32 {
        self.decode_output(NetworkOutput { values, scale: output, range, focal_factor })
    }

    /// All names, for hints.
    pub(crate) fn names() -> String {
        Self::ALL.map(Self::name).join(", ")
    }
}

impl fmt::Display for DepthEncoding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for DepthEncoding {
    type Err = DepthError;

    fn from_str(text: &str) -> Result<Self, DepthError> {
        Self::ALL
            .into_iter()
            .find(|encoding| encoding.name() == text)
            .ok_or_else(|| DepthError::UnknownEncoding { text: text.to_owned() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_as_they_are_written() {
        for encoding in DepthEncoding::ALL {
            assert_eq!(encoding.to_string().parse(), Ok(encoding));
        }
        let error = "meters".parse::<DepthEncoding>().unwrap_err();
        assert_eq!(error, DepthError::UnknownEncoding { text: "meters".to_owned() });
    }

    #[test]
    fn only_the_kind_that_is_meters_is_metric() {
        for encoding in DepthEncoding::ALL {
            let metric = [DepthEncoding::Metric, DepthEncoding::Inverse, DepthEncoding::Log];
            assert_eq!(encoding.is_metric(), metric.contains(&encoding), "{encoding}");
        }
        assert_eq!(DepthEncoding::RelativeInverse.kind(), DepthKind::Relative);
        assert_eq!(DepthEncoding::MinMax.kind(), DepthKind::MinMax);
    }
}

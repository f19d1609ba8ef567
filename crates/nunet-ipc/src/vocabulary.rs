//! The numbers that stand for words in a [`FrameHeader`](crate::FrameHeader), and their names.

/// A value of a header field that stands for none of the field's words.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("field `{field}` holds `{value}`, but contract 1 knows only 0 to {last}")]
pub struct UnknownValue {
    /// The enumeration, as `contract --json` names it.
    pub field: &'static str,
    /// The number found.
    pub value: u32,
    /// The largest number that has a meaning.
    pub last: u32,
}

/// A word that is no value of an enumeration.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{word}` is no {field}\nhint: one of {choices}")]
pub struct UnknownWord {
    /// The enumeration, as `contract --json` names it.
    pub field: &'static str,
    /// What was given.
    pub word: String,
    /// Every word that is known, separated by commas.
    pub choices: String,
}

// One macro, so that numbers, names and the table of `contract --json` cannot drift apart.
macro_rules! vocabulary {
    ($(#[$doc:meta])* $name:ident as $field:literal { $($(#[doc = $variant_doc:literal])* $variant:ident = $number:literal $word:literal,)+ }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
        #[repr(u32)]
        pub enum $name { $($(#[doc = $variant_doc])* $variant = $number,)+ }

        impl $name {
            /// The enumeration's name in `contract --json`.
            pub const FIELD: &'static str = $field;
            /// Every value, in the order of their numbers.
            pub const ALL: &'static [Self] = &[$(Self::$variant,)+];
            /// Every word with its number.
            pub const NUMBERS: &'static [(&'static str, u32)] = &[$(($word, $number),)+];
            /// What each word means, in the order of their numbers.
            pub const DOCS: &'static [&'static str] = &[$(concat!($($variant_doc, "\n"),*),)+];

            /// The word for this value.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self { $(Self::$variant => $word,)+ }
            }
        }

        impl From<$name> for u32 {
            fn from(value: $name) -> Self {
                value as Self
            }
        }

        impl TryFrom<u32> for $name {
            type Error = UnknownValue;

            fn try_from(value: u32) -> Result<Self, UnknownValue> {
                let last = Self::ALL.len() as u32 - 1;
                Self::ALL.get(value as usize).copied().ok_or(UnknownValue { field: $field, value, last })
            }
        }

        impl std::str::FromStr for $name {
            type Err = UnknownWord;

            fn from_str(word: &str) -> Result<Self, UnknownWord> {
                Self::ALL.iter().copied().find(|value| value.name() == word).ok_or_else(|| UnknownWord {
                    field: $field,
                    word: word.to_owned(),
                    choices: Self::ALL.iter().map(|value| format!("`{value}`")).collect::<Vec<_>>().join(", "),
                })
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.pad(self.name())
            }
        }
    };
}

vocabulary! {
    /// What a service carries; the last part of its name.
    Topic as "topic" {
        /// The camera's picture, in one of the picture encodings.
        Rgb = 0 "rgb",
        /// The depth map: `[height, width]`, `f32`, NaN where there is no measurement.
        Depth = 1 "depth",
        /// The class of each pixel: `[height, width]`, `u8`.
        Labels = 2 "labels",
        /// The organised point cloud: `[height, width]` points of 16 bytes.
        Cloud = 3 "cloud",
        /// Obstacles by direction. Reserved: no version of the daemon publishes it yet.
        Scan = 4 "scan",
        /// The daemon's running figures: one [`StatsRecord`](crate::StatsRecord).
        Stats = 5 "stats",
    }
}

vocabulary! {
    /// How a payload's bytes are laid out.
    Encoding as "encoding" {
        /// `[height, width, 3]` bytes: red, green, blue.
        Rgb8 = 0 "rgb8",
        /// `[height, width, 3]` bytes: blue, green, red.
        Bgr8 = 1 "bgr8",
        /// `[height, width]` bytes of brightness.
        Mono8 = 2 "mono8",
        /// `[height, width / 2, 4]` bytes: Y0, U, Y1, V.
        Yuyv = 3 "yuyv",
        /// `[height, width]` bytes of Y, then `[height / 2, width / 2, 2]` of U, V.
        Nv12 = 4 "nv12",
        /// `[height, width]` little-endian `f32`.
        DepthF32 = 5 "depth_f32",
        /// `[height, width]` class indices.
        LabelsU8 = 6 "labels_u8",
        /// `[height, width]` [`Point`](crate::Point)s.
        Points = 7 "points",
        /// One [`StatsRecord`](crate::StatsRecord).
        StatsRecord = 8 "stats_record",
    }
}

/// The longest side of a picture that nunetd accepts, in pixels.
pub const MAX_SIDE_PX: u32 = 32_768;

impl Encoding {
    /// Those of a camera's pictures.
    pub const PICTURES: [Self; 5] = [Self::Rgb8, Self::Bgr8, Self::Mono8, Self::Yuyv, Self::Nv12];

    /// How a picture of `width` x `height` pixels lies without padding: bytes of a row, and rows. Odd sides round up where
    /// pixels share a colour. `None` for what is no picture, and for sides that are not 1 to [`MAX_SIDE_PX`].
    #[must_use]
    pub fn rows_of_picture(self, width: u32, height: u32) -> Option<(u32, u32)> {
        if ![width, height].iter().all(|side| (1..=MAX_SIDE_PX).contains(side)) {
            return None;
        }
        match self {
            Self::Rgb8 | Self::Bgr8 => Some((width * 3, height)),
            Self::Mono8 => Some((width, height)),
            Self::Yuyv => Some((width.next_multiple_of(2) * 2, height)),
            Self::Nv12 => Some((width.next_multiple_of(2), height + height.div_ceil(2))),
            Self::DepthF32 | Self::LabelsU8 | Self::Points | Self::StatsRecord => None,
        }
    }
}

vocabulary! {
    /// What the numbers of a depth map or a cloud are measured in.
    Units as "units" {
        /// The payload measures no distance.
        None = 0 "none",
        /// Metres.
        Metre = 1 "metre",
        /// Farther is larger, and nothing more is promised.
        Relative = 2 "relative",
    }
}

vocabulary! {
    /// Where the scale of a distance comes from.
    ScaleSource as "scale_source" {
        /// The network's own metres, for a camera like the one it was trained with.
        Metric = 0 "metric",
        /// The network's metres times the ratio of the cameras' focal lengths.
        FocalScaled = 1 "focal_scaled",
        /// The network's metres; the camera's focal length is not known.
        AssumedCamera = 2 "assumed_camera",
        /// There is no scale.
        Relative = 3 "relative",
    }
}

vocabulary! {
    /// The clock that `capture_nanos` was read from.
    Clock as "capture_clock" {
        /// `CLOCK_MONOTONIC` of this machine.
        Monotonic = 0 "monotonic",
        /// Nanoseconds since 1970-01-01 UTC.
        Unix = 1 "unix",
        /// The position in a recording.
        Media = 2 "media",
    }
}

vocabulary! {
    /// The lens model that `distortion`'s coefficients belong to.
    DistortionModel as "distortion_model" {
        /// A pinhole: no coefficients.
        None = 0 "none",
        /// Brown-Conrady: k1 k2 p1 p2 k3 k4 k5 k6, then s1 to s4 and the two tilts.
        BrownConrady = 1 "brown_conrady",
        /// Kannala-Brandt (fisheye): k1 to k4.
        KannalaBrandt = 2 "kannala_brandt",
    }
}

vocabulary! {
    /// How much of the network ran for this very frame.
    Quality as "quality" {
        /// Every stage.
        Full = 0 "full",
        /// The labels come from an earlier frame.
        ReusedLabels = 1 "reused_labels",
        /// A cheaper stand-in for the network.
        Fallback = 2 "fallback",
    }
}

vocabulary! {
    /// What a wake-up on `nunet/CAMERA/wake` says: the event's id.
    Wake as "wake" {
        /// The camera published a picture (`rgb`).
        Picture = 0 "picture",
        /// The daemon published a frame: `depth` and everything that goes with it.
        Depth = 1 "depth",
        /// An owner came. Sent by iceoryx2 itself.
        OwnerCame = 2 "owner_came",
        /// An owner left in good order. Sent by iceoryx2 itself.
        OwnerLeft = 3 "owner_left",
        /// An owner was found dead. Sent by iceoryx2 itself when anyone cleans up after it.
        OwnerDied = 4 "owner_died",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_is_its_position_so_that_the_look_up_cannot_miss() {
        fn check(numbers: &[(&str, u32)]) {
            for (position, (word, number)) in numbers.iter().enumerate() {
                assert_eq!(*number as usize, position, "{word}");
            }
        }
        for numbers in [
            Topic::NUMBERS,
            Encoding::NUMBERS,
            Units::NUMBERS,
            ScaleSource::NUMBERS,
            Clock::NUMBERS,
            DistortionModel::NUMBERS,
            Quality::NUMBERS,
            Wake::NUMBERS,
        ] {
            check(numbers);
        }
    }

    #[test]
    fn pictures_have_the_rows_that_their_encoding_needs() {
        assert_eq!(Encoding::Rgb8.rows_of_picture(640, 480), Some((1920, 480)));
        assert_eq!(Encoding::Mono8.rows_of_picture(7, 5), Some((7, 5)));
        assert_eq!(Encoding::Yuyv.rows_of_picture(7, 5), Some((16, 5)));
        assert_eq!(Encoding::Nv12.rows_of_picture(7, 5), Some((8, 8)));
        assert_eq!(Encoding::Bgr8.rows_of_picture(MAX_SIDE_PX, 1), Some((3 * MAX_SIDE_PX, 1)));
        for encoding in Encoding::PICTURES {
            for (width, height) in [(0, 1), (1, 0), (MAX_SIDE_PX + 1, 1), (1, u32::MAX)] {
                assert_eq!(encoding.rows_of_picture(width, height), None, "{encoding} {width}x{height}");
            }
        }
        for &encoding in Encoding::ALL {
            let is_picture = Encoding::PICTURES.contains(&encoding);
            assert_eq!(encoding.rows_of_picture(4, 4).is_some(), is_picture, "{encoding}");
        }
    }

    #[test]
    fn a_word_reads_back_as_the_value_it_names() {
        for topic in Topic::ALL {
            assert_eq!(topic.name().parse(), Ok(*topic));
        }
    }

    #[test]
    fn an_unknown_number_says_what_was_expected() {
        let message = Quality::try_from(9).unwrap_err().to_string();
        assert_eq!(message, "field `quality` holds `9`, but contract 1 knows only 0 to 2");
    }

    #[test]
    fn an_unknown_word_lists_the_choices() {
        let message = "depht".parse::<Topic>().unwrap_err().to_string();
        assert!(message.starts_with("`depht` is no topic\nhint: one of `rgb`, `depth`,"), "{message}");
    }
}

//! Parsers for the values of flags and keys. Both use the same parser, so both give the same error.

use std::fmt::Display;
use std::net::SocketAddr;
use std::num::{NonZeroU32, NonZeroU64, NonZeroUsize};
use std::str::FromStr;

use clap::ValueEnum;
use clap::builder::PossibleValue;
use nunet_core::camera::IntrinsicsSpec;
use nunet_core::filter::FilterSpec;
use nunet_core::frame::PixelFormat;
use nunet_core::graph::Provider;
use nunet_engine::sha256_bytes;
use nunet_mavlink::MavlinkAddress;
use nunet_ros2::{DepthFormat, LinkName};
use nunet_types::{ImageSize, text_with_hint};
use serde::de::{Deserialize, Deserializer, Error as _};

use crate::config::{AttitudeSource, MAX_FRAME_ID, MountOption, Publish, StabilityLimit};
use crate::exit::BadArguments;
use crate::source::{CameraSetting, Rate, Rotation};

/// A value that is written as text, on the command line and in the configuration file.
#[derive(Debug, Clone, PartialEq)]
pub struct Text<T>(pub T);

/// Parses a value.
pub trait FromText: Sized {
    /// # Errors
    /// What is expected instead.
    fn from_text(text: &str) -> Result<Self, BadArguments>;
}

impl<T: FromText> FromStr for Text<T> {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        // clap and serde can carry only a text.
        T::from_text(text).map(Self).map_err(|error| text_with_hint(&error.on_one_line()))
    }
}

impl<'de, T: FromText> Deserialize<'de> for Text<T> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
    }
}

/// The value of an optional setting.
pub(super) fn value<T: Clone>(text: &Option<Text<T>>) -> Option<T> {
    text.as_ref().map(|Text(value)| value.clone())
}

/// Types whose parser gives complete errors.
macro_rules! from_str {
    ($error:path: $($type:ty),+) => {
        $(impl FromText for $type {
            fn from_text(text: &str) -> Result<Self, BadArguments> {
                <Self as FromStr>::from_str(text).map_err(|error| $error(&error))
            }
        })+
    };
}

from_str!(BadArguments::of: Provider, IntrinsicsSpec, FilterSpec, MavlinkAddress, LinkName, DepthFormat);
from_str!(BadArguments::from_text: MountOption);
from_str!(plain: CameraSetting, Rate, Rotation, ImageSize, PixelFormat, StabilityLimit, AttitudeSource);

fn plain(error: &impl Display) -> BadArguments {
    BadArguments::new(error.to_string())
}

/// A value that `fits`. The error messages of the standard library name Rust types, so they are replaced.
pub(super) fn parsed<T: FromStr>(text: &str, wanted: &str, fits: fn(&T) -> bool) -> Result<T, BadArguments> {
    let value = text.parse().ok().filter(fits);
    value.ok_or_else(|| BadArguments::new(format!("expected {wanted}, got `{text}`")))
}

/// Counts.
macro_rules! count {
    ($($type:ty),+) => {
        $(impl FromText for $type {
            fn from_text(text: &str) -> Result<Self, BadArguments> {
                parsed(text, "a whole number of 1 or more", |_| true)
            }
        })+
    };
}

count!(NonZeroU32, NonZeroU64, NonZeroUsize);

impl FromText for SocketAddr {
    fn from_text(text: &str) -> Result<Self, BadArguments> {
        parsed(text, "ADDRESS:PORT, such as `127.0.0.1:9477`", |_| true)
            .map_err(|error| error.with_hint("write the address in numbers: 127.0.0.1 is this machine"))
    }
}

impl ValueEnum for Publish {
    fn value_variants<'a>() -> &'a [Self] {
        &Self::ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.name()))
    }
}

/// A number of processes that can read a camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Readers(pub NonZeroU32);

/// The most readers that fit into the shared memory of a camera.
const MAX_READERS: u32 = 62;

impl FromText for Readers {
    fn from_text(text: &str) -> Result<Self, BadArguments> {
        parsed(text, &format!("1 to {MAX_READERS}"), |most: &NonZeroU32| most.get() <= MAX_READERS).map(Self)
    }
}

/// The name of a coordinate frame. A truncated name would be another coordinate frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FrameId(pub String);

impl FromText for FrameId {
    fn from_text(text: &str) -> Result<Self, BadArguments> {
        if text.is_empty() || text.len() > MAX_FRAME_ID {
            return Err(BadArguments::new(format!("expected 1 to {MAX_FRAME_ID} bytes, got {}", text.len())));
        }
        if text.chars().any(char::is_control) {
            return Err(BadArguments::new("expected a name without control characters"));
        }
        Ok(Self(text.to_owned()))
    }
}

/// The mode of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FileMode(pub u32);

impl FromText for FileMode {
    fn from_text(text: &str) -> Result<Self, BadArguments> {
        let mode = u32::from_str_radix(text, 8);
        mode.map(Self).map_err(|_| {
            BadArguments::new(format!("expected an octal number such as \"0640\", got `{text}`"))
        })
    }
}

/// A stage that runs only on every n-th frame.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StageEvery(pub String, pub NonZeroU32);

impl FromText for StageEvery {
    fn from_text(text: &str) -> Result<Self, BadArguments> {
        let (stage, count) = text
            .split_once('=')
            .ok_or_else(|| BadArguments::new("expected `STAGE=N`, such as `segmentation=3`"))?;
        Ok(Self(stage.to_owned(), parsed(count, "a count of 1 or more", |_| true)?))
    }
}

/// A distance in meters, greater than 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distance(pub f32);

impl FromText for Distance {
    fn from_text(text: &str) -> Result<Self, BadArguments> {
        let is_distance = |range: &f32| range.is_finite() && *range > 0.0;
        parsed(text, "a number of meters greater than 0", is_distance).map(Self)
    }
}

/// A count; 0 is checked later.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Count(pub usize);

impl FromText for Count {
    fn from_text(text: &str) -> Result<Self, BadArguments> {
        parsed(text, "a whole number", |_| true).map(Self)
    }
}

/// A time in seconds, 0 or more.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Seconds(pub f32);

impl FromText for Seconds {
    fn from_text(text: &str) -> Result<Self, BadArguments> {
        let is_duration = |seconds: &f32| seconds.is_finite() && *seconds >= 0.0;
        parsed(text, "a number of seconds, 0 or more", is_duration).map(Self)
    }
}

/// A SHA-256.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Hash(pub [u8; 32]);

impl FromText for Hash {
    fn from_text(text: &str) -> Result<Self, BadArguments> {
        let expected = || BadArguments::new(format!("expected 64 hexadecimal digits, got `{text}`"));
        sha256_bytes(text).map(Self).ok_or_else(expected)
    }
}

#[cfg(test)]
mod tests {
    use nunet_types::split_hint;

    use super::*;

    #[test]
    fn a_coordinate_frame_has_no_control_characters() {
        assert!(FrameId::from_text("robot1/front_optical").is_ok());
        for wrong in ["", "a\nb", "a\u{7}", &"x".repeat(MAX_FRAME_ID + 1)] {
            assert!(FrameId::from_text(wrong).is_err(), "{wrong:?}");
        }
    }

    #[test]
    fn an_error_has_no_escaped_line_end_before_its_hint() {
        let degrees = MountOption::from_text("0,0,0.25,180,-4,0").unwrap_err();
        assert_eq!(degrees.to_string(), "mount: roll is 180, expected -2π to 2π");
        let written = "0,0,0.25,180,-4,0".parse::<Text<MountOption>>().unwrap_err();
        let hint = "give angles in radians: 90 degrees are 1.571";
        assert_eq!(split_hint(&written), (&*degrees.to_string(), Some(hint.to_owned())));
    }

    #[test]
    fn hashes_are_64_hexadecimal_digits() {
        assert_eq!(Hash::from_text(&"0f".repeat(32)), Ok(Hash([15; 32])));
        for wrong in
            ["", "0f", &"0".repeat(63), &"0".repeat(66), &"0g".repeat(32), &"+f".repeat(32), &"ß".repeat(32)]
        {
            assert!(Hash::from_text(wrong).unwrap_err().to_string().ends_with(&format!("got `{wrong}`")));
        }
    }
}

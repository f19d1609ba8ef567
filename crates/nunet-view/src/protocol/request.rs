//! The requests of a client.

use serde::Deserialize;

use super::number::{number, width};

/// The longest request that is accepted.
pub(crate) const MAX_REQUEST_BYTES: usize = 4096;

/// A request, as JSON text: `{"type": "watch", "camera": "front"}`.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields, expecting = "an object with `type`")]
pub enum Request {
    /// Sends frames of a camera from now on, instead of those of the previous `watch`.
    Watch(Watch),
    /// Sends no frames until the next `watch`. The last one is kept, so that probes read it.
    Pause,
    /// Asks for the depth at a point of the last frame that was sent: shares of width and height from 0 to 1.
    Probe {
        /// From the left edge (0) to the right edge (1).
        #[serde(deserialize_with = "number")]
        u: f32,
        /// From the upper edge (0) to the lower edge (1).
        #[serde(deserialize_with = "number")]
        v: f32,
    },
}

/// Which frames, and how often.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object with `camera`")]
pub struct Watch {
    /// The camera's name.
    pub camera: String,
    /// Whether the image is sent.
    #[serde(default = "yes")]
    pub image: bool,
    /// Whether depth is sent.
    #[serde(default = "yes")]
    pub depth: bool,
    /// Whether labels are sent, if the model has them.
    #[serde(default = "yes")]
    pub labels: bool,
    /// Whether the confidence of depth is sent, if the model has it. False by default: it takes more bytes
    /// than depth.
    #[serde(default)]
    pub confidence: bool,
    /// Whether obstacles are sent, if the camera has a mount.
    #[serde(default = "yes")]
    pub obstacles: bool,
    /// Images and maps that are wider are reduced by a whole factor, pixels, 16 to 32768.
    #[serde(default = "default_width", deserialize_with = "width")]
    pub max_width: u32,
    /// Frames per second at most, more than 0, up to 120.
    #[serde(default = "default_fps", deserialize_with = "number")]
    pub max_fps: f32,
    /// Megabits per second at most, on average, more than 0, up to 10000.
    #[serde(default = "default_rate", deserialize_with = "number")]
    pub max_mbit_per_s: f32,
}

fn yes() -> bool {
    true
}

fn default_width() -> u32 {
    320
}

fn default_fps() -> f32 {
    15.0
}

fn default_rate() -> f32 {
    3.0
}

/// Why a text is not a request.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RequestError {
    /// It is too long.
    #[error("the request has {bytes} bytes, expected at most {MAX_REQUEST_BYTES}")]
    TooLong {
        /// Its length.
        bytes: usize,
    },
    /// It is not JSON, or not one of the requests.
    #[error("the request cannot be read")]
    Json(#[from] serde_json::Error),
    /// A number is out of range.
    #[error("`{field}` is {value}, expected {expected}")]
    OutOfRange {
        /// The field.
        field: &'static str,
        /// Its value.
        value: f32,
        /// What is accepted.
        expected: &'static str,
    },
}

impl Request {
    /// Reads a request.
    ///
    /// # Errors
    /// It is too long, not a request, or has a number out of range.
    pub fn parse(text: &str) -> Result<Self, RequestError> {
        if text.len() > MAX_REQUEST_BYTES {
            return Err(RequestError::TooLong { bytes: text.len() });
        }
        let request: Self = serde_json::from_str(text)?;
        match &request {
            Self::Watch(watch) => watch.check()?,
            Self::Probe { u, v } => {
                for (field, value) in [("u", *u), ("v", *v)] {
                    check(field, value, (0.0..=1.0).contains(&value), "0 to 1")?;
                }
            }
            Self::Pause => {}
        }
        Ok(request)
    }
}

impl Watch {
    /// The default rates and size for a camera.
    #[must_use]
    pub fn camera(name: impl Into<String>) -> Self {
        Self {
            camera: name.into(),
            image: true,
            depth: true,
            labels: true,
            confidence: false,
            obstacles: true,
            max_width: default_width(),
            max_fps: default_fps(),
            max_mbit_per_s: default_rate(),
        }
    }

    /// Whether its numbers are in range.
    pub(crate) fn check(&self) -> Result<(), RequestError> {
        let Self { max_width, max_fps, max_mbit_per_s, .. } = *self;
        check("max_width", max_width as f32, (16..=32_768).contains(&max_width), "16 to 32768")?;
        check("max_fps", max_fps, max_fps > 0.001 && max_fps <= 120.0, "more than 0.001, up to 120")?;
        let is_rate = max_mbit_per_s > 0.001 && max_mbit_per_s <= 10_000.0;
        check("max_mbit_per_s", max_mbit_per_s, is_rate, "more than 0.001, up to 10000")
    }
}

fn check(
    field: &'static str,
    value: f32,
    is_in_range: bool,
    expected: &'static str,
) -> Result<(), RequestError> {
    if is_in_range { Ok(()) } else { Err(RequestError::OutOfRange { field, value, expected }) }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_request_names_only_what_differs_from_the_defaults() {
        let request = Request::parse(r#"{"type": "watch", "camera": "front", "labels": false}"#).unwrap();
        assert_eq!(request, Request::Watch(Watch { labels: false, ..Watch::camera("front") }));
        assert_eq!(Request::parse(r#"{"type": "pause"}"#).unwrap(), Request::Pause);
        let probe = Request::parse(r#"{"type": "probe", "u": 0.5, "v": 1}"#).unwrap();
        assert_eq!(probe, Request::Probe { u: 0.5, v: 1.0 });
    }

    #[test]
    fn malformed_requests_are_errors() {
        for text in [
            "",
            "{",
            "null",
            "[]",
            r#"{"type": "fly"}"#,
            r#"{"type": "watch"}"#,
            r#"{"type": "watch", "camera": 1}"#,
            r#"{"type": "watch", "camera": "a", "max_widht": 320}"#,
            r#"{"type": "probe", "u": null, "v": 0}"#,
        ] {
            assert!(matches!(Request::parse(text), Err(RequestError::Json(_))), "{text}");
        }
        let long = format!(r#"{{"type": "watch", "camera": "{}"}}"#, "x".repeat(MAX_REQUEST_BYTES));
        assert!(matches!(Request::parse(&long), Err(RequestError::TooLong { .. })));
    }

    #[test]
    fn numbers_out_of_range_are_named() {
        for (text, field) in [
            (r#"{"type": "probe", "u": 1.1, "v": 0}"#, "u"),
            (r#"{"type": "probe", "u": 0, "v": -1e-9}"#, "v"),
            (r#"{"type": "watch", "camera": "a", "max_width": 15}"#, "max_width"),
            (r#"{"type": "watch", "camera": "a", "max_fps": 0}"#, "max_fps"),
            (r#"{"type": "watch", "camera": "a", "max_fps": 1e30}"#, "max_fps"),
            (r#"{"type": "watch", "camera": "a", "max_mbit_per_s": -3}"#, "max_mbit_per_s"),
        ] {
            match Request::parse(text) {
                Err(RequestError::OutOfRange { field: found, .. }) => assert_eq!(found, field),
                other => panic!("{text}: {other:?}"),
            }
        }
    }

    proptest! {
        #[test]
        fn any_text_is_a_request_or_an_error(text in ".{0,200}") {
            let _ = Request::parse(&text);
        }
    }
}

//! The parameters in the addresses of videos.

use std::str::FromStr;

use crate::protocol::{RequestError, Watch};

const NAMES: &str = "`fps`, `mbit`, `width`, `near`, `far`, `token`";

/// The query of `image.mjpeg` and `depth.mjpeg`.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct VideoQuery {
    /// Frames per second at most.
    fps: Option<f32>,
    /// Megabits per second at most.
    mbit: Option<f32>,
    /// Wider images are reduced by a whole factor, pixels.
    width: Option<u32>,
    /// Depth of the first color (red); by default, the first percentile of each frame.
    pub(super) near: Option<f32>,
    /// Depth of the last color (blue); by default, the last percentile of each frame.
    pub(super) far: Option<f32>,
}

/// What is wrong with a parameter. The messages have the names of the address.
#[derive(Debug, thiserror::Error)]
pub(super) enum ParameterError {
    /// There is no such parameter.
    #[error("unknown parameter `{0}`, expected one of: {NAMES}")]
    Unknown(String),
    /// It is there more than once.
    #[error("`{0}` is given twice")]
    Repeated(&'static str),
    /// Its value is not a number.
    #[error("`{name}` is `{value}`, expected {expected}")]
    NoNumber {
        /// The parameter.
        name: &'static str,
        /// Its value.
        value: String,
        /// What is accepted.
        expected: &'static str,
    },
    /// Its value is out of range.
    #[error(transparent)]
    OutOfRange(RequestError),
}

impl VideoQuery {
    /// Reads names and values. serde would read them too, but its messages name types of Rust.
    pub(super) fn read(parameters: &[(String, String)]) -> Result<Self, ParameterError> {
        let mut query = Self::default();
        for (name, value) in parameters {
            match name.as_str() {
                "fps" => set(&mut query.fps, "fps", value, "a number")?,
                "mbit" => set(&mut query.mbit, "mbit", value, "a number")?,
                "width" => set(&mut query.width, "width", value, "a whole number from 16 to 32768")?,
                "near" => set(&mut query.near, "near", value, "a number")?,
                "far" => set(&mut query.far, "far", value, "a number")?,
                // Checked before.
                "token" => {}
                _ => return Err(ParameterError::Unknown(name.clone())),
            }
        }
        Ok(query)
    }

    /// The same limits as those of a WebSocket; by default as wide as the camera.
    pub(super) fn watch(&self, camera: &str) -> Result<Watch, ParameterError> {
        let defaults = Watch::camera(camera);
        let watch = Watch {
            max_fps: self.fps.unwrap_or(defaults.max_fps),
            max_mbit_per_s: self.mbit.unwrap_or(defaults.max_mbit_per_s),
            max_width: self.width.unwrap_or(640),
            ..defaults
        };
        watch.check().map_err(with_own_name)?;
        for (field, value) in [("near", self.near), ("far", self.far)] {
            if let Some(value) = value.filter(|value| !value.is_finite()) {
                let expected = "a finite number";
                return Err(ParameterError::OutOfRange(RequestError::OutOfRange { field, value, expected }));
            }
        }
        Ok(watch)
    }
}

/// Sets a parameter that was not set before.
fn set<T: FromStr>(
    parameter: &mut Option<T>,
    name: &'static str,
    value: &str,
    expected: &'static str,
) -> Result<(), ParameterError> {
    let Ok(number) = value.parse::<T>() else {
        return Err(ParameterError::NoNumber { name, value: value.to_owned(), expected });
    };
    parameter.replace(number).map_or(Ok(()), |_| Err(ParameterError::Repeated(name)))
}

/// The error with the name that the address has for a field of a request.
fn with_own_name(error: RequestError) -> ParameterError {
    ParameterError::OutOfRange(match error {
        RequestError::OutOfRange { field, value, expected } => {
            let field = match field {
                "max_fps" => "fps",
                "max_mbit_per_s" => "mbit",
                "max_width" => "width",
                field => field,
            };
            RequestError::OutOfRange { field, value, expected }
        }
        error => error,
    })
}
